"""The set of admissible motions: coordinates that keep the end conditions, proofs by LP, exactness.

Every state of a motion is linear in its jerk, so limits and via points are linear inequalities and
equalities, and the admissible jerks are a convex set. Everything here follows from that.
"""

from dataclasses import dataclass, replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.linalg import cholesky, null_space, solve_triangular
from scipy.optimize import linprog

from jaxid._checks import require
from jaxid.motion.limits import Boundary, Limits, worst_excess
from jaxid.motion.trajectory import JerkTrajectory, uniform

Vector = Float[np.ndarray, " ..."]
Matrix = Float[np.ndarray, "rows n"]


class InfeasibleError(ValueError):
    """No motion of this length meets the limits: proved, with the shortest length that does."""

    def __init__(self, intervals: int, period: float, shortage: float, shortest: int) -> None:
        """Say so in a sentence; `shortage` is the proved relaxation, in half-widths."""
        self.shortest = shortest
        super().__init__(
            f"Argument `intervals`: no motion of {intervals} intervals of {period:g} s keeps the "
            f"limits and via points (a linear program proves that all of them would have to be "
            f"widened by {100 * shortage:.2g} % of their half-width); the shortest that does has "
            f"{shortest} intervals."
        )


@dataclass(frozen=True)
class Inequalities:
    """The linear conditions on x = jerk / unit, sampled in time: lower ≤ rows·x ≤ upper.

    Rows are in half-widths of their limit; those with lower = upper are the end conditions.
    """

    rows: Matrix
    lower: Vector
    upper: Vector
    jerk: Float[np.ndarray, "2"]
    unit: float

    @property
    def fixed(self) -> Bool[np.ndarray, " rows"]:
        """Which rows are equalities."""
        return self.lower == self.upper

    def tightened(self, room: float) -> "Inequalities":
        """With every limit moved inwards, in half-widths; the end conditions stay."""
        inwards = np.where(self.fixed, 0.0, room)
        jerk = self.jerk + room * np.ptp(self.jerk) / 2 * np.array([1.0, -1.0])
        return replace(self, lower=self.lower + inwards, upper=self.upper - inwards, jerk=jerk)


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


def padded(trajectory: JerkTrajectory, size: int) -> JerkTrajectory:
    """The same motion with intervals of no duration appended, up to `size` in all."""
    extra = size - trajectory.jerk.size
    return JerkTrajectory(
        trajectory.start,
        jnp.pad(trajectory.jerk, (0, extra)),
        jnp.pad(trajectory.durations, (0, extra)),
    )


def trimmed(trajectory: JerkTrajectory) -> JerkTrajectory:
    """The same motion without its intervals of no duration."""
    keep = np.flatnonzero(np.asarray(trajectory.durations) > 0)
    return JerkTrajectory(trajectory.start, trajectory.jerk[keep], trajectory.durations[keep])


def responses(intervals: int, period: float, times: Vector) -> tuple[Matrix, Matrix, Matrix]:
    """Matrices from the jerk to position, velocity and acceleration at the given times."""
    since = np.maximum(times[:, None] - period * np.arange(intervals), 0.0)
    after = np.maximum(since - period, 0.0)
    return (since**3 - after**3) / 6, (since**2 - after**2) / 2, since - after


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
    conditions = _conditions(limits, boundary, intervals, period, per_interval=1)
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


def interior(
    limits: Limits, boundary: Boundary, intervals: int, period: float, size: int | None = None
) -> JerkTrajectory:
    """The motion that stays farthest inside all limits, measured in their half-widths.

    Args:
        limits: to stay inside of.
        boundary: to meet.
        intervals: n, how many pieces of constant jerk.
        period: T of each, s.
        size: pad to this many intervals; default no padding.

    Raises:
        InfeasibleError: if there is none, which a linear program proves.
    """
    trajectory, margin = _deepest(limits, boundary, intervals, period, size)
    if trajectory is None and margin < 0:
        shortest = shortest_feasible(limits, boundary, period, multiple=_grid(boundary))
        raise InfeasibleError(intervals, period, -margin, shortest)
    if trajectory is None:
        raise ValueError(
            f"Argument `intervals`: with {intervals} intervals of {period:g} s the admissible "
            f"motions have no interior (largest margin {margin:.1e}): allow a longer motion or "
            "wider limits."
        )
    return trajectory


def shortest_feasible(
    limits: Limits, boundary: Boundary, period: float, multiple: int = 1, most: int = 2000
) -> int:
    """The smallest number of intervals, a multiple, for which a motion has room to all limits."""
    for intervals in range(multiple, most + 1, multiple):
        if _deepest(limits, boundary, intervals, period)[0] is not None:
            return intervals
    raise ValueError(
        f"Argument `boundary`: no motion of up to {most} intervals of {period:g} s meets it within "
        "the limits."
    )


