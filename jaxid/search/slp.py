"""Sequential linear programming in a trust region: the final refinement, with exact limits.

Limits and via points are linear in the jerk, so only the objective is linearised. The iterates stay
admissible, and only improvements are accepted.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.optimize import linprog

from jaxid.motion.inequalities import Inequalities, inequalities
from jaxid.motion.trajectory import JerkTrajectory, trimmed
from jaxid.search.effort import SMOOTHINGS
from jaxid.search.frozen_loop import axis_conditions, freeze
from jaxid.search.problem import Problem
from jaxid.search.restoration import ROUNDING, restored, stepped_back

# half-widths: margin of a step to the limits of the axis, for the tolerance of the solver and for
# the error of the linearisation
_SPARE = 1e-6
_NEAR = 0.03  # half-widths: conditions nearer than this are imposed first
_CUTS = 8  # rounds in which violated conditions are added
_ROUNDED = 1e-9  # half-widths: tolerance of the solver
_SMALLEST_RADIUS = 1e-6

Vector = Float[np.ndarray, " n"]
Mask = Bool[np.ndarray, " rows"]
State = TypeVar("State")


class Point(NamedTuple):
    """A motion with its objective and gradient, for a sequential linear program.

    Attributes:
        jerk: jerk of each interval, in the unit of the conditions.
        value: objective.
        slope: gradient of the objective by `jerk`.
    """

    jerk: Vector
    value: float
    slope: Vector


class TrustRegion(NamedTuple):
    """The settings of the trust region of a sequential linear program.

    Attributes:
        radius: first radius, in the unit of the variables.
        least: predicted decrease of the objective below which the iteration stops.
        steps: largest number of linear programs.
    """

    radius: float
    least: float
    steps: int


def improvements(
    evaluate: Callable[[Vector, State], tuple[Point, State]],
    conditions: Callable[[State], Inequalities],
    start: tuple[Point, State],
    region: TrustRegion,
) -> Iterator[State]:
    """Yield every accepted iterate of a sequential linear program, without the start.

    Args:
        evaluate: function of new variables and the state before the step; returns the point at the
            variables and its state.
        conditions: function that returns the linear conditions at a state.
        start: first point and its state.
        region: first radius of the trust region, and when to stop.
    """
    at, best = start
    around, radius = conditions(best), region.radius
    for _ in range(region.steps):
        move = linear_step(around, at, radius)
        promised = -float(at.slope @ move)
        if promised < region.least or radius < _SMALLEST_RADIUS:
            return
        trial, found = evaluate(at.jerk + move, best)
        kept = (at.value - trial.value) / promised
        radius *= 2.0 if kept > 0.75 else 0.4 if kept < 0.25 else 1.0
        if trial.value < at.value:
            at, best = trial, found
            yield best
            around = conditions(best)


def linear_step(c: Inequalities, at: Point, radius: float) -> Vector:
    """Return the best step of a linear program within the trust region and all conditions.

    It is zero if the program has no solution or the gradient is not finite. To save time, only the
    conditions near the motion are imposed first, then those that the step violates.

    Args:
        c: linear conditions.
        at: motion, its objective and gradient; it may violate conditions that the trust region
            can reach.
        radius: radius of the trust region, in the unit of the jerk.
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
    # a violation of 1e-17 by rounding must not make the program infeasible
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


def refined(
    problem: Problem,
    inside: JerkTrajectory,
    start: JerkTrajectory,
    programs: int,
    smoothings: Sequence[float] = SMOOTHINGS,
) -> JerkTrajectory:
    """Return an admissible motion, improved by sequential linear programs.

    Args:
        problem: objective, which is smoothed, and limits, which are kept exactly.
        inside: motion of the same length with a margin to all limits.
        start: admissible motion; padding (intervals of duration zero) is not changed.
        programs: largest number of linear programs per smoothing.
        smoothings: smoothing parameters of the objective, in order.
    """
    found = start
    for smoothing in smoothings:
        found = _descend(problem, inside, found, smoothing, programs)
        if problem.axis is None:
            found = restored(problem, inside, found)
    return found


def _descend(
    problem: Problem, inside: JerkTrajectory, start: JerkTrajectory, smoothing: float, steps: int
) -> JerkTrajectory:
    planned = _planned(problem, start)
    active = planned.rows.shape[1]

    def evaluate(x: Vector, before: JerkTrajectory) -> tuple[Point, JerkTrajectory]:
        found = _with_jerk(start, start.jerk.at[:active].set(x * planned.unit))
        if problem.axis is not None:
            found = stepped_back(problem, inside, found)
        return _point(problem, found, smoothing, planned), found

    # the motion is kept beside its variables: with an encoder, a last bit of the jerk changes the
    # simulation of the axis
    first = _point(problem, start, smoothing, planned), start
    region = TrustRegion(0.01, 1e-8, steps)
    better = improvements(evaluate, lambda at: _around(problem, planned, at), first, region)
    return [start, *better][-1]


def repaired(problem: Problem, inside: JerkTrajectory, start: JerkTrajectory) -> JerkTrajectory:
    """Return an admissible motion near one that violates the limits of the axis.

    Up to five linear programs, each in the smallest trust region that reaches the limits, or a step
    towards `inside`: the result is the one of lower objective.

    Args:
        problem: objective, limits, and the prediction of the axis.
        inside: motion with a margin to all limits.
        start: motion that may violate limits.
    """
    planned, found = _planned(problem, start), start
    for _ in range(5):
        if problem.axis is None or float(problem.violation(found)) <= -ROUNDING:
            break
        c = _around(problem, planned, found)
        at = _point(problem, found, SMOOTHINGS[0], planned)
        moves = (linear_step(c, at, radius) for radius in 0.002 * 2.0 ** np.arange(10))
        move = next((move for move in moves if np.any(move)), np.zeros_like(at.jerk))
        found = _with_jerk(found, jnp.asarray((at.jerk + move) * planned.unit))
    if found is start:
        return stepped_back(problem, inside, start)
    ways = (stepped_back(problem, inside, motion) for motion in (found, start))
    return min(ways, key=problem.value)


def _planned(problem: Problem, trajectory: JerkTrajectory) -> Inequalities:
    active = int(np.count_nonzero(np.asarray(trajectory.durations)))
    period = float(trajectory.durations[0])
    return inequalities(problem.limits, problem.boundary, active, period)


def _point(
    problem: Problem, trajectory: JerkTrajectory, smoothing: float, planned: Inequalities
) -> Point:
    value, slope = problem.value_and_slope(trajectory, smoothing)
    active = planned.rows.shape[1]
    jerk = np.asarray(trajectory.jerk)[:active] / planned.unit
    return Point(jerk, float(value), np.asarray(slope)[:active] * planned.unit)


def _around(problem: Problem, planned: Inequalities, trajectory: JerkTrajectory) -> Inequalities:
    if problem.axis is None:
        return planned
    motion = trimmed(trajectory)
    still = freeze(problem.axis, problem.limits, motion)
    return axis_conditions(planned, problem.limits, still, motion).tightened(_SPARE)


def _with_jerk(trajectory: JerkTrajectory, jerk: Float[Array, " n"]) -> JerkTrajectory:
    return eqx.tree_at(lambda t: t.jerk, trajectory, jerk)
