"""Global search by gradients for the motion that minimises any function of it, under limits (16).

The objective is a function of a trajectory and a smoothing parameter. The search does not depend on
what it computes.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from jaxid._progress import Report, silent, within
from jaxid.motion.motion_space import MotionSpace, motion_space
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory, trimmed
from jaxid.search.arc_structures import evolve_arcs
from jaxid.search.augmented_lagrangian import LAST_SMOOTHING, descend
from jaxid.search.effort import Effort
from jaxid.search.initial_guesses import grown, random_starts, rearranged
from jaxid.search.problem import Design, Objective, Problem, Show
from jaxid.search.restoration import interior_motion, restored
from jaxid.search.slp import refined


class _Reached(NamedTuple):
    """An admissible motion and its objective, inf where that is NaN."""

    value: float
    motion: JerkTrajectory


def multistart(
    task: Task,
    coarse: Objective,
    fine: Objective,
    key: PRNGKeyArray,
    *,
    shorter: JerkTrajectory | None = None,
    effort: Effort = Effort(),
    report: Report = silent,
    show: Show = lambda trajectory: None,
) -> Design:
    """Return the best motion found from many starts, refined by linear programs.

    Args:
        task: limits, start, end, via points and length of the motion.
        coarse: objective for the descent, a function of a trajectory and a smoothing parameter, of
            order one (e.g. the log of a positive quantity). Objectives of one kind share a
            compilation as an `equinox.Module` or as `jax.tree_util.Partial(function, data)`.
        fine: same objective on a finer grid, for the comparison of admissible motions and the
            refinement.
        key: JAX key of the random starts.
        shorter: good motion with fewer intervals, of which some starts are longer copies.
        effort: number of starts, steps and rounds.
        report: function that is called as each step begins, with its name and the share of the
            work that is done.
        show: function that is called with the best admissible motion after each descent and with
            each refined one.

    Raises:
        InfeasibleError: if no motion of this length keeps the limits.
        ValueError: if no motion was found whose axis keeps its limits.
    """
    problem, exact = Problem.of(task, coarse), Problem.of(task, fine)
    limits, boundary, intervals, period, _, size = task
    deep = interior_motion(problem, intervals, period, size)
    space = motion_space(limits, boundary, intervals, period, size)
    first, *keys = jax.random.split(key, effort.rounds + 1)
    steps = 1 + effort.rounds + 1 + effort.finalists
    report("random starts", 0.0)
    z = _first_starts(first, problem, space, intervals, shorter, effort)
    pool, history = [], []
    for k in range(effort.rounds + 1):
        if k:
            z = _variations(keys[k - 1], pool[: effort.parents], task, space, effort)
        report(f"gradient descent {k + 1} of {effort.rounds + 1}", (k + 1) / steps)
        z = descend(problem, space, z, effort.stages, effort.steps)
        pool = sorted([*pool, *_admissible(exact, deep, space, z)], key=_value)[: len(z)]
        history.append(pool[0].value)
        show(pool[0].motion)
    last = within(report, (steps - effort.finalists) / steps, 1.0)
    best = _refined(exact, deep, pool[: effort.finalists], effort, last, show)
    return Design(trimmed(best.motion), best.value, tuple(history))


def _variations(
    key: PRNGKeyArray, best: list[_Reached], task: Task, space: MotionSpace, effort: Effort
) -> Float[Array, "starts d"]:
    """Return the best motions and rearranged copies of each."""
    parents = [np.asarray(one.motion.jerk)[: task.intervals] for one in best]
    fastest = float(np.max(np.abs(task.limits.acceleration)))
    return rearranged(key, space, parents, task.period, fastest, effort.variations)


def _refined(
    problem: Problem,
    deep: JerkTrajectory,
    finalists: list[_Reached],
    effort: Effort,
    report: Report,
    show: Show,
) -> _Reached:
    found = []
    for k, one in enumerate(finalists, start=1):
        report(f"local refinement {k} of {len(finalists)}", (k - 1) / len(finalists))
        motion = refined(problem, deep, one.motion, effort.programs, effort.smoothings)
        found.append(_reached(problem, motion, 0.0))
        show(motion)
    return min(found, key=_value)


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


def _admissible(
    problem: Problem, deep: JerkTrajectory, space: MotionSpace, z: Float[Array, "starts d"]
) -> list[_Reached]:
    """Return the motions restored to the limits, with their smoothed objectives.

    One motion after the other, by functions that the refinement needs too: a function for all of
    them together takes longer to compile than to compute.
    """
    motions = (restored(problem, deep, _motion(space, one)) for one in np.asarray(z))
    return [_reached(problem, motion, LAST_SMOOTHING) for motion in motions]


@eqx.filter_jit
def _motion(space: MotionSpace, z: Float[Array, " d"]) -> JerkTrajectory:
    return space.trajectory(z)


def _reached(problem: Problem, motion: JerkTrajectory, smoothing: float) -> _Reached:
    """Return a motion with its objective, from the function that also gives the slope."""
    value = float(problem.value_and_slope(motion, smoothing)[0])
    return _Reached(float("inf") if np.isnan(value) else value, motion)


def _value(one: _Reached) -> float:
    return one.value
