"""The command `jaxid sweep`."""

from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from jaxid.axis.commands.shared import finish, tell_changed
from jaxid.axis.file import Axis
from jaxid.axis.saved_designs import designs_in, of_another_axis
from jaxid.axis.sweep import forget_blocks, sweep_axis
from jaxid.axis.sweep_result import SweepResult
from jaxid.io.results import require_writable


def run(
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
    """Simulate closed loops with every motion of a folder, and write the result there.

    The arguments are those of `jaxid.axis.cli.sweep`; `known` is the axis of the axis file.
    """
    saved = designs_in(folder, known.system.coordinate)
    require_writable(folder, SweepResult.names, replace=force)
    with tqdm(unit="block") as line:

        def tell(done: int, total: int) -> None:
            line.total = total
            line.update(done - line.n)

        found = sweep_axis(known, saved, bandwidths, factors, plants, seed, tell)
    if found is None:  # another process has all of it
        return
    tell_changed(axis, of_another_axis(saved.designs.values(), known))
    try:
        finish(folder, SweepResult(found), replace=force)
    except ValueError:  # another run has written its result: these blocks are of no more use
        forget_blocks(folder)
        raise
    forget_blocks(folder)
