"""The optimisation problem (16): minimise a function of a motion under limits and via points."""

import abc
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import is_concrete
from jaxid._types import Scalar
from jaxid.motion.limits import Boundary, Limits
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.motion.violation import Prediction, axis_violations, violations, worst_violation

Objective = Callable[[JerkTrajectory, Scalar], Scalar]
Show = Callable[[JerkTrajectory], None]
_MERIT_PENALTY = 100.0  # that of the last stage of a descent
Multipliers = tuple[Float[Array, "..."], ...]


class StagedObjective(eqx.Module):
    """Base class of objectives that need a program outside JAX, such as a linear program.

    Traced, `__call__` needs a callback, and JAX does not keep a compiled function with a callback
    in its compilation cache. `value_and_slope` needs none: it works in stages, each compiled.
    """

    @abc.abstractmethod
    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """Return the objective, differentiable by JAX.

        Args:
            trajectory: motion.
            smoothing: smoothing parameter; 0 for the exact value.
        """

    @abc.abstractmethod
    def value_and_slope(
        self, trajectory: JerkTrajectory, smoothing: Scalar
    ) -> tuple[Scalar, Float[Array, " n"]]:
        """Return the same value, and its gradient by the jerk of a motion that is not traced.

        Args:
            trajectory: motion.
            smoothing: smoothing parameter; 0 for the exact value.
        """


class Design(NamedTuple):
    """A motion that keeps every limit exactly, with its objective and the history of the search.

    Attributes:
        trajectory: motion.
        value: objective without smoothing; for the criteria of `jaxid` the log of an error.
        history: best objective after each descent of a search; for an improvement, the value at
            the start and after each stage that improved it.
    """

    trajectory: JerkTrajectory
    value: float
    history: tuple[float, ...]


class Problem(eqx.Module):
    """An objective of a motion with its constraints, for an augmented Lagrangian.

    Attributes:
        objective: function of a trajectory and a smoothing parameter.
        limits: limits of the motion; each entry of `violations` is a constraint c ≤ 0.
        boundary: start, end and via points; its inequalities are constraints too, its equalities
            must be met by the coordinates of the motions.
        axis: prediction of the axis, if the limits are to hold for the axis too.
    """

    objective: Objective
    limits: Limits
    boundary: Boundary
    axis: Prediction | None = None

    @classmethod
    def of(cls, task: Task, objective: Objective) -> "Problem":
        """Return the problem of minimising an objective under the conditions of a task."""
        return cls(objective, task.limits, task.boundary, task.axis)

    def violations(self, trajectory: JerkTrajectory) -> Multipliers:
        """Return by how much a motion exceeds each constraint, in half-widths of the limit.

        The arrays are those of `jaxid.motion.violation.violations`, then those of the axis.
        """
        planned = violations(self.limits, self.boundary, trajectory)
        if self.axis is None:
            return planned
        return (*planned, *axis_violations(self.limits, self.axis(trajectory)))

    def violation(self, trajectory: JerkTrajectory) -> Scalar:
        """Return the largest violation of any limit, in half-widths; ≤ 0 if all limits are kept.

        The motion is checked over all of time, the axis once per sample.
        """
        worst = worst_violation(self.limits, self.boundary, trajectory)
        if self.axis is None:
            return worst
        return jnp.maximum(worst, _worst_of_axis(self.limits, self.axis, trajectory))

    def value(self, trajectory: JerkTrajectory) -> Scalar:
        """Return the objective of a motion without smoothing; inf where it is NaN."""
        if isinstance(self.objective, StagedObjective) and is_concrete(trajectory):
            found = self.objective.value_and_slope(trajectory, jnp.zeros(()))[0]
        else:
            found = _exact(self.objective, trajectory)
        return jnp.nan_to_num(found, nan=jnp.inf)

    def value_and_slope(
        self, trajectory: JerkTrajectory, smoothing: float
    ) -> tuple[Scalar, Float[Array, " n"]]:
        """Return the objective of a motion, and its gradient by the jerk, shape (n,).

        Args:
            trajectory: motion, not traced.
            smoothing: smoothing parameter; 0 for the exact value.
        """
        # with a type of its own, as in `value`: a weak type would be compiled once more
        smooth = jnp.asarray(smoothing, float)
        if isinstance(self.objective, StagedObjective):
            return self.objective.value_and_slope(trajectory, smooth)
        return _value_and_slope(self.objective, trajectory, smooth)

    def pushed(
        self, trajectory: JerkTrajectory, multipliers: Multipliers, penalty: Scalar
    ) -> Multipliers:
        """Return the updated multipliers max(0, λ + ρc) of the constraints c ≤ 0.

        This is the update of the augmented Lagrangian method (Rockafellar 1973).

        Args:
            trajectory: motion that gives c.
            multipliers: multipliers λ, shaped like `violations`.
            penalty: penalty ρ.
        """
        c = self.violations(trajectory)
        return jax.tree.map(lambda m, c: jnp.maximum(0.0, m + penalty * c), multipliers, c)

    def lagrangian(
        self,
        trajectory: JerkTrajectory,
        multipliers: Multipliers,
        penalty: Scalar,
        smoothing: Scalar,
    ) -> Scalar:
        """Return the augmented Lagrangian of a motion.

        With multipliers of zero, it is the objective plus a quadratic penalty of the violations.

        Args:
            trajectory: motion.
            multipliers: multipliers λ, shaped like `violations`.
            penalty: penalty ρ of a squared violation in half-widths.
            smoothing: smoothing parameter of the objective.
        """
        pushed = self.pushed(trajectory, multipliers, penalty)
        walls = sum(jnp.sum(x**2) for x in pushed) / (2 * penalty)
        return self.objective(trajectory, smoothing) + walls

    def merit(self, trajectory: JerkTrajectory, smoothing: float) -> Scalar:
        """Return the objective of a motion plus a penalty of its violations; inf where it is NaN.

        It compares motions that need not keep the limits. The penalty is 50 times the sum of the
        squared violations, in half-widths.

        Args:
            trajectory: motion.
            smoothing: smoothing parameter of the objective.
        """
        nothing = jax.tree.map(jnp.zeros_like, self.violations(trajectory))
        penalty, smooth = jnp.asarray(_MERIT_PENALTY), jnp.asarray(smoothing)
        value = self.lagrangian(trajectory, nothing, penalty, smooth)
        return jnp.nan_to_num(value, nan=jnp.inf)


@eqx.filter_jit
def _worst_of_axis(limits: Limits, axis: Prediction, trajectory: JerkTrajectory) -> Scalar:
    """Return the largest violation of the limits by the axis, in half-widths.

    It is compiled without the objective, which it does not need: once for all objectives.
    """
    sides = axis_violations(limits, axis(trajectory))
    return jnp.max(jnp.stack([jnp.max(side) for side in sides]))


@eqx.filter_jit
def _exact(objective: Objective, trajectory: JerkTrajectory) -> Scalar:
    return objective(trajectory, jnp.zeros(()))


@eqx.filter_jit
def _value_and_slope(
    objective: Objective, trajectory: JerkTrajectory, smoothing: Scalar
) -> tuple[Scalar, Float[Array, " n"]]:
    def value(jerk: Float[Array, " n"]) -> Scalar:
        return objective(eqx.tree_at(lambda t: t.jerk, trajectory, jerk), smoothing)

    return jax.value_and_grad(value)(trajectory.jerk)
