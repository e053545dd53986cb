"""The command `jaxid design`."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from jaxid.axis.commands.shared import finish, progress
from jaxid.axis.defaults import EFFORTS
from jaxid.axis.design import InterruptedDesign, design_axis
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import Axis
from jaxid.axis.tradeoff import tradeoff
from jaxid.axis.tradeoff_result import TradeoffResult
from jaxid.io.results import require_writable


def run(
    known: Axis,
    axis: Path,
    out: Path,
    target: Sequence[str],
    durations: Sequence[float],
    seed: int,
    effort: str,
    *,
    force: bool,
) -> None:
    """Design one motion, or one for every target and duration, and write it to a folder.

    The arguments are those of `jaxid.axis.cli.design`; `known` is the axis of the axis file.
    """
    target = tuple(dict.fromkeys(target))
    times = tuple(dict.fromkeys(durations)) or (known.task.intervals * known.task.period,)
    several = len(target) * len(times) > 1
    names = (TradeoffResult if several else DesignResult).names
    require_writable(out, names, replace=force)
    interruption = None
    with progress() as report:
        search = seed, EFFORTS[effort], report
        if several:
            result = TradeoffResult(tradeoff(known, target, times, out, *search, replace=force))
        else:
            try:
                found = design_axis(known.lasting(times[0]), target[0], *search)
            except InterruptedDesign as error:
                found, interruption = error.found, error
            result = DesignResult(found)
    finish(out, result, replace=force)
    if interruption is not None:
        print(interruption)
        raise KeyboardInterrupt from None
    if not several:
        print(f"Next: {shlex.join(['jaxid', 'simulate', str(axis), str(out)])}")
