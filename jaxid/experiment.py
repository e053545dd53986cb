"""The method of the paper in one place: design a motion, run it, identify from what it left."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
from jaxtyping import Array, Float, PRNGKeyArray

from jaxid.admissible import inside
from jaxid.bound import Norm, individual, infinity, require_informative
from jaxid.checks import require_float64
from jaxid.control import Controller
from jaxid.design import Design, Effort, Report, Show, design
from jaxid.estimate import Estimate, least_squares_estimate
from jaxid.filters import filtered
from jaxid.foresight import Servo
from jaxid.guaranteed_error import GuaranteedError, expected_error, require_targets
from jaxid.log import Log
from jaxid.objective import PlannedError
from jaxid.polish import polish
from jaxid.problem import Task
from jaxid.record import Record
from jaxid.sensing import Encoder, Sensor
from jaxid.simulate import Plant, Signals, simulate
from jaxid.system import System
from jaxid.trajectory import JerkTrajectory, reference, ticks

# of the guaranteed error: the large ones move a motion into another order of its dwells, the small
# ones see what an instant at the threshold of δ is worth. Without the first the motor's M ends half
# a per cent higher, without the last a third of one.
SMOOTHINGS = (1e-3, 3e-4, 1e-4, 3e-5)
STEPS = 25  # linear programs, at most, for each of them
# In 40 % of the searches for the motor's start the order of the dwells is one that ends 0.8 % above
# the others, so that four of them fail together in 3 % of the cases.
STARTS = 4


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


def design_guaranteed(
    system: System,
    task: Task,
    targets: Float[Array, " m"],
    start: PRNGKeyArray | JerkTrajectory,
    servo: Servo,
    *,
    largest: bool = True,
    starts: int = STARTS,
    effort: Effort = Effort(),
    steps: int = STEPS,
    report: Report = lambda message: None,
) -> JerkTrajectory:
    """The motion whose log can be expected to guarantee most: the largest error over its target.

    A search for it from random motions hardly ever succeeds; the best motions for least squares,
    with the same targets, are good starts. In which order they dwell is what the polish that
    follows cannot change: of several starts the one is kept that a first polish makes the best.

    Args:
        system: the axis, its prior box and its disturbance bound.
        task: what the desired motion must do.
        targets: what each parameter's guaranteed error is compared with; inf leaves one out.
        start: an admissible motion, or a key to search for several.
        servo: the period and the encoder of the log; with its controller, the motion that counts is
            that of the closed loop.
        largest: of the relative errors counts; or else their sum.
        starts: searches for a start.
        effort: of each of them.
        steps: linear programs, at most, at each of four smoothings.
        report: told what goes on.
    """
    require_float64("system", system)
    require_targets(system, targets)
    speed = abs(task.limits.velocity).max()

    def expected(motion: JerkTrajectory) -> GuaranteedError:
        return expected_error(system, targets, motion, servo, speed, largest=largest)

    def polished(motion: JerkTrajectory, smoothings: Sequence[float]) -> JerkTrajectory:
        problem = task.problem(expected(motion))
        deep = inside(problem, task.intervals, task.period)
        return polish(problem, deep, motion, steps, smoothings)

    if isinstance(start, JerkTrajectory):
        return polished(start, SMOOTHINGS)
    found = []
    for k, key in enumerate(jax.random.split(start, starts), start=1):
        report(f"search {k} of {starts} for a start")
        norm = infinity(targets)
        motion = design_motion(system, task, norm, key, effort=effort).trajectory
        motion = polished(motion, SMOOTHINGS[:1])
        found.append((float(task.problem(expected(motion)).value(motion)), k, motion))
    report("polish of the best")
    return polished(min(found)[-1], SMOOTHINGS[1:])


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
