"""The commands of `jaxid` on an axis: they call the library, write results and print them.

The arguments are those of the functions of the same name in `jaxid.axis.cli`, which document them;
`known` is the axis of the axis file.
"""

import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from tqdm import tqdm

from jaxid.axis.defaults import EFFORTS
from jaxid.axis.design import design_axis
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import Axis
from jaxid.axis.identify import IdentifyResult, identify_axis
from jaxid.axis.prior import propose
from jaxid.axis.result import Result, write
from jaxid.axis.saved_designs import SavedDesign, designs_in, of_another_axis, read_design
from jaxid.axis.simulate import simulate_axis
from jaxid.axis.simulate_result import SimulateResult
from jaxid.axis.sweep import forget_blocks, sweep_axis
from jaxid.axis.sweep_result import SweepResult
from jaxid.axis.tradeoff import tradeoff
from jaxid.axis.tradeoff_result import TradeoffResult
from jaxid.io.log_file import read_log
from jaxid.io.manifest import sha256_of
from jaxid.io.recorded import Columns
from jaxid.io.results import require_writable


def prior(known: Axis, axis: Path, log: Path) -> None:
    """Print a proposal for prior intervals and δ from a log."""
    print(propose(known, read_log(log, _columns(axis, known))).text())


def design(
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
    """Design one motion, or one for every target and duration, and write it to a folder."""
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
    _finish(out, result, force)
    if not several:
        print(f"Next: {shlex.join(['jaxid', 'simulate', str(axis), str(out)])}")


def simulate(
    known: Axis, axis: Path, folder: Path, plants: int, logs: int, seed: int, *, force: bool
) -> None:
    """Simulate random plants along the motion of a folder, and write the result there."""
    saved = read_design(folder, known.system.coordinate)
    require_writable(folder, SimulateResult.names, replace=force)
    with tqdm(bar_format="{desc} ({elapsed})", leave=False) as line:
        found = simulate_axis(known, saved.motion, plants, logs, seed, line.set_description)
    _tell_changed(axis, [saved], known)
    _finish(folder, SimulateResult(found, saved.part.digest), force)


def sweep(
    known: Axis,
    axis: Path,
    folder: Path,
    bandwidths: Sequence[float],
    factors: Sequence[float],
    plants: int,
    seed: int,
    *,
    force: bool,
) -> None:
    """Simulate closed loops with every motion of a folder, and write the result there."""
    saved = designs_in(folder, known.system.coordinate)
    require_writable(folder, SweepResult.names, replace=force)
    with tqdm(unit="block") as line:

        def tell(done: int, total: int) -> None:
            line.total = total
            line.update(done - line.n)

        found = sweep_axis(known, saved, bandwidths, factors, plants, seed, tell)
    if found is None:  # another process has all of it
        return
    _tell_changed(axis, saved.designs.values(), known)
    try:
        _finish(folder, SweepResult(found), force)
    except ValueError:  # another run has written its result: these blocks are of no more use
        forget_blocks(folder)
        raise
    forget_blocks(folder)


def identify(known: Axis, axis: Path, log: Path, out: Path, *, force: bool) -> bool:
    """Identify the axis from a log, write the result, and return whether the log is consistent."""
    require_writable(out, IdentifyResult.names, replace=force)
    recorded = read_log(log, _columns(axis, known))
    with tqdm(bar_format="{desc} ({elapsed})", leave=False) as line:
        found = identify_axis(known, recorded, line.set_description)
    _finish(out, IdentifyResult(found, sha256_of(log)), force)
    return found.result is not None


def _columns(path: Path, axis: Axis) -> Columns:
    """Return the columns of a log that the table [log] names."""
    if axis.columns is None:
        raise ValueError(
            f"File {path} has no table [log]. Add one that names the columns of position and "
            "input; the file that `jaxid init` writes has an example."
        )
    return axis.columns


def _tell_changed(path: Path, designs: Iterable[SavedDesign], axis: Axis) -> None:
    """Print which motions were designed for another axis file."""
    for folder in of_another_axis(designs, axis):
        print(f"Warning: {path} has changed since the design in {folder} was made.")


def _finish(folder: Path, result: Result, replace: bool) -> None:
    """Write a result and print it, even if it cannot be written: it may have taken long."""
    try:
        write(folder, result, replace=replace)
    finally:
        print(result.text())
    print(f"Wrote to {folder}: {', '.join(result.names)}")
