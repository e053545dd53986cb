"""Criteria of a design: scalar functions of a motion and of a smoothing parameter.

Each is the log of a worst-case least-squares error J: on the desired motion itself (16), on the
filtered motion, or on the motion of the closed loop (29).
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid._types import Scalar, as_array
from jaxid.loop.closed_loop import ClosedLoop
from jaxid.loop.record import Record, rows_of
from jaxid.loop.scenarios import Scenarios
from jaxid.loop.simulate import Plant
from jaxid.model.system import System, smoothed
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory, ticks_of
from jaxid.regression.filters import filtered
from jaxid.regression.worst_case import Norm, individual, smooth_least_squares_error
from jaxid.search.problem import Objective

RecordCriterion = Callable[[Record, Scalar], Scalar]


class Criterion(eqx.Module):
    """Base class of criteria that depend on the task, or are built near a given motion.

    A criterion that is a function of trajectory and smoothing parameter needs no class.
    """

    @abc.abstractmethod
    def near(self, task: Task, motion: JerkTrajectory) -> Objective:
        """Return the objective for motions near a given one.

        It is a function of a trajectory and a smoothing parameter, of order one, that JAX can
        differentiate.

        Args:
            task: limits, boundary and duration of the motion.
            motion: motion near which the objective is used.
        """

    def coarse(self, task: Task, motion: JerkTrajectory) -> Objective:
        """Return a cheaper objective for the search from random motions.

        By default it is that of `near(task, motion)`, which may be slow.

        Args:
            task: limits, boundary and duration of the motion.
            motion: any admissible motion.
        """
        return self.near(task, motion)


class LeastSquaresError(Criterion):
    """The criterion log J: the worst-case least-squares error of a motion (Lu and Yao 2010, (16)).

    Attributes:
        system: axis with its prior box, regressors and disturbance bound δ.
        target: name of one parameter, or a norm of the error of all parameters.

    Example:
        >>> criterion = jd.LeastSquaresError(slide, "m")
    """

    system: System
    target: str | Norm

    def __check_init__(self) -> None:
        if isinstance(self.target, str):
            require(
                self.target in self.system.names,
                f"Argument `target` must be one of {', '.join(self.system.names)}, but is "
                f"{self.target!r}.",
            )

    def near(self, task: Task, motion: JerkTrajectory) -> "PlannedError":
        """Return log J as a function of the motion, with 64 nodes per interval.

        Args:
            task: task whose velocity limit scales the smoothing.
            motion: not used.
        """
        return self._planned(task, 64)

    def coarse(self, task: Task, motion: JerkTrajectory) -> "PlannedError":
        """Return log J as a function of the motion, with 5 nodes per interval.

        Args:
            task: task whose velocity limit scales the smoothing.
            motion: not used.
        """
        return self._planned(task, 5)

    def _planned(self, task: Task, nodes: int) -> "PlannedError":
        system, norm = self.system, self.target
        if isinstance(norm, str):
            norm = individual(system.index(norm), len(system.names))
        return PlannedError(system, norm, abs(task.limits.velocity).max(), nodes)


class PlannedError(eqx.Module):
    """The function log J of (16), J being the worst-case least-squares error on a desired motion.

    Attributes:
        system: axis with its regressors and disturbance bound δ.
        norm: norm of the estimation error.
        speed: speed over which jumps are spread at smoothing 1, m/s or rad/s (the speed limit).
        nodes: number of nodes of the midpoint rule per interval of the motion.
    """

    system: System
    norm: Norm
    speed: Scalar = eqx.field(converter=as_array("speed"))
    nodes: int = eqx.field(static=True, default=8)

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """Return log J, smooth in the jerk; exact for zero smoothing and many nodes.

        Jumps are also spread over the change of speed from one node to the next, so that the sum
        depends smoothly on the instant at which they are crossed.
        """
        states, weights = trajectory.midpoints(self.nodes)
        step = jnp.abs(states.acceleration) * weights / 2
        rows = rows_of(smoothed(self.system, smoothing * self.speed + step), states, weights)
        return jnp.log(jnp.max(smooth_least_squares_error(rows, 2 * smoothing, self.norm)))


class FilteredError(eqx.Module):
    """The function log J_f of (29): the log of the worst-case error of a record filtered by H_f.

    Attributes:
        norm: norm of the estimation error.
        bandwidth: bandwidth w of H_f, rad/s.
        period: sample period of the record, s.
    """

    norm: Norm
    bandwidth: Scalar = eqx.field(converter=as_array("bandwidth"))
    period: Scalar = eqx.field(converter=as_array("period"))

    def __call__(self, record: Record, smoothing: Scalar) -> Scalar:
        """Return log J_f of a record, its kinks smoothed as those of `PlannedError`."""
        rows = filtered(record, self.bandwidth, self.period).rows
        return jnp.log(jnp.max(smooth_least_squares_error(rows, 2 * smoothing, self.norm)))


class PerfectTracking(eqx.Module):
    """A criterion of motions: that of the record of an axis which follows its reference exactly.

    Attributes:
        system: axis with its regressors and disturbance bound δ.
        criterion: function of a record and a smoothing parameter.
        speed: speed over which jumps are spread at smoothing 1, m/s or rad/s.
        period: sample period of the record, s.
        ticks: number of samples of the longest motion.
        repeats: number of times that the motion is run, back to back, from rest.
    """

    system: System
    criterion: RecordCriterion
    speed: Scalar = eqx.field(converter=as_array("speed"))
    period: Scalar = eqx.field(converter=as_array("period"))
    ticks: int = eqx.field(static=True)
    repeats: int = eqx.field(static=True, default=1)

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """Return the criterion of a record with the states half-way through each sample period.

        The record has zero input and no disturbance.
        """
        states = trajectory.states((jnp.arange(self.ticks) + 0.5) * self.period)
        step = jnp.abs(states.acceleration) * self.period / 2
        measure = jnp.full(self.ticks, self.period)
        rows = rows_of(smoothed(self.system, smoothing * self.speed + step), states, measure)
        ticks = ticks_of(trajectory, self.period, self.ticks, self.repeats)
        rows = jax.tree.map(ticks.repeated, rows)
        record = Record(rows, jnp.zeros_like(rows.delta), None).only(ticks.counted)
        return self.criterion(record, smoothing)


class ThroughLoop(eqx.Module):
    """A criterion of motions: that of the records of a simulated closed loop, over plants.

    It is differentiated through filter, plant, controller and sensor.

    Attributes:
        loop: closed loop with an `IdealSensor`, since an encoder cannot be differentiated.
        scenarios: plants; one is enough for the nominal case.
        criterion: function of a record and a smoothing parameter; the log of an error.
        speed: speed over which jumps are spread at smoothing 1, m/s or rad/s.
        blend: speed over which jumps are spread at any smoothing but zero, m/s or rad/s: about the
            change of speed in one sample period, so that the gradient is smooth at a jump.
        worst: True, the default, for the largest criterion of all plants, False for their mean.
    """

    loop: ClosedLoop
    scenarios: Scenarios
    criterion: RecordCriterion
    speed: Scalar = eqx.field(converter=as_array("speed"))
    blend: Scalar = eqx.field(converter=as_array("blend"))
    worst: bool = eqx.field(static=True, default=True)

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """Return the largest criterion of all plants, or the mean.

        The largest one is smoothed by half the smoothing parameter, and never below the exact one.
        """
        values = self.each(trajectory, smoothing)
        if not self.worst:
            return jnp.mean(values)
        corner = jnp.where(smoothing > 0, smoothing / 2, 1.0)
        rounded = corner * jax.scipy.special.logsumexp(values / corner)
        return jnp.where(smoothing > 0, rounded, jnp.max(values))

    def each(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Float[Array, " k"]:
        """Return the criterion of the record of every plant, shape (k,).

        Args:
            trajectory: motion.
            smoothing: smoothing parameter; 0 for the exact value.
        """
        blend = smoothing * self.speed + jnp.where(smoothing > 0, self.blend, 0.0)
        loop, scenarios = smoothed((self.loop, self.scenarios), blend)

        def one(plant: Plant) -> Scalar:
            return self.criterion(loop(plant, trajectory)[0], smoothing)

        return scenarios.map(one)
