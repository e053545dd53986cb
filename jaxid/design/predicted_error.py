"""The predicted guaranteed error of a motion as an objective, with encoder and servo.

The weights are the best ones for the predicted log of the motion, found by linear programs outside
JAX. By the envelope theorem, the gradient of the least error is that of its Lagrangian with weights
and multipliers held fixed, so that neither needs a derivative.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require, require_at_least_zero, require_float64
from jaxid._types import Scalar, as_array
from jaxid.design.criteria import Criterion, LeastSquaresError
from jaxid.design.nominal_log import (
    NominalLog,
    States,
    modelled,
    nominal_log,
    nominal_log_model,
)
from jaxid.identification.intervals import guaranteed_intervals, narrowed
from jaxid.identification.modulating_functions import optimal, pieces
from jaxid.identification.regression_rows import RegressionRows, hats
from jaxid.identification.state_bounds import StateBounds, state_bounds
from jaxid.loop.controllers import Controller
from jaxid.loop.log import Log
from jaxid.loop.servo import Servo
from jaxid.model.disturbance_bound import DisturbanceBound, NearbyVelocityBound
from jaxid.model.system import System, smoothed
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.worst_case import affine_worst_case_error, bias, infinity
from jaxid.search.problem import StagedObjective

# smoothing of the maximum over parameters, in units of the smoothing of jumps; with less of it, a
# refinement would stall where the errors of two parameters are equal
_CORNER = 30.0


Weights = tuple[Float[Array, "m rows"], Float[Array, "m m"]]


class PredictedErrorNear(StagedObjective):
    """The log of the largest predicted guaranteed error, relative to the target of each parameter.

    Attributes:
        system: axis with its prior box and disturbance bound δ.
        narrow: system with the box that the log is predicted to leave, for the bounds of its
            states.
        log_model: predicted log as a function of the motion.
        targets: targets of the m parameters, in their units; inf leaves a parameter out.
        speed: speed over which jumps are spread at smoothing 1, m/s or rad/s.
        largest: True, the default, for the largest relative error, False for their sum, in which
            1/targets are weights.
        knots: largest number of weights of the modulating functions.
        row_bound: disturbance bound δ of the rows; None, the default, for that of the system. With
            a `NearbyVelocityBound` no jump of δ is exploited. The bounds of the states use the δ of
            the system: they hardly depend on it, and need not be compiled for another one.

    Raises:
        ValueError: if the targets are not m positive numbers, at least one of them finite.
    """

    system: System
    narrow: System
    log_model: NominalLog
    targets: Float[Array, " m"] = eqx.field(converter=as_array("targets"))
    speed: Scalar = eqx.field(converter=as_array("speed"))
    largest: bool = eqx.field(static=True, default=True)
    knots: int = eqx.field(static=True, default=150)
    row_bound: DisturbanceBound | None = None

    def __check_init__(self) -> None:
        require_targets(self.system, self.targets)

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """Return the log of the relative error; exact for zero smoothing.

        With smoothing, jumps are spread and the maximum is rounded upwards.
        """
        return self._relative(self.errors(trajectory, smoothing), smoothing)

    def errors(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Float[Array, " m"]:
        """Return the predicted guaranteed error of each parameter, with its gradient, shape (m,).

        For zero smoothing it equals the bound of `guaranteed_intervals` for the predicted log, if
        `narrow` is the box that this log leaves, the rows have the same δ, and the number of
        weights is the same.

        Args:
            trajectory: motion.
            smoothing: smoothing parameter; 0 for the exact value.
        """
        log, states = self.log_model(trajectory)
        bounds = stop_gradient(state_bounds(self.narrow, stop_gradient(log)))
        logged = self._rows(log, states, bounds, smoothing)
        data = stop_gradient(self._program(logged))
        m, n = len(self.system.names), logged.record.rows.delta.size
        shapes = jnp.zeros((m, n)), jnp.zeros((m, m))
        solve = functools.partial(_weights, self.knots)
        weights = jax.pure_callback(solve, shapes, *data, vmap_method="sequential")
        return self._errors(logged, *weights)

    def value_and_slope(
        self, trajectory: JerkTrajectory, smoothing: Scalar
    ) -> tuple[Scalar, Float[Array, " n"]]:
        """Return the same value, and its gradient by the jerk of a motion that is not traced.

        The linear programs run between two compiled functions instead of inside one: a compiled
        function that calls back to Python cannot be kept in a compilation cache.
        """
        log, states = modelled(self.log_model, trajectory)
        bounds = state_bounds(self.narrow, log)
        weights, dual = _weights(self.knots, *_program(self, log, states, bounds, smoothing))
        found = jnp.asarray(weights), jnp.asarray(dual)
        return _value_and_slope(self, trajectory, smoothing, bounds, found)

    def given(
        self, trajectory: JerkTrajectory, smoothing: Scalar, bounds: StateBounds, weights: Weights
    ) -> Scalar:
        """Return the value for given state bounds and weights, as if neither had a gradient.

        Args:
            trajectory: motion.
            smoothing: smoothing parameter; 0 for the exact value.
            bounds: bounds of the states during the predicted log of this motion.
            weights: optimal weights of this log, and the multipliers of their linear programs.
        """
        logged = self._rows(*self.log_model(trajectory), bounds, smoothing)
        return self._relative(self._errors(logged, *weights), smoothing)

    def _relative(self, errors: Float[Array, " m"], smoothing: Scalar) -> Scalar:
        """Return the log of the largest of the relative errors, or of their sum."""
        if not self.largest:
            return jnp.log(jnp.sum(errors / self.targets))
        logs = jnp.log(errors) - jnp.log(self.targets)  # errors / inf = 0: its log has no gradient
        corner = jnp.where(smoothing > 0, _CORNER * smoothing, 1.0)
        rounded = corner * jax.scipy.special.logsumexp(logs / corner)
        return jnp.where(smoothing > 0, rounded, jnp.max(logs))

    def _errors(
        self, logged: RegressionRows, weights: Float[Array, "m n"], dual: Float[Array, "m m"]
    ) -> Float[Array, " m"]:
        """Return the error of each parameter by given weights, with the Lagrangian's gradient."""
        rows, half_widths = logged.record.rows, self.system.half_widths
        slope = (
            jnp.abs(weights) @ rows.delta
            + logged.shared(weights)
            + jnp.sum(dual * bias(weights, rows), axis=1)
        )
        exact = affine_worst_case_error(weights, rows, half_widths) + logged.shared(weights)
        return stop_gradient(exact - slope) + slope

    def _rows(
        self, log: Log, states: States, bounds: StateBounds, smoothing: Scalar
    ) -> RegressionRows:
        """Return the regression rows of the predicted log."""
        # ranges of fixed width whose midpoints have the gradient of the states
        y, v, a = (x + (at - stop_gradient(at)) for x, at in zip(bounds[:3], states, strict=True))
        step = jnp.abs(states.acceleration) * log.period / 2
        blend = jnp.where(smoothing > 0, smoothing * self.speed + step, 0.0)
        bound = self.narrow.disturbance_bound if self.row_bound is None else self.row_bound
        system = smoothed(self.narrow.with_disturbance_bound(bound), blend)
        return hats(system, log, StateBounds(y, v, a, bounds.reading))

    def _program(self, logged: RegressionRows) -> tuple[Array, ...]:
        """Return what the linear programs need: regressors, δ, measure, noise, half-widths."""
        rows, noise = logged.record.rows, logged.channels["quantised ÿ"].bound
        return rows.regressors, rows.delta, rows.measure, noise, self.system.half_widths


