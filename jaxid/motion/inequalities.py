"""Limits and via points as linear conditions on the jerk of a motion."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from jaxid._checks import require
from jaxid.motion.limits import Boundary, Limits

Vector = Float[np.ndarray, " ..."]
Matrix = Float[np.ndarray, "rows n"]


@dataclass(frozen=True)
class Inequalities:
    """The linear conditions lower ≤ rows·x ≤ upper on x = jerk / unit, sampled in time.

    Each row is in half-widths of its limit; the rows with lower = upper are the end conditions.

    Attributes:
        rows: matrix of the conditions, one column per interval of constant jerk.
        lower: lower bounds of rows·x.
        upper: upper bounds of rows·x.
        jerk: jerk limits (lower, upper), m/s³ or rad/s³.
        unit: largest permitted |jerk|, m/s³ or rad/s³.
    """

    rows: Matrix
    lower: Vector
    upper: Vector
    jerk: Float[np.ndarray, "2"]
    unit: float

    @property
    def fixed(self) -> Bool[np.ndarray, " rows"]:
        """A mask of the rows that are equalities, shape (rows,)."""
        return self.lower == self.upper

    def tightened(self, room: float) -> "Inequalities":
        """Return the conditions with every limit moved inwards by `room` half-widths.

        The equalities stay as they are.
        """
        inwards = np.where(self.fixed, 0.0, room)
        jerk = self.jerk + room * np.ptp(self.jerk) / 2 * np.array([1.0, -1.0])
        return replace(self, lower=self.lower + inwards, upper=self.upper - inwards, jerk=jerk)


def responses(intervals: int, period: float, times: Vector) -> tuple[Matrix, Matrix, Matrix]:
    """Return the matrices that map the jerk to position, velocity and acceleration at given times.

    The start state contributes nothing to them.

    Args:
        intervals: number n of intervals of constant jerk.
        period: duration of each interval, s.
        times: instants, s, shape (k,).

    Returns:
        Three matrices of shape (k, n).
    """
    since = np.maximum(times[:, None] - period * np.arange(intervals), 0.0)
    after = np.maximum(since - period, 0.0)
    return (since**3 - after**3) / 6, (since**2 - after**2) / 2, since - after


def inequalities(limits: Limits, boundary: Boundary, intervals: int, period: float) -> Inequalities:
    """Return all conditions on a motion at its knots and at seven instants in each interval.

    Args:
        limits: limits of the motion.
        boundary: start, end and via points of the motion.
        intervals: number of intervals of constant jerk.
        period: duration of each interval, s.
    """
    return sampled_conditions(limits, boundary, intervals, period, per_interval=8)


def sampled_conditions(
    limits: Limits, boundary: Boundary, intervals: int, period: float, per_interval: int
) -> Inequalities:
    """Return all conditions on a motion at equally spaced instants of each interval.

    Args:
        limits: limits of the motion.
        boundary: start, end and via points of the motion.
        intervals: number of intervals of constant jerk.
        period: duration of each interval, s.
        per_interval: number of instants per interval, its end included.

    Raises:
        ValueError: if `intervals` is below 1.
    """
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
