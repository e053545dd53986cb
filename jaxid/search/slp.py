"""The last fraction of a per cent: trust-region sequential linear programs on the exact limits.

Limits and via points are linear in the jerk, so only the objective is linearised. The iterates stay
admissible, and only improvements are accepted.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._types import Scalar
from jaxid.motion.inequalities import Inequalities, inequalities
from jaxid.motion.trajectory import JerkTrajectory, trimmed
from jaxid.search.frozen_loop import axis_conditions, freeze
from jaxid.search.linear_programs import Point, Vector, linear_step
from jaxid.search.problem import Objective, Problem
from jaxid.search.restoration import ROUNDING, restored, stepped_back

# Of the objective, one after the other: without the first the programs stall on corners earlier
# (0.1 % of the motor's J), and after the second the rounded J is within 0.02 % of the exact one.
SMOOTHINGS = (0.0006, 0.0001)
# half-widths that steps leave to the limits of an axis: for the tolerance of the solver, and for
# what linearised conditions do not see
_SPARE = 1e-6


def polish(
    problem: Problem,
    inside: JerkTrajectory,
    start: JerkTrajectory,
    steps: int,
    smoothings: Sequence[float] = SMOOTHINGS,
) -> JerkTrajectory:
    """Improve an admissible motion by at most `steps` linear programs per smoothing.

    Args:
        problem: its objective smoothed, its limits kept exactly.
        inside: a strictly admissible motion of the same length, to walk back from.
        start: an admissible motion; padding (intervals of no duration) is left alone.
        steps: the most linear programs to solve per smoothing.
        smoothings: of the objective, one after the other.
    """
    found = start
    for smoothing in smoothings:
        found = _descend(problem, inside, found, smoothing, steps)
        if problem.axis is None:
            found = restored(problem, inside, found)
    return found


def _descend(
    problem: Problem, inside: JerkTrajectory, start: JerkTrajectory, smoothing: float, steps: int
) -> JerkTrajectory:
    planned = _planned(problem, start)
    active = planned.rows.shape[1]

    def evaluate(x: Vector) -> tuple[Point, JerkTrajectory]:
        found = _with_jerk(start, start.jerk.at[:active].set(x * planned.unit))
        if problem.axis is not None:
            found = stepped_back(problem, inside, found)
        return _point(problem.objective, found, smoothing, planned), found

    # the motion itself is kept beside its numbers: with an encoder the axis does something else for
    # a jerk that differs in its last bit
    at, best = _point(problem.objective, start, smoothing, planned), start
    conditions = _around(problem, planned, best)
    radius = 0.01
    for _ in range(steps):
        move = linear_step(conditions, at, radius)
        promised = -float(at.slope @ move)
        if promised < 1e-8 or radius < 1e-6:
            break
        trial, found = evaluate(at.jerk + move)
        kept = (at.value - trial.value) / promised
        radius *= 2.0 if kept > 0.75 else 0.4 if kept < 0.25 else 1.0
        if trial.value < at.value:
            at, best = trial, found
            conditions = _around(problem, planned, best)
    return best


def repaired(problem: Problem, inside: JerkTrajectory, start: JerkTrajectory) -> JerkTrajectory:
    """An admissible motion near to one that leaves the limits of the axis.

    By linear programs, each in the smallest trust region that reaches the limits, and in it the
    best for the objective; or stepped back, where that is better.
    """
    planned, found = _planned(problem, start), start
    for _ in range(5):
        if problem.axis is None or float(problem.violation(found)) <= -ROUNDING:
            break
        c = _around(problem, planned, found)
        at = _point(problem.objective, found, SMOOTHINGS[0], planned)
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
    objective: Objective, trajectory: JerkTrajectory, smoothing: float, planned: Inequalities
) -> Point:
    value, slope = _value_and_slope(objective, trajectory, jnp.asarray(smoothing))
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


@eqx.filter_jit
def _value_and_slope(
    objective: Objective, trajectory: JerkTrajectory, smoothing: Scalar
) -> tuple[Scalar, Float[Array, " n"]]:
    return jax.value_and_grad(lambda jerk: objective(_with_jerk(trajectory, jerk), smoothing))(
        trajectory.jerk
    )
