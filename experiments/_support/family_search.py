"""Search for the best member of a family of motions, with the same effort as for a design.

It uses the same descent, from as many starts and with as many evaluations, and then the same kind
of refinement: linear programs in a trust region, in the free parameters of the family.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from experiments._support.excitations import Excitation, Numbers
from jaxid._types import Scalar
from jaxid.motion.inequalities import Inequalities, inequalities
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.search.augmented_lagrangian import descend
from jaxid.search.problem import Problem
from jaxid.search.restoration import restored
from jaxid.search.slp import Point, TrustRegion, Vector, improvements

_SMOOTHING = 1e-3  # smoothing of the objective at which starts are compared
_CHOSEN = 128  # starts that are selected for the descent


class Budget(NamedTuple):
    """The effort of a search.

    Attributes:
        starts: number of motions to start from.
        evaluations: total number of evaluations of the objective.
    """

    starts: int
    evaluations: int


def best_members(
    problem: Problem,
    inside: JerkTrajectory,
    family: Excitation,
    key: PRNGKeyArray,
    budget: Budget,
    count: int,
) -> list[Numbers]:
    """Return the free parameters of the best members, compared after restoration to the limits.

    Args:
        problem: problem to solve.
        inside: motion with a margin to all limits, for the restoration.
        family: family of motions.
        key: JAX key of the random starts.
        budget: effort for starts and descent.
        count: number of members to return.
    """
    z = jax.random.normal(key, (budget.starts, family.size))
    z = z[jnp.argsort(_merits(problem, family, z))[:_CHOSEN]]
    # the descent drops the worse half of the members twice
    steps = -(-(budget.evaluations - budget.starts) // (_CHOSEN + _CHOSEN // 2 + _CHOSEN // 4))
    z = descend(problem, family, z, 3, steps)
    return list(z[jnp.argsort(_values(problem, inside, family, z))[:count]])


def polished_member(
    problem: Problem,
    inside: JerkTrajectory,
    family: Excitation,
    z: Numbers,
    programs: int,
    smoothings: Sequence[float],
) -> tuple[Numbers, JerkTrajectory]:
    """Improve one member; return the best one on the way, and its motion restored to the limits.

    Args:
        problem: problem whose objective is smoothed; the returned motion keeps its limits exactly.
        inside: motion with a margin to all limits, for the restoration.
        family: family of motions.
        z: free parameters to start from.
        programs: largest number of linear programs per smoothing.
        smoothings: smoothing parameters of the objective, in order.
    """
    region = TrustRegion(0.03, 1e-7, programs)
    best, found = z, restored(problem, inside, family.trajectory(z))
    value = float(problem.value(found))
    limits = inequalities(problem.limits, problem.boundary, found.jerk.size, _period(found))
    for smoothing in map(jnp.asarray, smoothings):

        def evaluate(
            x: Vector, before: Numbers, smoothing: Scalar = smoothing
        ) -> tuple[Point, Numbers]:
            z = jnp.asarray(x)
            return _point(problem, inside, family, z, smoothing), z

        first = _point(problem, inside, family, z, smoothing), z
        steps = improvements(evaluate, lambda z: _of_numbers(limits, family, z), first, region)
        for z in steps:
            motion = restored(problem, inside, family.trajectory(z))
            if (reached := float(problem.value(motion))) < value:
                value, best, found = reached, z, motion
    return best, found


def _period(motion: JerkTrajectory) -> float:
    return float(motion.durations[0])


def _point(
    problem: Problem, inside: JerkTrajectory, family: Excitation, z: Numbers, smoothing: Scalar
) -> Point:
    """Return the value of a member after restoration, and its gradient without restoration."""
    slope = _slope(problem, family, z, smoothing)
    value = _smoothed(problem, restored(problem, inside, family.trajectory(z)), smoothing)
    return Point(np.asarray(z), float(value), np.asarray(slope))


def _of_numbers(limits: Inequalities, family: Excitation, z: Numbers) -> Inequalities:
    """Return the limits, linearised in the free parameters; all members keep the end conditions."""
    jerk, slopes = (np.asarray(x) / limits.unit for x in _linearised(family, z))
    half = np.ptp(limits.jerk) / limits.unit / 2
    rows = np.vstack([limits.rows[~limits.fixed], np.eye(jerk.size) / half])
    low, high = (end / limits.unit / half for end in limits.jerk)
    lower = np.append(limits.lower[~limits.fixed], np.full(jerk.size, low))
    upper = np.append(limits.upper[~limits.fixed], np.full(jerk.size, high))
    shift = rows @ (slopes @ np.asarray(z) - jerk)
    free = np.array([-np.inf, np.inf])
    return Inequalities(rows @ slopes, lower + shift, upper + shift, free, 1.0)


@eqx.filter_jit
def _linearised(family: Excitation, z: Numbers) -> tuple[Float[Array, " n"], Float[Array, "n d"]]:
    def jerk(z: Numbers) -> Float[Array, " n"]:
        return family.trajectory(z).jerk

    return jerk(z), jax.jacfwd(jerk)(z)


@eqx.filter_jit
def _slope(problem: Problem, family: Excitation, z: Numbers, smoothing: Scalar) -> Numbers:
    return jax.grad(lambda z: problem.objective(family.trajectory(z), smoothing))(z)


@eqx.filter_jit
def _smoothed(problem: Problem, motion: JerkTrajectory, smoothing: Scalar) -> Scalar:
    return problem.objective(motion, smoothing)


@eqx.filter_jit
def _merits(problem: Problem, family: Excitation, z: Float[Array, "k d"]) -> Float[Array, " k"]:
    def merit(z: Numbers) -> Scalar:
        return problem.merit(family.trajectory(z), _SMOOTHING)

    return jax.lax.map(merit, z, batch_size=16)


@eqx.filter_jit
def _values(
    problem: Problem, inside: JerkTrajectory, family: Excitation, z: Float[Array, "k d"]
) -> Float[Array, " k"]:
    def value(z: Numbers) -> Scalar:
        return problem.value(restored(problem, inside, family.trajectory(z)))

    return jax.lax.map(value, z, batch_size=16)
