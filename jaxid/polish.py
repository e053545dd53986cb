"""The last fraction of a per cent: trust-region sequential linear programs on the exact limits.

Limits and via points are linear in the jerk, so only the objective is linearised. The iterates stay
admissible, and only improvements are accepted.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.optimize import linprog

from jaxid.feasible import Inequalities, inequalities, walk
from jaxid.problem import Objective, Problem
from jaxid.system import Scalar
from jaxid.trajectory import JerkTrajectory

# Of the objective, one after the other: without the first the programs stall on corners earlier
# (0.1 % of the motor's J), and after the second the rounded J is within 0.02 % of the exact one.
SMOOTHINGS = (0.0006, 0.0001)


_NEAR = 0.03  # half-widths of a limit
_CUTS = 8  # rounds of adding broken conditions

Vector = Float[np.ndarray, " n"]
Mask = Bool[np.ndarray, " rows"]


class _Point(NamedTuple):
    jerk: Float[np.ndarray, " n"]
    value: float
    slope: Float[np.ndarray, " n"]


def polish(
    problem: Problem, inside: JerkTrajectory, start: JerkTrajectory, steps: int
) -> JerkTrajectory:
    """Improve an admissible motion by at most `steps` linear programs per smoothing.

    Args:
        problem: its objective smoothed, its limits kept exactly.
        inside: a strictly admissible motion of the same length, to walk back from.
        start: an admissible motion; padding (intervals of no duration) is left alone.
        steps: the most linear programs to solve per smoothing.
    """
    active = int(np.count_nonzero(np.asarray(start.durations)))
    limits, boundary = problem.limits, problem.boundary
    conditions = inequalities(limits, boundary, active, float(start.durations[0]))
    found = start
    for smoothing in SMOOTHINGS:
        found = _descend(problem.objective, conditions, found, smoothing, steps)
        found = walk(limits, boundary, inside, found)
    return found


def _descend(
    objective: Objective, c: Inequalities, start: JerkTrajectory, smoothing: float, steps: int
) -> JerkTrajectory:
    def evaluate(x: Float[np.ndarray, " n"]) -> _Point:
        jerk = start.jerk.at[: x.size].set(x * c.unit)
        value, slope = _value_and_slope(objective, _with_jerk(start, jerk), jnp.asarray(smoothing))
        return _Point(x, float(value), np.asarray(slope)[: x.size] * c.unit)

    at = evaluate(np.asarray(start.jerk)[: c.rows.shape[1]] / c.unit)
    radius = 0.01
    for _ in range(steps):
        move = _linear_step(c, at, radius)
        promised = -float(at.slope @ move)
        if promised < 1e-8 or radius < 1e-6:
            break
        trial = evaluate(at.jerk + move)
        kept = (at.value - trial.value) / promised
        radius *= 2.0 if kept > 0.75 else 0.4 if kept < 0.25 else 1.0
        if trial.value < at.value:
            at = trial
    return _with_jerk(start, start.jerk.at[: at.jerk.size].set(at.jerk * c.unit))


def _linear_step(c: Inequalities, at: _Point, radius: float) -> Vector:
    """The best move within the trust region and all conditions; zero if none is found.

    Conditions that the motion is near to are imposed, then those that the move turns out to break:
    with all of them from the beginning the programs take three times longer.
    """
    here = c.rows @ at.jerk
    up = ~c.fixed & (here > c.upper - _NEAR)
    down = ~c.fixed & (here < c.lower + _NEAR)
    move = np.zeros_like(at.jerk)
    for _ in range(_CUTS):
        move = _solve(c, at, here, up, down, radius)
        there = here + c.rows @ move
        above, below = (there > c.upper + 1e-9) & ~up, (there < c.lower - 1e-9) & ~down
        above, below = above & ~c.fixed, below & ~c.fixed
        if not (above.any() or below.any()):
            break
        up, down = up | above, down | below
    # the solver meets the end conditions to 1e-7, which would add up from step to step
    ends = c.rows[c.fixed]
    return move - np.linalg.pinv(ends) @ (ends @ move)


def _solve(
    c: Inequalities,
    at: _Point,
    here: Float[np.ndarray, " rows"],
    up: Mask,
    down: Mask,
    radius: float,
) -> Vector:
    low, high = c.jerk / c.unit
    # what rounding left 1e-17 outside a limit must not make the program infeasible
    solution = linprog(
        at.slope,
        A_ub=np.vstack([c.rows[up], -c.rows[down]]),
        b_ub=np.maximum(np.concatenate([c.upper[up] - here[up], here[down] - c.lower[down]]), 0.0),
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


def _with_jerk(trajectory: JerkTrajectory, jerk: Float[Array, " n"]) -> JerkTrajectory:
    return eqx.tree_at(lambda t: t.jerk, trajectory, jerk)


@eqx.filter_jit
def _value_and_slope(
    objective: Objective, trajectory: JerkTrajectory, smoothing: Scalar
) -> tuple[Scalar, Float[Array, " n"]]:
    return jax.value_and_grad(lambda jerk: objective(_with_jerk(trajectory, jerk), smoothing))(
        trajectory.jerk
    )
