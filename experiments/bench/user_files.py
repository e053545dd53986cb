"""Axis files and logs as a user has them, for the measured commands.

Each function writes the files of one case to a folder and returns the arguments of `jaxid`. Its
argument `run` selects other numbers of the same size.
"""

from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np

from experiments._support.processes import processors
from jaxid.axis.defaults import ALL
from jaxid.axis.design import evaluated
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import Axis, read_axis
from jaxid.axis.result import write
from jaxid.axis.texts import example
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import run as run_experiment
from jaxid.loop.disturbances import LowSpeedFriction
from jaxid.loop.simulate import Plant
from jaxid.regression.lower_bound import lower_bound

AXIS = "axis.toml"
_MOTION = Path(__file__).parents[2] / "figures" / "trajectory_minimax.csv"
_SPRING = """
[[terms]]
kind = "spring"
name = "K"
unit = "V/m"
interval = [-1.0, 1.0]
"""
_DISTURBED = 0.05  # V, of a disturbance in the logs


def typo(folder: Path, run: int) -> Sequence[str]:
    """Return the arguments of a command on an axis file with a misspelt key."""
    _write_axis(folder, ("[servo]\nperiod", f"[servo]\nperoid{run}"))
    return "identify", AXIS, "log.csv", "--out", "out"


def log(folder: Path, run: int, rows: int) -> Sequence[str]:
    """Return the arguments of `identify` on a log of some rows at 5 kHz, of four terms."""
    axis = _write_axis(folder)
    _write_log(folder, axis, run, rows)
    return "identify", AXIS, "log.csv", "--out", "out"


def pieces(folder: Path, run: int) -> Sequence[str]:
    """Return the arguments of `identify` on a log whose time stamps have six gaps."""
    axis = _write_axis(folder)
    edges = np.linspace(0, 6_000, 8).round().astype(int)[1:-1] + 17 * run
    _write_log(folder, axis, run, 6_000, edges)
    return "identify", AXIS, "log.csv", "--out", "out"


def prior(folder: Path, run: int) -> Sequence[str]:
    """Return the arguments of `prior` on a log of 3.3 s at 2 kHz, of five terms."""
    axis = _write_axis(folder, ("period = 0.0002 ", "period = 0.0005 "), spring=True)
    _write_log(folder, axis, run, 6_600)
    return "prior", AXIS, "log.csv"


def quick_design(folder: Path, run: int) -> Sequence[str]:
    """Return the arguments of a quick `design` of four terms."""
    _write_axis(folder)
    return "design", AXIS, "--out", "out", "--effort", "quick", "--seed", str(run)


def usual_design(folder: Path, run: int) -> Sequence[str]:
    """Return the arguments of a `design` of five terms."""
    _write_axis(folder, spring=True)
    return "design", AXIS, "--out", "out", "--seed", str(run)


def simulate(folder: Path, run: int) -> Sequence[str]:
    """Return the arguments of `simulate` with 200 random axes and 10 identified logs."""
    axis = _write_axis(folder)
    assert axis is not None
    least = lower_bound(axis.system, axis.task.limits)
    design = evaluated(axis, ALL, "committed", read_trajectory(_MOTION), least)
    write(folder / "out", DesignResult(design))
    return "simulate", AXIS, "out", "--plants", "200", "--logs", "10", "--seed", str(run)


def reproduction(folder: Path, run: int) -> Sequence[str]:
    """Return the arguments of the program of `make reproduce`, with another seed each time."""
    return "--out", str(folder), "--seed", str(run)


def tests(folder: Path, run: int) -> Sequence[str]:
    """Return the arguments of pytest for the tests of `make test`."""
    return "-q", "-n", str(len(processors())), "--dist", "worksteal", "-m", "not slow"


def _write_axis(folder: Path, *changes: tuple[str, str], spring: bool = False) -> Axis | None:
    """Write the example axis with some changes of its text; return it unless it is invalid."""
    text = example("linear")
    for old, new in changes:
        assert old in text, f"the example axis has no {old!r}"
        text = text.replace(old, new)
    path = folder / AXIS
    path.write_text(text + (_SPRING if spring else ""))
    try:
        return read_axis(path)
    except ValueError:
        return None


def _write_log(
    folder: Path, axis: Axis | None, run: int, rows: int, gaps: Sequence[int] | np.ndarray = ()
) -> None:
    """Write the log of a random axis that repeats a motion, with gaps of the clock."""
    assert axis is not None
    system, motion = axis.system, read_trajectory(_MOTION)
    share = jax.random.uniform(jax.random.key(run), (len(system.names),))
    theta = system.lower + (0.2 + 0.6 * share) * (system.upper - system.lower)
    plant = Plant(system, theta, LowSpeedFriction(_DISTURBED, 0.1))
    repeats = -(-rows // axis.servo.ticks(motion))
    found = run_experiment(plant, axis.tracking_controller, axis.servo, motion, repeats=repeats).log
    time = np.arange(rows) * float(axis.servo.period)
    for row in gaps:
        time[row:] += 0.1
    columns = time, np.asarray(found.position)[:rows], np.asarray(found.input)[:rows]
    header = "time_s,position_m,input"
    np.savetxt(folder / "log.csv", np.stack(columns, 1), "%.10g", ",", header=header, comments="")
