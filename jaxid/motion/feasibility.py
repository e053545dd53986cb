"""Feasibility of a motion of given length: a motion inside all limits, or a proof by LP of none."""

import jax.numpy as jnp
import numpy as np
from scipy.optimize import linprog

from jaxid._checks import require
from jaxid.motion.inequalities import Inequalities, Vector, sampled_conditions
from jaxid.motion.limits import Boundary, Limits
from jaxid.motion.trajectory import JerkTrajectory, States, padded, uniform
from jaxid.motion.violation import worst_violation

_MOST = 2000  # intervals of the longest motion that is tried when a shorter one is infeasible
_FEW = 64  # intervals of a linear program that takes 0.05 s


class InfeasibleError(ValueError):
    """The error raised when no motion of a given length keeps its limits, which is proved.

    Attributes:
        shortage: proved relaxation that all limits would need for this duration, in half-widths of
            each limit.
        shortest: number of intervals of constant jerk of the shortest feasible motion that was
            found; None if none was found up to 2000 intervals.
    """

    def __init__(
        self, intervals: int, period: float, shortage: float, shortest: int | None
    ) -> None:
        """Make the message.

        Args:
            intervals: number of intervals that is infeasible.
            period: duration of each interval, s.
            shortage: proved relaxation that all limits would need, in half-widths of each limit.
            shortest: number of intervals of the shortest feasible motion found, if there is one.
        """
        self.shortage = shortage
        self.shortest = shortest
        hint = (
            f"None was found up to {_MOST * period:g} s ({_MOST} intervals)."
            if shortest is None
            else f"The shortest one found lasts {shortest * period:g} s ({shortest} intervals)."
        )
        super().__init__(
            f"Argument `intervals`: no motion of {intervals * period:g} s ({intervals} intervals "
            f"of {period:g} s) keeps the limits and via points, which a linear program proves. "
            f"{hint}"
        )


def interior(
    limits: Limits, boundary: Boundary, intervals: int, period: float, size: int | None = None
) -> JerkTrajectory:
    """Return the motion whose smallest margin to all limits, in half-widths, is the largest.

    Args:
        limits: limits of the motion.
        boundary: start, end and via points of the motion.
        intervals: number n of intervals of constant jerk.
        period: duration T of each interval, s.
        size: number of intervals to pad the result to; default no padding.

    Raises:
        InfeasibleError: if no motion keeps the limits, which a linear program proves.
        ValueError: if none was found with a margin above zero, but no proof either; or if the
            boundary itself is outside the limits, so that no motion of any length meets it.
    """
    _require_inside(limits, boundary)
    trajectory, margin = deepest(limits, boundary, intervals, period, size)
    if trajectory is None and margin < 0:
        shortest = shortest_feasible(limits, boundary, period, multiple=_grid(boundary))
        raise InfeasibleError(intervals, period, -margin, shortest)
    if trajectory is None:
        raise ValueError(
            f"Argument `intervals`: every motion of {intervals * period:g} s ({intervals} "
            f"intervals of {period:g} s) touches a limit (largest margin {margin:.1e} of half the "
            "range): allow a longer motion or wider limits."
        )
    return trajectory


def _require_inside(limits: Limits, boundary: Boundary) -> None:
    """Refuse states that are outside the limits, before motions of all lengths are tried."""
    ends = (
        (0.0, boundary.start, boundary.start),
        *((v.at, v.lower, v.upper) for v in boundary.vias),
    )
    intervals = [getattr(limits, name) for name in States._fields]
    for at, lower, upper in ends:
        for name, low, high, limit in zip(States._fields, lower, upper, intervals, strict=True):
            require(
                bool(low <= limit[1]) and bool(high >= limit[0]),
                f"Argument `boundary`: at {float(at):.4g} of the duration the {name} must be in "
                f"[{float(low):g}, {float(high):g}], which is outside its limits "
                f"[{float(limit[0]):g}, {float(limit[1]):g}].",
            )


def shortest_feasible(
    limits: Limits, boundary: Boundary, period: float, multiple: int = 1, most: int = _MOST
) -> int | None:
    """Return the number of intervals of the shortest motion found with a margin to all limits.

    It is None if none is found up to `most` intervals. The duration is doubled until a motion is
    feasible, then bisected, as if every longer motion were feasible too. With more than 64
    intervals, only motions whose jerk is constant over several of them are tried, since the time of
    a linear program grows with the cube of its size; then the result may be some per cent longer
    than the shortest.

    Args:
        limits: limits of the motion.
        boundary: start, end and via points of the motion.
        period: duration of each interval, s.
        multiple: number of which the result is a multiple.
        most: largest number of intervals that is tried.
    """
    few = max(2, 2 ** int(np.log2(max(_FEW // multiple, 1))))

    def feasible(count: int) -> bool:
        size = few * multiple  # one compilation for all lengths
        found, _ = deepest(limits, boundary, count * multiple, stride * period, size)
        return found is not None

    # numbers of times `multiple` intervals, each of `stride` periods
    infeasible, count, stride = 0, 1, 1
    while not feasible(count):
        if count == few:
            count, stride = count // 2, 2 * stride
        longest = most // (multiple * stride)
        if count >= longest:
            return None
        infeasible, count = count, min(2 * count, longest)
    while count - infeasible > 1:
        middle = (infeasible + count) // 2
        infeasible, count = (infeasible, middle) if feasible(middle) else (middle, count)
    return count * multiple * stride


def deepest(
    limits: Limits, boundary: Boundary, intervals: int, period: float, size: int | None = None
) -> tuple[JerkTrajectory | None, float]:
    """Return the motion of largest margin, if that is positive, and the margin in half-widths.

    A margin below zero is a proof that no motion keeps the limits. The arguments are those of
    `interior`.
    """
    margin = 0.0
    for per_interval in (4, 16, 64):
        c = sampled_conditions(limits, boundary, intervals, period, per_interval)
        x, margin, bound = _largest_margin(c)
        if bound < 0:
            return None, bound
        found = padded(uniform(boundary.start, jnp.asarray(x * c.unit), period), size or intervals)
        # sampling relaxes the limits between the samples: only the exact extrema decide
        if margin > 0 and float(worst_violation(limits, boundary, found)) < 0:
            return found, margin
    return None, max(0.0, margin)


def _largest_margin(c: Inequalities) -> tuple[Vector, float, float]:
    """Return the x of largest margin s to all inequalities, s, and a proved upper bound of s.

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
    # the solver meets the equalities to 1e-7: correct x, so that it meets them to rounding
    x = solution.x[:n] - np.linalg.pinv(E) @ (E @ solution.x[:n] - f)
    terms = np.concatenate([multipliers * b, others * f])
    residual = np.sum(np.abs(A.T @ multipliers + E.T @ others))
    rounding = 1e-12 * np.sum(np.abs(terms))
    total = np.sum(terms) + residual * (1 + abs(margin)) + rounding
    return x, margin, float(total / np.sum(multipliers))


def _grid(boundary: Boundary) -> int:
    """Return the smallest number of intervals that puts every via point on a knot."""
    for count in range(1, 100):
        if all(abs(via.at * count - round(via.at * count)) < 1e-9 for via in boundary.vias):
            return count
    return 1
