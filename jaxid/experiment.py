"""The method of the paper in one place: design a motion, run it, identify from what it left."""

from typing import NamedTuple

from jaxtyping import PRNGKeyArray

from jaxid.bound import Norm, individual, require_informative
from jaxid.checks import require_float64
from jaxid.control import Controller
from jaxid.design import Design, Effort, Report, Show, design
from jaxid.estimate import Estimate, least_squares_estimate
from jaxid.filters import filtered
from jaxid.log import Log
from jaxid.objective import PlannedError
from jaxid.problem import Task
from jaxid.record import Record
from jaxid.sensing import Encoder, Sensor
from jaxid.simulate import Plant, Signals, simulate
from jaxid.system import System
from jaxid.trajectory import JerkTrajectory, reference, ticks


class Outcome(NamedTuple):
    """A closed-loop experiment: what happened and what follows for the parameters."""

    record: Record
    signals: Signals
    estimate: Estimate


def design_motion(
    system: System,
    task: Task,
    target: str | Norm,
    key: PRNGKeyArray,
    *,
    shorter: JerkTrajectory | None = None,
    effort: Effort = Effort(),
    report: Report = lambda message: None,
    show: Show = lambda trajectory: None,
) -> Design:
    """(16): the motion within the limits whose worst-case least-squares error is smallest.

    Args:
        system: the axis, its prior box and its disturbance bound.
        task: what the desired motion must do.
        target: the name of one parameter, or a norm.
        key: for the random starts.
        shorter: a good motion with fewer intervals, to start half of the search from.
        effort: how long to search.
        report: told what goes on.
        show: handed the best admissible motion after each descent, and each polished one.
    """
    require_float64("system", system)
    require_float64("limits", task.limits)
    norm = (
        individual(system.index(target), len(system.names)) if isinstance(target, str) else target
    )
    speed = abs(task.limits.velocity).max()
    coarse, fine = (PlannedError(system, norm, speed, nodes) for nodes in (5, 64))
    return design(
        coarse, task, key, fine=fine, shorter=shorter, effort=effort, report=report, show=show
    )


def run(
    plant: Plant,
    controller: Controller,
    sensor: Sensor,
    trajectory: JerkTrajectory,
    period: float,
    repeats: int = 1,
) -> tuple[Record, Signals]:
    """Track a motion, repeated back to back, with a controller of the given period (s)."""
    desired = reference(trajectory, period, ticks(trajectory, period), repeats)
    return simulate(plant, controller, sensor, desired, period)


def log_of(signals: Signals, encoder: Encoder, period: float) -> Log:
    """What the servo would have kept of a simulated experiment."""
    n = signals.input.size
    read = encoder.quantise(signals.position[:: (signals.position.size - 1) // n])
    return Log(signals.input, read, period, encoder.resolution)


def identify(record: Record, system: System, bandwidth: float, period: float) -> Estimate:
    """(28)-(29): filter the record with H_f and estimate by least squares.

    Args:
        record: with exact rows for the bound to hold.
        system: for its prior box.
        bandwidth: w of H_f in rad/s.
        period: of the record's ticks, s.
    """
    require_float64("record", record)
    passed = filtered(record, bandwidth, period)
    require_informative(passed.rows, system.names, system.half_widths)
    return least_squares_estimate(passed, system)
