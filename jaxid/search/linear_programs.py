"""One step of a sequential linear program: the best small change of a jerk under its conditions."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linprog

from jaxid.motion.inequalities import Inequalities

_NEAR = 0.03  # half-widths of a limit
_CUTS = 8  # rounds of adding broken conditions
_ROUNDED = 1e-9  # half-widths: what the solver leaves of a condition

Vector = Float[np.ndarray, " n"]
Mask = Bool[np.ndarray, " rows"]


class Point(NamedTuple):
    """A motion, as a search by linear programs sees it.

    Attributes:
        jerk: in the unit of the conditions.
        value: of the objective.
        slope: of the objective, over `jerk`.
    """

    jerk: Vector
    value: float
    slope: Vector


def linear_step(c: Inequalities, at: Point, radius: float) -> Vector:
    """The best move within the trust region and all conditions; zero if none is found.

    Args:
        c: the conditions.
        at: where the motion is; it may break conditions, if the region reaches where they hold.
            With a slope that is no number there is no move.
        radius: of the trust region, in the unit of the jerk.

    Conditions that the motion is near to are imposed, then those that the move turns out to break:
    with all of them from the beginning the programs take three times longer.
    """
    if not np.all(np.isfinite(at.slope)):
        return np.zeros_like(at.jerk)
    here = c.rows @ at.jerk
    up = ~c.fixed & (here > c.upper - _NEAR)
    down = ~c.fixed & (here < c.lower + _NEAR)
    move = np.zeros_like(at.jerk)
    for _ in range(_CUTS):
        move = _solve(c, at, here, up, down, radius)
        there = here + c.rows @ move
        above, below = (there > c.upper + _ROUNDED) & ~up, (there < c.lower - _ROUNDED) & ~down
        above, below = above & ~c.fixed, below & ~c.fixed
        if not (above.any() or below.any()):
            break
        up, down = up | above, down | below
    # the solver meets the end conditions to 1e-7, which would add up from step to step
    ends = c.rows[c.fixed]
    return move - np.linalg.pinv(ends) @ (ends @ move)


def _solve(
    c: Inequalities,
    at: Point,
    here: Float[np.ndarray, " rows"],
    up: Mask,
    down: Mask,
    radius: float,
) -> Vector:
    low, high = c.jerk / c.unit
    room = np.concatenate([c.upper[up] - here[up], here[down] - c.lower[down]])
    # what rounding left 1e-17 outside a limit must not make the program infeasible
    room[(room < 0) & (room > -_ROUNDED)] = 0.0
    solution = linprog(
        at.slope,
        A_ub=np.vstack([c.rows[up], -c.rows[down]]),
        b_ub=room,
        A_eq=c.rows[c.fixed],
        b_eq=np.zeros(int(np.sum(c.fixed))),
        bounds=list(
            zip(
                np.minimum(np.maximum(low - at.jerk, -radius), 0.0),
                np.maximum(np.minimum(high - at.jerk, radius), 0.0),
                strict=True,
            )
        ),
        method="highs",
    )
    return np.zeros_like(at.jerk) if solution.x is None else solution.x
