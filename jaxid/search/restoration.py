"""Restoration of motions to their limits, including those of the axis if the problem has them."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxid._checks import require
from jaxid._types import Scalar
from jaxid.motion.feasibility import deepest, interior
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.search.problem import Problem

# half-widths: limits remain kept if the extrema are computed in another order
ROUNDING = 1e-14
_CHORDS, _MOST_CHORDS = 5, 30  # evaluations of a step back, each a simulation of the axis
_CLOSE = 1e-4  # of the margin of the interior motion: close enough to a limit
_ROOMY = 0.02  # half-widths: sufficient margin of an interior motion


def interior_motion(
    problem: Problem, intervals: int, period: float, size: int | None = None
) -> JerkTrajectory:
    """Return a motion with a margin to all limits.

    It is the motion of largest margin to the limits of the motion. If the problem has limits on the
    axis too, and a margin is below 0.02 half-widths, motions with reduced acceleration limits are
    tried, down to 40 %.

    Args:
        problem: limits and boundary of the motion, and the prediction of the axis.
        intervals: number n of intervals of constant jerk.
        period: duration T of each interval, s.
        size: number of intervals to pad the result to; default no padding.

    Raises:
        InfeasibleError: if no motion keeps its limits, which a linear program proves.
        ValueError: if no motion was found with a margin, or none whose axis keeps its limits.
    """
    limits, boundary = problem.limits, problem.boundary
    best = interior(limits, boundary, intervals, period, size)
    beyond = float(problem.violation(best))
    for share in np.linspace(1.0, 0.4, 7)[1:]:
        if problem.axis is None or beyond <= -_ROOMY:
            break
        gentler = eqx.tree_at(lambda x: x.acceleration, limits, share * limits.acceleration)
        found, _ = deepest(gentler, boundary, intervals, period, size)
        if found is None:
            break
        if (outside := float(problem.violation(found))) < beyond:
            best, beyond = found, outside
    if not beyond < 0:  # also if it is NaN because the axis diverges
        raise ValueError(
            f"Argument `limits`: the axis leaves them by {beyond:.2g} half-widths even on the "
            f"gentlest motion tried ({intervals} intervals of {period:g} s): allow a longer motion."
        )
    return best


def restored(problem: Problem, inside: JerkTrajectory, candidate: JerkTrajectory) -> JerkTrajectory:
    """Return the admissible motion nearest to `candidate` on the line from an admissible one to it.

    It is found by bisection to the last bit, since the admissible motions are a convex set. If the
    axis must be simulated, `stepped_back` is faster.

    Args:
        problem: limits of the motion.
        inside: motion with a margin to all limits.
        candidate: motion that may violate limits.
    """
    # without the objective: compiled once for all objectives
    return _restored(eqx.tree_at(lambda p: p.objective, problem, None), inside, candidate)


@eqx.filter_jit
def _restored(
    problem: Problem, inside: JerkTrajectory, candidate: JerkTrajectory
) -> JerkTrajectory:
    def at(share: Scalar) -> JerkTrajectory:
        return _mixed(inside, candidate, share)

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        good, bad = ends
        middle = (good + bad) / 2
        kept = problem.violation(at(middle)) <= -ROUNDING
        return jnp.where(kept, middle, good), jnp.where(kept, bad, middle)

    whole = problem.violation(candidate) <= -ROUNDING
    good, _ = jax.lax.fori_loop(0, 60, halve, (jnp.zeros(()), jnp.ones(())))
    return eqx.tree_at(lambda t: t.jerk, inside, jnp.where(whole, candidate.jerk, at(good).jerk))


def stepped_back(
    problem: Problem, inside: JerkTrajectory, candidate: JerkTrajectory
) -> JerkTrajectory:
    """Return `candidate` if it is admissible, else an admissible motion on the line to `inside`.

    The point on the line is found by regula falsi (Illinois form), with few evaluations.

    Args:
        problem: limits of the motion and of the axis.
        inside: motion with a margin to all limits.
        candidate: motion that may violate limits.

    Raises:
        ValueError: if `inside` violates a limit.
    """
    bad, beyond = 0.0, float(problem.violation(candidate))
    if beyond <= -ROUNDING:
        return candidate
    good, found, room = 1.0, inside, -float(problem.violation(inside))
    require(
        room >= ROUNDING,
        f"Argument `inside` must keep all limits, but leaves them by {-room:.2g} half-widths.",
    )
    close = _CLOSE * room
    for count in range(_MOST_CHORDS):
        if good < 1.0 and (room < close or count >= _CHORDS):
            break
        share = bad + (good - bad) * beyond / (beyond + room)
        middle = _mixed(candidate, inside, share)
        outside = float(problem.violation(middle))
        if outside <= -ROUNDING:
            good, found, room, beyond = share, middle, -outside, beyond / 2
        else:
            bad, beyond, room = share, outside, room / 2
    return found


def _mixed(one: JerkTrajectory, other: JerkTrajectory, share: Scalar | float) -> JerkTrajectory:
    return eqx.tree_at(lambda t: t.jerk, one, one.jerk + share * (other.jerk - one.jerk))
