"""What a search solves (16): minimise a function of a motion, under limits and via points."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._types import Scalar
from jaxid.motion.limits import Boundary, Limits
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.motion.violation import Prediction, axis_violations, violations, worst_violation

Objective = Callable[[JerkTrajectory, Scalar], Scalar]
Report = Callable[[str], None]
Show = Callable[[JerkTrajectory], None]
_MERIT_PENALTY = 100.0  # as hard as the walls of the last stage of a descent
Multipliers = tuple[Float[Array, "..."], ...]


class Design(NamedTuple):
    """A motion that keeps every limit exactly, and how it was found.

    Attributes:
        trajectory: the motion.
        value: of the objective, not smoothed: the log of an error for the criteria of `jaxid`.
        history: of a search, the best objective after each descent; of an improvement, the value at
            the start and after each stage that improved it.
    """

    trajectory: JerkTrajectory
    value: float
    history: tuple[float, ...]


class Problem(eqx.Module):
    """An objective with its conditions, as an augmented Lagrangian sees them.

    Attributes:
        objective: of a trajectory and a smoothing.
        limits: c ≤ 0 for each entry of `violations`, in half-widths.
        boundary: its inequalities count as well; its equalities are built into the motions.
        axis: what the axis does along a motion, if the limits are to hold for it too.
    """

    objective: Objective
    limits: Limits
    boundary: Boundary
    axis: Prediction | None = None

    @classmethod
    def of(cls, task: Task, objective: Objective) -> "Problem":
        """A task with something to minimise."""
        return cls(objective, task.limits, task.boundary, task.axis)

    def violations(self, trajectory: JerkTrajectory) -> Multipliers:
        """How far each condition is exceeded, in half-widths."""
        planned = violations(self.limits, self.boundary, trajectory)
        if self.axis is None:
            return planned
        return (*planned, *axis_violations(self.limits, self.axis(trajectory)))

    @eqx.filter_jit
    def violation(self, trajectory: JerkTrajectory) -> Scalar:
        """The largest, in half-widths: of the motion at all times, of the axis tick by tick."""
        worst = worst_violation(self.limits, self.boundary, trajectory)
        if self.axis is not None:
            sides = axis_violations(self.limits, self.axis(trajectory))
            worst = jnp.maximum(worst, jnp.max(jnp.stack([jnp.max(side) for side in sides])))
        return worst

    @eqx.filter_jit
    def value(self, trajectory: JerkTrajectory) -> Scalar:
        """The objective itself, its corners not rounded; inf where undefined."""
        return jnp.nan_to_num(self.objective(trajectory, jnp.zeros(())), nan=jnp.inf)

    def pushed(
        self, trajectory: JerkTrajectory, multipliers: Multipliers, penalty: Scalar
    ) -> Multipliers:
        """max(0, λ + ρc) for each condition c ≤ 0 (Rockafellar 1973)."""
        c = self.violations(trajectory)
        return jax.tree.map(lambda m, c: jnp.maximum(0.0, m + penalty * c), multipliers, c)

    def lagrangian(
        self,
        trajectory: JerkTrajectory,
        multipliers: Multipliers,
        penalty: Scalar,
        smoothing: Scalar,
    ) -> Scalar:
        """The objective and the walls; without multipliers a plain quadratic penalty."""
        pushed = self.pushed(trajectory, multipliers, penalty)
        walls = sum(jnp.sum(x**2) for x in pushed) / (2 * penalty)
        return self.objective(trajectory, smoothing) + walls

    def merit(self, trajectory: JerkTrajectory, smoothing: float) -> Scalar:
        """What motions are compared by that need not keep the limits yet; inf where undefined."""
        nothing = jax.tree.map(jnp.zeros_like, self.violations(trajectory))
        penalty, smooth = jnp.asarray(_MERIT_PENALTY), jnp.asarray(smoothing)
        value = self.lagrangian(trajectory, nothing, penalty, smooth)
        return jnp.nan_to_num(value, nan=jnp.inf)
