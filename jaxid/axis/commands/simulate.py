"""The command `jaxid simulate`."""

from pathlib import Path

from jaxid.axis.commands.shared import finish, progress, tell_changed
from jaxid.axis.file import Axis
from jaxid.axis.saved_designs import of_another_axis, read_design
from jaxid.axis.simulate import simulate_axis
from jaxid.axis.simulate_result import SimulateResult
from jaxid.io.results import require_writable


def run(
    known: Axis, axis: Path, folder: Path, plants: int, logs: int, seed: int, *, force: bool
) -> None:
    """Simulate random plants along the motion of a folder, and write the result there.

    The arguments are those of `jaxid.axis.cli.simulate`; `known` is the axis of the axis file.
    """
    saved = read_design(folder, known.system.coordinate)
    require_writable(folder, SimulateResult.names, replace=force)
    with progress() as report:
        found = simulate_axis(known, saved.motion, plants, logs, seed, report)
    tell_changed(axis, of_another_axis([saved], known))
    finish(folder, SimulateResult(found, saved.part.digest), replace=force)
