"""Ways back into the limits, those of the motion and, if a problem has them, those of the axis."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxid.feasible import interior
from jaxid.problem import Problem
from jaxid.system import Scalar
from jaxid.trajectory import JerkTrajectory

# half-widths: whoever recomputes the extrema in another order still finds the limits kept
ROUNDING = 1e-14


def inside(
    problem: Problem, intervals: int, period: float, size: int | None = None
) -> JerkTrajectory:
    """A motion strictly inside all limits.

    The deepest within the limits of the motion; if the axis still leaves its own, the deepest with
    less acceleration.

    Args:
        problem: its limits and boundary.
        intervals: n, how many pieces of constant jerk.
        period: T of each, s.
        size: pad to this many intervals; default no padding.

    Raises:
        InfeasibleError: if no motion keeps its limits, which a linear program proves.
        ValueError: if one does, but none was found whose axis keeps its own.
    """
    limits, beyond = problem.limits, float("inf")
    for share in np.linspace(1.0, 0.4, 7):
        gentler = eqx.tree_at(lambda x: x.acceleration, limits, share * limits.acceleration)
        found = interior(gentler, problem.boundary, intervals, period, size)
        beyond = float(problem.violation(found))
        if beyond < 0:
            return found
    raise ValueError(
        f"Argument `limits`: the axis leaves them by {beyond:.2g} half-widths even on the "
        f"gentlest motion tried ({intervals} intervals of {period:g} s): allow a longer motion."
    )


@eqx.filter_jit
def walk(problem: Problem, inside: JerkTrajectory, candidate: JerkTrajectory) -> JerkTrajectory:
    """The last admissible motion on the way from a strictly admissible one to `candidate`.

    The admissible motions are a convex set, so the share of the way is found by bisection, to the
    last bit. With an axis that must be simulated `stepped_back` is quicker.
    """

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
    """The candidate if it is admissible, or an admissible motion a little nearer to `inside`.

    Steps on linearised conditions leave the limits of the axis by very little, so the shares of
    the way back grow from 1e-7; `inside` itself comes last.
    """
    for share in (0.0, *np.geomspace(1e-7, 1.0, 15)):
        found = _mixed(candidate, inside, share)
        if float(problem.violation(found)) <= -ROUNDING:
            return found
    raise ValueError(
        "Argument `inside` must keep all limits, but leaves them by "
        f"{float(problem.violation(inside)):.2g} half-widths."
    )


def _mixed(one: JerkTrajectory, other: JerkTrajectory, share: Scalar | float) -> JerkTrajectory:
    return eqx.tree_at(lambda t: t.jerk, one, one.jerk + share * (other.jerk - one.jerk))
