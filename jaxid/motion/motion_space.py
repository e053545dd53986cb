"""The set of admissible motions: coordinates that keep the end conditions, proofs by LP, exactness.

Every state of a motion is linear in its jerk, so limits and via points are linear inequalities and
equalities, and the admissible jerks are a convex set. Everything here follows from that.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.linalg import cholesky, null_space, solve_triangular

from jaxid.motion.inequalities import sampled_conditions
from jaxid.motion.limits import Boundary, Limits
from jaxid.motion.trajectory import JerkTrajectory


class MotionSpace(eqx.Module):
    """Coordinates z of the motions that meet every equality: jerk = offset + basis·z.

    A unit step in z is about a unit of normalised trajectory (positions, velocities, accelerations
    and jerks in half-widths of their limits), which is what makes plain gradient steps work.
    Spaces of several lengths, padded to one size, share one compiled search.

    Attributes:
        start: [y, ẏ, ÿ] at t = 0.
        durations: of the intervals, s; zero where padded.
        offset: a jerk that meets the equalities, shape (n,).
        basis: shape (n, d); zero rows and columns where padded.
        inverse: shape (d, n), from a jerk back to its coordinates.
    """

    start: Float[Array, "3"]
    durations: Float[Array, " n"]
    offset: Float[Array, " n"]
    basis: Float[Array, "n d"]
    inverse: Float[Array, "d n"]

    def trajectory(self, z: Float[Array, " d"]) -> JerkTrajectory:
        """The motion with these coordinates."""
        return JerkTrajectory(self.start, self.offset + self.basis @ z, self.durations)

    def coordinates(self, jerk: Float[Array, " k"]) -> Float[Array, " d"]:
        """The coordinates of the motion nearest to a jerk that may be shorter than the space."""
        jerk = jnp.zeros_like(self.offset).at[: jerk.size].set(jerk)
        return self.inverse @ (jerk - self.offset)


def motion_space(
    limits: Limits, boundary: Boundary, intervals: int, period: float, size: int | None = None
) -> MotionSpace:
    """Null-space coordinates of the equalities, whitened by the limits.

    Args:
        limits: their half-widths are the units.
        boundary: its equalities are built in; its inequalities are not.
        intervals: n, how many pieces of constant jerk.
        period: T of each, s.
        size: pad to this many intervals; default no padding.
    """
    size = size or intervals
    conditions = sampled_conditions(limits, boundary, intervals, period, per_interval=1)
    equalities = conditions.rows[conditions.fixed]
    free = null_space(equalities) if len(equalities) else np.eye(intervals)
    loose = conditions.rows[~conditions.fixed & np.isfinite(conditions.lower)]
    metric = free.T @ (loose.T @ loose + np.eye(intervals)) @ free
    factor = cholesky(metric, lower=True)
    offset = np.linalg.pinv(equalities) @ conditions.lower[conditions.fixed]
    basis, inverse = np.zeros((size, size)), np.zeros((size, size))
    d = free.shape[1]
    basis[:intervals, :d] = solve_triangular(factor, free.T, lower=True).T * conditions.unit
    inverse[:d, :intervals] = factor.T @ free.T / conditions.unit
    keep = size - len(equalities)
    return MotionSpace(
        start=boundary.start,
        durations=jnp.asarray(np.where(np.arange(size) < intervals, period, 0.0)),
        offset=jnp.asarray(np.pad(offset * conditions.unit, (0, size - intervals))),
        basis=jnp.asarray(basis[:, :keep]),
        inverse=jnp.asarray(inverse[:keep]),
    )
