"""What a design minimises: scalar functions of a motion and of how far kinks are smoothed.

Each is the log of a worst-case least-squares error J, on the desired motion itself (16), on what a
filter leaves of it, or on what the closed loop makes of it (29).
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._types import Scalar, as_array
from jaxid.loop.closed_loop import ClosedLoop
from jaxid.loop.record import Record, rows_of
from jaxid.loop.scenarios import Scenarios
from jaxid.loop.simulate import Plant
from jaxid.model.system import System, smoothed
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory, ticks_of
from jaxid.regression.filters import filtered
from jaxid.regression.worst_case import (
    Norm,
    individual,
    least_squares,
    smooth_worst_case_error,
)
from jaxid.search.problem import Objective

RecordCriterion = Callable[[Record, Scalar], Scalar]


class Criterion(eqx.Module):
    """What a design minimises, where one function of the motion is not enough: for subclasses.

    A criterion that is a function of trajectory and smoothing needs no class.
    """

    @abc.abstractmethod
    def near(self, task: Task, motion: JerkTrajectory) -> Objective:
        """The objective for motions near to one: of a trajectory and a smoothing, of order one."""

    def coarse(self, task: Task, motion: JerkTrajectory) -> Objective:
        """A cheaper objective, for the search among random motions; `motion` is any admissible one.

        Default the same as `near`.
        """
        return self.near(task, motion)


class LeastSquaresError(Criterion):
    """J of (16): the worst-case error of least squares on the desired motion itself.

    Attributes:
        system: with its prior box, regressors and δ.
        target: the name of one parameter, or a norm of the error of all of them.

    Example:
        >>> criterion = jd.LeastSquaresError(slide, "m")
    """

    system: System
    target: str | Norm

    def near(self, task: Task, motion: JerkTrajectory) -> "PlannedError":
        return self._planned(task, 64)

    def coarse(self, task: Task, motion: JerkTrajectory) -> "PlannedError":
        return self._planned(task, 5)

    def _planned(self, task: Task, nodes: int) -> "PlannedError":
        system, norm = self.system, self.target
        if isinstance(norm, str):
            norm = individual(system.index(norm), len(system.names))
        return PlannedError(system, norm, abs(task.limits.velocity).max(), nodes)


class PlannedError(eqx.Module):
    """log J of (16): the worst-case least-squares error on the desired motion itself.

    Attributes:
        system: with its δ and regressors.
        norm: which error counts.
        speed: m/s or rad/s, over which jumps are spread at smoothing 1 (the speed limit).
        nodes: of the midpoint rule, per interval of the motion.
    """

    system: System
    norm: Norm
    speed: Scalar = eqx.field(converter=as_array("speed"))
    nodes: int = eqx.field(static=True, default=8)

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """Smooth in the jerk; exact in the limit of no smoothing and many nodes.

        Jumps are also spread over the speed that changes from one node to the next, so that the sum
        sees when they are crossed and not only between which nodes.
        """
        states, weights = trajectory.midpoints(self.nodes)
        step = jnp.abs(states.acceleration) * weights / 2
        rows = rows_of(smoothed(self.system, smoothing * self.speed + step), states, weights)
        errors = smooth_worst_case_error(least_squares(rows, self.norm), rows, 2 * smoothing)
        return jnp.log(jnp.max(errors))


class FilteredError(eqx.Module):
    """log J_f of (29), a criterion on records: the worst-case error after H_f.

    Attributes:
        norm: which error counts.
        bandwidth: w of H_f in rad/s.
        period: of the record's ticks, s.
    """

    norm: Norm
    bandwidth: Scalar = eqx.field(converter=as_array("bandwidth"))
    period: Scalar = eqx.field(converter=as_array("period"))

    def __call__(self, record: Record, smoothing: Scalar) -> Scalar:
        """Its corners rounded by twice the smoothing, as those of `PlannedError`."""
        rows = filtered(record, self.bandwidth, self.period).rows
        errors = smooth_worst_case_error(least_squares(rows, self.norm), rows, 2 * smoothing)
        return jnp.log(jnp.max(errors))


class PerfectTracking(eqx.Module):
    """A criterion on the record of an axis that follows its reference exactly.

    Attributes:
        system: with its δ and regressors.
        criterion: of the record.
        speed: over which jumps are spread at smoothing 1, m/s or rad/s.
        period: of the record's ticks, s.
        ticks: of the longest motion.
        repeats: how many times it is run, back to back, from rest.
    """

    system: System
    criterion: RecordCriterion
    speed: Scalar = eqx.field(converter=as_array("speed"))
    period: Scalar = eqx.field(converter=as_array("period"))
    ticks: int = eqx.field(static=True)
    repeats: int = eqx.field(static=True, default=1)

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """The motion half-way through each tick stands for the tick: no input, no disturbance."""
        states = trajectory.states((jnp.arange(self.ticks) + 0.5) * self.period)
        step = jnp.abs(states.acceleration) * self.period / 2
        measure = jnp.full(self.ticks, self.period)
        rows = rows_of(smoothed(self.system, smoothing * self.speed + step), states, measure)
        ticks = ticks_of(trajectory, self.period, self.ticks, self.repeats)
        rows = jax.tree.map(ticks.repeated, rows)
        record = Record(rows, jnp.zeros_like(rows.delta), None).only(ticks.counted)
        return self.criterion(record, smoothing)


class ThroughLoop(eqx.Module):
    """A criterion on the records that the closed loop leaves, over several plants.

    Any scalar function of a Record will do as the criterion. It is differentiated through filter,
    plant, controller and sensor.

    Attributes:
        loop: controller and sensor; an `IdealSensor`, since steps of an encoder have no slope.
        scenarios: the plants; one is enough for the nominal case.
        criterion: of each record; the log of an error.
        speed: over which jumps are spread at smoothing 1, m/s or rad/s.
        blend: over which they are spread at any smoothing but zero, m/s or rad/s: about the change
            of speed in one tick, so that the slope sees a jump before a tick has crossed it.
        worst: over the scenarios, or their mean.
    """

    loop: ClosedLoop
    scenarios: Scenarios
    criterion: RecordCriterion
    speed: Scalar = eqx.field(converter=as_array("speed"))
    blend: Scalar = eqx.field(converter=as_array("blend"))
    worst: bool = eqx.field(static=True, default=True)

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """The worst, rounded by half the smoothing and never below the exact one, or the mean."""
        values = self.each(trajectory, smoothing)
        if not self.worst:
            return jnp.mean(values)
        corner = jnp.where(smoothing > 0, smoothing / 2, 1.0)
        rounded = corner * jax.scipy.special.logsumexp(values / corner)
        return jnp.where(smoothing > 0, rounded, jnp.max(values))

    def each(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Float[Array, " k"]:
        """The criterion for every plant."""
        blend = smoothing * self.speed + jnp.where(smoothing > 0, self.blend, 0.0)
        loop, scenarios = smoothed((self.loop, self.scenarios), blend)

        def one(plant: Plant) -> Scalar:
            return self.criterion(loop(plant, trajectory)[0], smoothing)

        return scenarios.map(one)