def inequalities(limits: Limits, boundary: Boundary, intervals: int, period: float) -> Inequalities:
    """All conditions at the knots and three times in between, for linear programs."""
    return _conditions(limits, boundary, intervals, period, per_interval=8)


def _deepest(
    limits: Limits, boundary: Boundary, intervals: int, period: float, size: int | None = None
) -> tuple[JerkTrajectory | None, float]:
    """The deepest motion, if one has room, and its margin: below zero if none is *proved* to."""
    margin = 0.0
    for per_interval in (4, 16, 64):
        c = _conditions(limits, boundary, intervals, period, per_interval)
        x, margin, bound = _largest_margin(c)
        if bound < 0:
            return None, bound
        found = padded(uniform(boundary.start, jnp.asarray(x * c.unit), period), size or intervals)
        # sampling relaxes the limits between the samples: only the exact extrema decide
        if margin > 0 and float(worst_excess(limits, boundary, found)) < 0:
            return found, margin
    return None, max(0.0, margin)


def _largest_margin(c: Inequalities) -> tuple[Vector, float, float]:
    """Max s such that every inequality holds with s to spare; also an upper bound of s, proved.

    The bound does not trust the solver. Stack the inequalities as A x + s ≤ b and the equalities as
    E x = f. For any multipliers λ ≥ 0 and μ, s·Σλ ≤ λᵀb + μᵀf − (Aᵀλ + Eᵀμ)ᵀx, where the jerk
    limits give |x| ≤ 1 + max(0, −s). A negative right-hand side excludes every s ≥ 0.
    """
    n = c.rows.shape[1]
    up, down = ~c.fixed & np.isfinite(c.upper), ~c.fixed & np.isfinite(c.lower)
    low, high = c.jerk / c.unit
    A = np.vstack([c.rows[up], -c.rows[down], np.eye(n), -np.eye(n)])
    b = np.concatenate([c.upper[up], -c.lower[down], np.full(n, high), np.full(n, -low)])
    E, f = c.rows[c.fixed], c.lower[c.fixed]
    if np.linalg.norm(E @ (np.linalg.pinv(E) @ f) - f) > 1e-9 * (1 + np.linalg.norm(f)):
        return np.zeros(n), -np.inf, -np.inf  # too few intervals to meet the equalities at all
    solution = linprog(
        np.append(np.zeros(n), -1.0),
        A_ub=np.column_stack([A, np.ones(len(b))]),
        b_ub=b,
        A_eq=np.column_stack([E, np.zeros(len(f))]),
        b_eq=f,
        bounds=(None, None),
        method="highs",
    )
    assert solution.x is not None, solution.message  # s is free, so there always is a solution
    multipliers = np.maximum(-solution.ineqlin.marginals, 0.0)
    others = -solution.eqlin.marginals
    margin = float(solution.x[n])
    # the solver meets the equalities to 1e-7; this does to rounding, and moves x by as little
    x = solution.x[:n] - np.linalg.pinv(E) @ (E @ solution.x[:n] - f)
    terms = np.concatenate([multipliers * b, others * f])
    residual = np.sum(np.abs(A.T @ multipliers + E.T @ others))
    rounding = 1e-12 * np.sum(np.abs(terms))
    total = np.sum(terms) + residual * (1 + abs(margin)) + rounding
    return x, margin, float(total / np.sum(multipliers))


def _conditions(
    limits: Limits, boundary: Boundary, intervals: int, period: float, per_interval: int
) -> Inequalities:
    require(intervals >= 1, f"Argument `intervals` must be at least 1, but is {intervals}.")
    motion, jerk = np.asarray(limits.motion), np.asarray(limits.jerk)
    unit, half = float(np.max(np.abs(jerk))), (motion[:, 1] - motion[:, 0]) / 2
    y, v, a = np.asarray(boundary.start)
    times = period / per_interval * np.arange(1, intervals * per_interval + 1)
    asked = [(times, which, *motion[which]) for which in range(3)]
    for via in boundary.vias:
        at = np.array([via.at * intervals * period])
        pairs = zip(via.lower.tolist(), via.upper.tolist(), strict=True)
        asked += [
            (at, which, lower, upper)
            for which, (lower, upper) in enumerate(pairs)
            if np.isfinite(lower) or np.isfinite(upper)
        ]

    def block(
        times: Vector, which: int, lower: float, upper: float
    ) -> tuple[Matrix, Vector, Vector]:
        rows = responses(intervals, period, times)[which] * unit
        base = (y + times * (v + times * a / 2), v + times * a, a + 0 * times)[which]
        return rows / half[which], (lower - base) / half[which], (upper - base) / half[which]

    blocks = [block(*condition) for condition in asked]
    rows, lower, upper = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return Inequalities(rows, lower, upper, jerk, unit)


def _grid(boundary: Boundary) -> int:
    """The smallest count of intervals that puts every via point on a knot."""
    for count in range(1, 100):
        if all(abs(via.at * count - round(via.at * count)) < 1e-9 for via in boundary.vias):
            return count
    return 1
