"""The set of admissible motions, in coordinates that keep the end conditions.

Every state of a motion is linear in its jerk, so limits and via points are linear inequalities and
equalities, and the admissible jerks are a convex set.
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
    """Coordinates z of all motions that meet the end conditions: jerk = offset + basis·z.

    A unit step in z changes the normalised trajectory (positions, velocities, accelerations and
    jerks in half-widths of their limits) by about one, so that plain gradient steps work. Spaces of
    several lengths, padded to one size, share one compiled search.

    Attributes:
        start: state [y, ẏ, ÿ] at t = 0, SI units.
        durations: durations of the intervals, s; zero where padded.
        offset: jerk that meets the end conditions, m/s³ or rad/s³, shape (n,).
        basis: matrix from coordinates to jerk, shape (n, d); zero rows and columns where padded.
        inverse: matrix from jerk to coordinates, shape (d, n).
    """

    start: Float[Array, "3"]
    durations: Float[Array, " n"]
    offset: Float[Array, " n"]
    basis: Float[Array, "n d"]
    inverse: Float[Array, "d n"]

    def trajectory(self, z: Float[Array, " d"]) -> JerkTrajectory:
        """Return the motion with the coordinates z."""
        return JerkTrajectory(self.start, self.offset + self.basis @ z, self.durations)

    def coordinates(self, jerk: Float[Array, " k"]) -> Float[Array, " d"]:
        """Return the coordinates of the motion of this space that is nearest to a given jerk.

        Args:
            jerk: jerk per interval, m/s³ or rad/s³; may have fewer intervals than the space.
        """
        jerk = jnp.zeros_like(self.offset).at[: jerk.size].set(jerk)
        return self.inverse @ (jerk - self.offset)


def motion_space(
    limits: Limits, boundary: Boundary, intervals: int, period: float, size: int | None = None
) -> MotionSpace:
    """Return the coordinates of all motions that meet the equalities of a boundary.

    They span the null space of the equalities, scaled by the limits.

    Args:
        limits: limits of the motion, whose half-widths are the units of the scaling.
        boundary: start, end and via points; its equalities are kept by every coordinate, its
            inequalities are not.
        intervals: number n of intervals of constant jerk.
        period: duration T of each interval, s.
        size: number of intervals to pad the space to; default no padding.
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
