"""The command `jaxid design`."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from jaxid.axis.commands.shared import finish
from jaxid.axis.defaults import EFFORTS
from jaxid.axis.design import design_axis
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
    with tqdm(bar_format="{desc} ({elapsed})") as line:
        search = seed, EFFORTS[effort], line.set_description
        if several:
            result = TradeoffResult(tradeoff(known, target, times, out, *search, replace=force))
        else:
            result = DesignResult(design_axis(known.lasting(times[0]), target[0], *search))
    finish(out, result, replace=force)
    if not several:
        print(f"Next: {shlex.join(['jaxid', 'simulate', str(axis), str(out)])}")
