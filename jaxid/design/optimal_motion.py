"""Motions to identify an axis by: for least squares (16), and for what their log can prove."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxid._checks import require, require_float64
from jaxid._types import Scalar
from jaxid.design.criteria import PlannedError
from jaxid.design.guaranteed_criterion import GuaranteedError, expected_error, require_targets
from jaxid.design.nominal_log import nominal_log_model
from jaxid.loop.servo import Servo
from jaxid.model.system import System
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory, trimmed
from jaxid.regression.worst_case import Norm, individual, infinity
from jaxid.search.multistart import Design, Effort, Report, Show, design
from jaxid.search.problem import Problem
from jaxid.search.restoration import interior_motion, restored
from jaxid.search.slp import polish

_MET = 1e-9  # half-widths: far more than rounding leaves, and than any stop would notice


class GuaranteedEffort(NamedTuple):
    """How long to search for a motion by what its log can prove.

    Attributes:
        starts: searches for a start. In 40 % of those for the motor the order of the dwells is one
            that ends 0.8 % above the others, so that four of them fail together in 3 % of cases.
        search: the effort of each.
        smoothings: of the guaranteed error in its polish: the large ones move a motion into another
            order of its dwells, the small ones see what an instant at the threshold of δ is worth.
            Without the first the motor's M ends half a per cent higher, without the last a third.
        steps: linear programs, at most, for each smoothing.
    """

    starts: int = 4
    search: Effort = Effort()
    smoothings: tuple[float, ...] = (1e-3, 3e-4, 1e-4, 3e-5)
    steps: int = 25


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
    targets: Sequence[float] | Float[Array, " m"],
    start: PRNGKeyArray | JerkTrajectory,
    servo: Servo,
    *,
    largest: bool = True,
    effort: GuaranteedEffort = GuaranteedEffort(),
    report: Report = lambda message: None,
) -> JerkTrajectory:
    """The motion whose log can be expected to prove most: the largest error over its target.

    A search for it from random motions hardly ever succeeds; the best motions for least squares,
    with the same targets, are good starts. In which order they dwell is what the polish that
    follows cannot change: of several starts the one is kept that a first polish makes the best.

    Args:
        system: the axis, its prior box and its disturbance bound.
        task: what the desired motion must do.
        targets: what each parameter's error is compared with, in its unit; inf leaves one out.
        start: a motion as long as the task's, walked back into the limits where it leaves them and
            never made worse by what is searched for; or a key to search for several.
        servo: what keeps the log, and how far the velocity may be off the motion's where δ jumps;
            with its controller, the motion that counts is that of the closed loop.
        largest: of the relative errors counts; or else their sum, so that 1/targets are weights.
        effort: how long to search.
        report: told what goes on.

    Raises:
        InfeasibleError: if no motion of this length keeps the limits.
        ValueError: if an argument cannot be, in a sentence that names it.
    """
    require_float64("system", system)
    require_float64("limits", task.limits)
    goals = jnp.asarray(targets, dtype=float)
    require_targets(system, goals)
    bare = Problem.of(task, _nothing)
    deep = interior_motion(bare, task.intervals, task.period)
    nominal_log_model(system, deep, servo)  # refuses a servo that no log can be kept with
    search = _Search(system, task, deep, goals, servo, largest, effort, report)
    if isinstance(start, JerkTrajectory):
        given = restored(bare, deep, _matching(task, start))
        return search.better(given, search.polished(given, effort.smoothings))
    return search.from_key(start)


class _Search(NamedTuple):
    """What stays the same from motion to motion; `deep` is one with room to all limits."""

    system: System
    task: Task
    deep: JerkTrajectory
    targets: Float[Array, " m"]
    servo: Servo
    largest: bool
    effort: GuaranteedEffort
    report: Report

    def from_key(self, key: PRNGKeyArray) -> JerkTrajectory:
        """The best of several searches."""
        count, first, norm = self.effort.starts, self.effort.smoothings[:1], infinity(self.targets)
        require(count >= 1, f"Argument `starts` of an effort must be 1 or more, but is {count}.")
        found = []
        for k, own in enumerate(jax.random.split(key, count), start=1):
            label = f"search {k} of {count}"
            motion = design_motion(
                self.system,
                self.task,
                norm,
                own,
                effort=self.effort.search,
                report=lambda words, label=label: self.report(f"{label}: {words}"),
            ).trajectory
            self.report(f"{label}: guaranteed errors")
            motion = self.polished(motion, first)
            found.append((self.value(motion), k, motion))
        self.report("polish of the best")
        best = min(found)[-1]
        return self.better(best, self.polished(best, self.effort.smoothings[1:]))

    def polished(self, motion: JerkTrajectory, smoothings: Sequence[float]) -> JerkTrajectory:
        """For the errors that motions near this one can be expected to guarantee."""
        return polish(self.problem(motion), self.deep, motion, self.effort.steps, smoothings)

    def better(self, one: JerkTrajectory, other: JerkTrajectory) -> JerkTrajectory:
        """Each by the log that it foresees itself."""
        return other if self.value(other) <= self.value(one) else one

    def value(self, motion: JerkTrajectory) -> float:
        """By the log that the motion foresees itself."""
        return float(self.problem(motion).value(motion))

    def problem(self, motion: JerkTrajectory) -> Problem:
        """For motions near to one."""
        speed = abs(self.task.limits.velocity).max()
        objective: GuaranteedError = expected_error(
            self.system, self.targets, motion, self.servo, speed, largest=self.largest
        )
        return Problem.of(self.task, objective)


def _matching(task: Task, start: JerkTrajectory) -> JerkTrajectory:
    """The start without padding.

    Raises:
        ValueError: if it does not have the intervals of the task, or misses a state that is fixed.
    """
    motion = trimmed(start)
    alike = motion.jerk.size == task.intervals
    alike = alike and bool(jnp.allclose(motion.durations, task.period, rtol=1e-9, atol=0.0))
    require(
        alike,
        f"Argument `start` must have {task.intervals} intervals of {task.period:g} s like the "
        f"task, but has {motion.jerk.size} that last {float(motion.duration):g} s together.",
    )
    require(
        jnp.array_equal(motion.start, task.boundary.start),
        f"Argument `start` must begin in the state {task.boundary.start.tolist()} of the boundary, "
        f"but begins in {motion.start.tolist()}.",
    )
    missed = _missed(task, motion)
    require(
        missed <= _MET,
        "Argument `start` must meet the fixed states of the boundary, but misses one by "
        f"{missed:.2g} half-widths of the limits.",
    )
    return motion


def _missed(task: Task, motion: JerkTrajectory) -> float:
    """By how much of the limits' half-widths a state that is fixed is not met."""
    low, high = task.limits.motion.T
    worst = 0.0
    for via in task.boundary.vias:
        state = jnp.concatenate(motion.states(via.at * motion.duration[None]))
        off = jnp.abs(state - via.lower) / ((high - low) / 2)
        worst = max(worst, float(jnp.max(jnp.where(via.lower == via.upper, off, 0.0))))
    return worst


def _nothing(trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
    """To minimise, where only the limits are asked for."""
    return jnp.zeros(())
