"""Global search by gradients for the motion that minimises any function of it, under limits (16).

The objective is a function of a trajectory and a smoothing parameter. The search does not depend on
what it computes.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxid._types import Scalar
from jaxid.motion.motion_space import MotionSpace, motion_space
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory, trimmed
from jaxid.search.arc_structures import evolve_arcs
from jaxid.search.augmented_lagrangian import LAST_SMOOTHING, descend
from jaxid.search.effort import Effort
from jaxid.search.initial_guesses import grown, random_starts, rearranged
from jaxid.search.problem import Design, Objective, Problem, Report, Show
from jaxid.search.restoration import interior_motion, restored
from jaxid.search.slp import refined


class _Pool(NamedTuple):
    """Admissible motions, best first, and the objective of each."""

    trajectories: JerkTrajectory
    values: Float[Array, " k"]


def multistart(
    task: Task,
    coarse: Objective,
    fine: Objective,
    key: PRNGKeyArray,
    *,
    shorter: JerkTrajectory | None = None,
    effort: Effort = Effort(),
    report: Report = lambda message: None,
    show: Show = lambda trajectory: None,
) -> Design:
    """Return the best motion found from many starts, refined by linear programs.

    Args:
        task: limits, start, end, via points and length of the motion.
        coarse: objective for the descent, a function of a trajectory and a smoothing parameter, of
            order one (e.g. the log of a positive quantity). Objectives of one kind share a
            compilation as an `equinox.Module` or as `jax.tree_util.Partial(function, data)`.
        fine: same objective on a finer grid, for the refinement and the final choice.
        key: JAX key of the random starts.
        shorter: good motion with fewer intervals, of which some starts are longer copies.
        effort: number of starts, steps and rounds.
        report: function that is called with the name of each stage as it begins.
        show: function that is called with the best admissible motion after each descent and with
            each refined one.

    Raises:
        InfeasibleError: if no motion of this length keeps the limits.
        ValueError: if no motion was found whose axis keeps its limits.
    """
    problem, (limits, boundary, intervals, period, _, size) = Problem.of(task, coarse), task
    deep = interior_motion(problem, intervals, period, size)
    space = motion_space(limits, boundary, intervals, period, size)
    first, *keys = jax.random.split(key, effort.rounds + 1)
    report("random starts")
    z = _first_starts(first, problem, space, intervals, shorter, effort)
    pool, history = None, []
    for k in range(effort.rounds + 1):
        if pool is not None:
            z = _variations(keys[k - 1], pool, task, space, effort)
        report(f"gradient descent {k + 1} of {effort.rounds + 1}")
        z = descend(problem, space, z, effort.stages, effort.steps)
        found = _admissible(problem, deep, space, z)
        pool = found if pool is None else _best(pool, found)
        history.append(float(pool.values[0]))
        show(_pick(pool, 0))
    assert pool is not None
    value, best = _refined(Problem.of(task, fine), deep, pool, effort, report, show)
    return Design(trimmed(best), value, tuple(history))


def _variations(
    key: PRNGKeyArray, pool: _Pool, task: Task, space: MotionSpace, effort: Effort
) -> Float[Array, "starts d"]:
    """Return the best motions and rearranged copies of each."""
    count = min(effort.parents, pool.values.size)
    parents = [_pick(pool, i).jerk[: task.intervals] for i in range(count)]
    fastest = float(jnp.max(jnp.abs(task.limits.acceleration)))
    return rearranged(key, space, parents, task.period, fastest, effort.variations)


def _refined(
    problem: Problem,
    deep: JerkTrajectory,
    pool: _Pool,
    effort: Effort,
    report: Report,
    show: Show,
) -> tuple[float, JerkTrajectory]:
    finalists = []
    for k in range(min(effort.finalists, pool.values.size)):
        report(f"local refinement {k + 1} of {effort.finalists}")
        motion = refined(problem, deep, _pick(pool, k), effort.programs, effort.smoothings)
        reached = jnp.nan_to_num(_value(problem, motion, 0.0), nan=jnp.inf)
        finalists.append((float(reached), k, motion))
        show(motion)
    value, _, best = min(finalists)  # k orders motions of equal value
    return value, best


def _first_starts(
    key: PRNGKeyArray,
    problem: Problem,
    space: MotionSpace,
    intervals: int,
    shorter: JerkTrajectory | None,
    effort: Effort,
) -> Float[Array, "starts d"]:
    """Return the starts: an eighth random, the others of constant speeds.

    With a shorter motion, half of the latter are replaced by longer copies of it.
    """
    keys = jax.random.split(key, 3)
    made = effort.starts - effort.starts // 8
    copies = 0 if shorter is None else made // 2
    dwells = made - copies if effort.generations else 0
    parts = [random_starts(keys[0], space, effort.starts - dwells - copies)]
    if dwells:
        parts.append(evolve_arcs(keys[1], problem, space, dwells, effort.generations))
    if copies:
        assert shorter is not None
        parts.append(grown(keys[2], space, [trimmed(shorter).jerk], intervals, copies))
    return jnp.concatenate(parts)


@eqx.filter_jit
def _value(problem: Problem, trajectory: JerkTrajectory, smoothing: float) -> Scalar:
    return problem.objective(trajectory, jnp.asarray(smoothing))


@eqx.filter_jit
def _admissible(
    problem: Problem, deep: JerkTrajectory, space: MotionSpace, z: Float[Array, "starts d"]
) -> _Pool:
    """Return the motions restored to the limits, best first."""

    def one(z: Float[Array, " d"]) -> tuple[JerkTrajectory, Scalar]:
        found = restored(problem, deep, space.trajectory(z))
        return found, problem.objective(found, jnp.asarray(LAST_SMOOTHING))

    return _sorted(_Pool(*jax.vmap(one)(z)))


@eqx.filter_jit
def _best(one: _Pool, other: _Pool) -> _Pool:
    """Return the best motions of both pools, as many as `other` holds."""
    both = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), one, other)
    return jax.tree.map(lambda x: x[: other.values.size], _sorted(both))


def _sorted(pool: _Pool) -> _Pool:
    # a motion with a NaN must not be sorted first
    order = jnp.argsort(jnp.nan_to_num(pool.values, nan=jnp.inf))
    return jax.tree.map(lambda x: x[order], pool)


def _pick(pool: _Pool, k: int) -> JerkTrajectory:
    return jax.tree.map(lambda x: x[k], pool.trajectories)
