"""The motion that minimises a criterion under limits: from random motions, or from a given one."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from jaxid._checks import require, require_concrete, require_float64, require_positive
from jaxid._progress import Report, silent, within
from jaxid._types import Scalar
from jaxid.design.criteria import Criterion, LeastSquaresError
from jaxid.design.predicted_error import PredictedError
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory, trimmed
from jaxid.search.effort import Effort
from jaxid.search.local import improve
from jaxid.search.multistart import multistart
from jaxid.search.problem import Design, Objective, Problem, Show
from jaxid.search.restoration import interior_motion, restored
from jaxid.search.slp import refined

_SEARCHED = 0.8  # share of the work that is done when all searches have ended
_NEVER = 1e300  # a search counts a criterion that is not a number as the largest float
_MET = 1e-9  # half-widths: far above rounding errors, and negligible for the axis


def optimal_motion(
    task: Task,
    criterion: Criterion | Objective,
    start: PRNGKeyArray | JerkTrajectory,
    *,
    shorter: JerkTrajectory | None = None,
    effort: Effort = Effort(),
    report: Report = silent,
    show: Show = lambda trajectory: None,
) -> Design:
    """Return the motion within the limits that minimises a criterion, as found by a search.

    From a random key, the search starts from many random motions; from a given motion, it improves
    that one. Random motions hardly ever lead to a good `PredictedError`: for it, the best motions
    for least squares with the same targets are searched first, several times, since the refinement
    that follows cannot change the order in which a motion is fast and slow. The best of them is
    refined.

    Args:
        task: limits, boundary conditions and duration of the motion.
        criterion: a `LeastSquaresError`, a `PredictedError`, your own `Criterion`, or any function
            of a trajectory and a smoothing parameter (0 for the exact value) that JAX can
            differentiate, of order one: take the log of a positive quantity.
        start: JAX random key for a search; or a motion as long as the task's, which is restored to
            the limits where it exceeds them, and never made worse.
        shorter: good motion with fewer intervals, which some starts extend; a search for a
            `PredictedError` does not use it.
        effort: numbers of starts, steps and rounds of the search.
        report: function that is called as each step begins, with its name and the share of the
            work that is done.
        show: function that is called with the best admissible motions during the search.

    Returns:
        `Design(trajectory, value, history)`: the motion, the value of the criterion (a log, for the
        criteria of jaxid), and the values along the search.

    Raises:
        InfeasibleError: if a linear program proves that no motion of this duration keeps the
            limits.
        ValueError: if an argument is invalid; the message names it.

    Example:
        >>> effort = jd.Effort(newton_rounds=0, programs=2)  # a short search, as an example
        >>> better = jd.optimal_motion(task, criterion, motion, effort=effort)
        >>> round(float(jnp.exp(better.value)), 2)  # kg; it was 1.25
        1.12
    """
    _require_sizes(task, effort)
    require_float64(criterion=criterion, limits=task.limits, boundary=task.boundary)
    require_concrete(
        "a search",
        "Trace the criterion of a motion, and minimise that.",
        criterion=criterion,
        limits=task.limits,
        boundary=task.boundary,
        start=start,
    )
    deep = interior_motion(Problem.of(task, _nothing), task.intervals, task.period)
    search = _Search(task, criterion, deep, effort, report, show)
    if not isinstance(criterion, LeastSquaresError | PredictedError):
        search.require_scalar()
    if isinstance(start, JerkTrajectory):
        found = search.from_motion(_matching(task, start))
    elif isinstance(criterion, PredictedError):
        found = search.predicted_from_key(criterion, start)
    else:
        found = search.from_key(start, shorter)
    require(
        found.value < _NEVER,
        "Argument `criterion` is not finite for any motion that the search has found.",
    )
    return found


def _require_sizes(task: Task, effort: Effort) -> None:
    counts = {"intervals": task.intervals, "starts": effort.starts, "finalists": effort.finalists}
    for name, count in counts.items():
        require(
            isinstance(count, int | np.integer) and count >= 1,
            f"Argument `{name}` must be a whole number, 1 or more, but is {count!r}.",
        )
    require_positive("period", "a task", task.period)


class _Search(NamedTuple):
    """The settings of a search; `deep` is a motion with a margin to all limits."""

    task: Task
    criterion: Criterion | Objective
    deep: JerkTrajectory
    effort: Effort
    report: Report
    show: Show

    def require_scalar(self) -> None:
        """Refuse a criterion that does not return one number."""
        shape = eqx.filter_eval_shape(self.near(self.deep), self.deep, jnp.zeros(())).shape
        require(
            shape == (),
            "Argument `criterion` must return one number for each motion, but returns an array of "
            f"shape {shape}.",
        )

    def from_key(self, key: PRNGKeyArray, shorter: JerkTrajectory | None) -> Design:
        """Return the best motion that a search from many random starts finds."""
        criterion, coarse = self.criterion, self.near(self.deep)
        if isinstance(criterion, Criterion):
            coarse = criterion.coarse(self.task, self.deep)
        return multistart(
            self.task,
            coarse,
            self.near(self.deep),
            key,
            shorter=shorter,
            effort=self.effort,
            report=self.report,
            show=self.show,
        )

    def predicted_from_key(self, criterion: PredictedError, key: PRNGKeyArray) -> Design:
        """Return the best of several searches, each from the best motion for least squares."""
        count, smoothings = self.effort.searches, self.effort.predicted_smoothings
        require(count >= 1, f"Argument `searches` of an effort must be 1 or more, but is {count}.")
        criterion.near(self.task, self.deep)  # raises if the servo cannot record a log
        found = []
        for k, own in enumerate(jax.random.split(key, count), start=1):
            first, last = _SEARCHED * (k - 1) / count, _SEARCHED * k / count
            report = within(self.report, first, last, f"search {k} of {count}: ")
            search = self._replace(criterion=criterion.start, report=within(report, 0.0, 0.7))
            motion = search.from_key(own, None).trajectory
            report("predicted errors", 0.7)
            motion = self.refined(motion, smoothings[:1])
            found.append((self.value(motion), k, motion))
        self.report("refinement of the best", _SEARCHED)
        best = min(found)[-1]
        better = self.better(best, self.refined(best, smoothings[1:]))
        return self.design(better, tuple(value for value, _, _ in found))

    def from_motion(self, start: JerkTrajectory) -> Design:
        """Return a motion that is no worse than the given one and keeps all limits."""
        if not isinstance(self.criterion, PredictedError):
            return improve(self.problem(start), start, self.effort, self.report)
        given = restored(self.problem(self.deep), self.deep, start)
        found = self.better(given, self.refined(given, self.effort.predicted_smoothings))
        return self.design(found, (self.value(given),))

    def refined(self, motion: JerkTrajectory, smoothings: tuple[float, ...]) -> JerkTrajectory:
        """Refine a motion by linear programs, for the criterion near it."""
        programs = self.effort.predicted_programs
        return refined(self.problem(motion), self.deep, motion, programs, smoothings)

    def better(self, one: JerkTrajectory, other: JerkTrajectory) -> JerkTrajectory:
        """Return the better of two motions, each by the criterion near it."""
        return other if self.value(other) <= self.value(one) else one

    def design(self, motion: JerkTrajectory, history: tuple[float, ...]) -> Design:
        """Return a motion with its value and history."""
        self.show(motion)
        value = self.value(motion)
        return Design(motion, value, (*history, value))

    def value(self, motion: JerkTrajectory) -> float:
        """Return the value of a motion by the criterion near it, without smoothing."""
        return float(self.problem(motion).value(motion))

    def problem(self, motion: JerkTrajectory) -> Problem:
        """Return the problem for motions near a given one."""
        return Problem.of(self.task, self.near(motion))

    def near(self, motion: JerkTrajectory) -> Objective:
        """Return the objective near a given motion."""
        criterion = self.criterion
        return criterion.near(self.task, motion) if isinstance(criterion, Criterion) else criterion


def _matching(task: Task, start: JerkTrajectory) -> JerkTrajectory:
    """Return the start without padding.

    Raises:
        ValueError: if it does not have the intervals of the task, or misses a fixed state.
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
    """Return by how much a motion misses a fixed state, in half-widths of the limits."""
    low, high = task.limits.motion.T
    worst = 0.0
    for via in task.boundary.vias:
        state = jnp.concatenate(motion.states(via.at * motion.duration[None]))
        off = jnp.abs(state - via.lower) / ((high - low) / 2)
        worst = max(worst, float(jnp.max(jnp.where(via.lower == via.upper, off, 0.0))))
    return worst


def _nothing(trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
    """Return zero, the objective where only the limits matter."""
    return jnp.zeros(())
