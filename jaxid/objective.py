"""What a design minimises: scalar functions of a motion and of how far corners are rounded."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid.bound import (
    Norm,
    least_squares,
    smooth_worst_case_error,
    worst_case_error,
)
from jaxid.record import rows_of
from jaxid.system import Scalar, System, softened
from jaxid.trajectory import JerkTrajectory


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
    speed: Scalar = eqx.field(converter=jnp.asarray)
    nodes: int = eqx.field(static=True, default=8)

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """Smooth in the jerk; exact in the limit of no smoothing and many nodes.

        Jumps are also spread over the speed that changes from one node to the next, so that the sum
        sees when they are crossed and not only between which nodes.
        """
        states, weights = trajectory.midpoints(self.nodes)
        step = jnp.abs(states.acceleration) * weights / 2
        rows = rows_of(softened(self.system, smoothing * self.speed + step), states, weights)
        errors = smooth_worst_case_error(least_squares(rows, self.norm), rows, 2 * smoothing)
        return jnp.log(jnp.max(errors))


@eqx.filter_jit
def planned_error(
    system: System, trajectory: JerkTrajectory, nodes: int = 1024
) -> Float[Array, " m"]:
    """J of every parameter on the desired motion, with the exact δ; the number that is reported.

    Args:
        system: with the exact δ.
        trajectory: one motion; repeating it changes nothing.
        nodes: of the midpoint rule, per interval; halving them moves J by less than 1e-4 of itself.
    """
    rows = rows_of(system, *trajectory.midpoints(nodes))
    return worst_case_error(least_squares(rows), rows.delta)