def _weights(knots: int, *data: Array) -> tuple[np.ndarray, np.ndarray]:
    """Return the optimal weights, and the multipliers of their linear programs."""
    phi, delta, measure, noise, box = map(np.asarray, data)
    return optimal(phi, delta, noise, box, np.eye(box.size), knots, pieces(measure))


@eqx.filter_jit
def _program(
    error: PredictedErrorNear, log: Log, states: States, bounds: StateBounds, smoothing: Scalar
) -> tuple[Array, ...]:
    return error._program(error._rows(log, states, bounds, smoothing))


@eqx.filter_jit
def _value_and_slope(
    error: PredictedErrorNear,
    trajectory: JerkTrajectory,
    smoothing: Scalar,
    bounds: StateBounds,
    weights: Weights,
) -> tuple[Scalar, Float[Array, " n"]]:
    def value(jerk: Float[Array, " n"]) -> Scalar:
        motion = eqx.tree_at(lambda t: t.jerk, trajectory, jerk)
        return error.given(motion, smoothing, bounds, weights)

    return jax.value_and_grad(value)(trajectory.jerk)


def require_targets(system: System, targets: Float[Array, "..."]) -> None:
    """Raise a ValueError unless the targets are m positive numbers, at least one of them finite.

    Args:
        system: system with m parameters.
        targets: targets of the errors, in the units of the parameters.
    """
    if not is_concrete(targets):
        return
    right = jnp.shape(targets) == (len(system.names),)
    found = np.asarray(targets)
    right = right and bool(np.all(found > 0) & np.any(np.isfinite(found)))
    require(
        right,
        f"Argument `targets` must be {len(system.names)} positive numbers, one per parameter, at "
        f"least one of them finite, but is {jnp.asarray(targets).tolist()}.",
    )


