"""The best member of a family of motions, sought as hard as any design is.

The same descent, from as many starts and by as many evaluations, and then the same kind of polish:
linear programs in a trust region, on the numbers of the family.
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

_SMOOTHING = 1e-3  # where starts are compared
_CHOSEN = 128  # of the starts that are descended from


class Budget(NamedTuple):
    """How long to search.

    Attributes:
        starts: motions to begin with.
        evaluations: of the objective in all.
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
    """The numbers of the best few, each walked back into the limits.

    Args:
        problem: to solve.
        inside: a strictly admissible motion.
        family: of motions.
        key: of the starts.
        budget: for starts and descent.
        count: how many to return.
    """
    z = jax.random.normal(key, (budget.starts, family.size))
    z = z[jnp.argsort(_merits(problem, family, z))[:_CHOSEN]]
    # the worse half is given up twice
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
    """Improve one member; of those on the way, walked back into the limits, the best.

    Args:
        problem: its objective smoothed, its limits kept exactly by what is returned.
        inside: a strictly admissible motion.
        family: of motions.
        z: where to begin.
        programs: linear programs, at most, per smoothing.
        smoothings: of the objective, one after the other.
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
    """Of a member: its value when walked back into the limits, and the slope without that."""
    slope = _slope(problem, family, z, smoothing)
    value = _smoothed(problem, restored(problem, inside, family.trajectory(z)), smoothing)
    return Point(np.asarray(z), float(value), np.asarray(slope))


def _of_numbers(limits: Inequalities, family: Excitation, z: Numbers) -> Inequalities:
    """The limits, linear in the change of the numbers; end conditions hold for every member."""
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