class PredictedError(Criterion):
    """The criterion that is the largest predicted guaranteed error, relative to its target.

    Predicted is the error bound that the log of the motion guarantees on an undisturbed axis at the
    centre of its prior box, with servo, encoder and prior box. The recorded log then determines the
    guaranteed interval.

    Attributes:
        system: axis with its prior box and disturbance bound δ.
        targets: target of the error of each parameter, shape (m,), in their units; inf leaves a
            parameter out.
        servo: sample period and encoder resolution of the log.
        controller: controller of the predicted closed loop; None, the default, for an axis that
            follows the motion exactly.
        velocity_error: velocity error of the axis that is allowed for where δ jumps with the speed,
            m/s or rad/s.
        largest: True, the default, for the largest relative error, False for their sum, in which
            1/targets are weights.

    Raises:
        ValueError: if the targets are not m positive numbers, at least one of them finite, or
            `velocity_error` is below zero.
    """

    system: System
    targets: Float[Array, " m"] = eqx.field(converter=as_array("targets"))
    servo: Servo
    controller: Controller | None = None
    velocity_error: float = 0.0
    largest: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        require_targets(self.system, self.targets)
        require_at_least_zero("velocity_error", "a predicted error", self.velocity_error)

    @property
    def start(self) -> LeastSquaresError:
        """The least-squares criterion whose optimal motions are good starts: same targets."""
        return LeastSquaresError(self.system, infinity(self.targets))

    def near(self, task: Task, motion: JerkTrajectory) -> PredictedErrorNear:
        """Return the predicted error as a function of motions near a given one.

        The box that the log of this motion is predicted to leave is used for the states of nearby
        motions.

        Args:
            task: task whose velocity limit scales the smoothing.
            motion: motion near which the objective is used.
        """
        require_float64(criterion=self, limits=task.limits, motion=motion)
        system, servo = self.system, self.servo
        log = nominal_log(system, motion, servo, self.controller)
        narrow = narrowed(system, guaranteed_intervals(system, [log]).estimate)
        bound = None
        if self.velocity_error:
            bound = NearbyVelocityBound(system.disturbance_bound, self.velocity_error)
        model = nominal_log_model(system, motion, servo, self.controller)
        speed = abs(task.limits.velocity).max()
        return PredictedErrorNear(
            system, narrow, model, self.targets, speed, self.largest, row_bound=bound
        )
