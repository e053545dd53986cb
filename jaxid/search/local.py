"""Improvement of one given motion, for any objective and with limits on the axis itself.

Quasi-Newton steps with a line search on an augmented Lagrangian come first, then linear programs.
Only admissible improvements are accepted.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float

from jaxid._progress import Report, silent
from jaxid._types import Scalar
from jaxid.motion.motion_space import MotionSpace, motion_space
from jaxid.motion.trajectory import JerkTrajectory, trimmed
from jaxid.search.effort import Effort
from jaxid.search.frozen_loop import freeze
from jaxid.search.problem import Design, Multipliers, Problem
from jaxid.search.restoration import interior_motion
from jaxid.search.slp import refined, repaired

_ROUNDED = 1e-9  # of the objective: smallest improvement


def improve(
    problem: Problem,
    start: JerkTrajectory,
    effort: Effort = Effort(),
    report: Report = silent,
) -> Design:
    """Return an improved motion that keeps all limits, from a given one that may violate them.

    The start is first restored to the limits; later steps never make it worse.

    Args:
        problem: objective, limits, and the prediction of the axis.
        start: motion with intervals of equal duration.
        effort: numbers of steps of the improvement.
        report: function that is called as each step begins, with its name and the share of the
            work that is done.

    Raises:
        InfeasibleError: if no motion of this length keeps the limits of the motion.
        ValueError: if no motion was found whose axis keeps its limits.
    """
    start = trimmed(start)
    intervals, period = start.jerk.size, float(start.durations[0])
    deep = interior_motion(problem, intervals, period)
    space = motion_space(problem.limits, problem.boundary, intervals, period)
    best = repaired(problem, deep, start)
    history = [float(problem.value(best))]

    def accept(candidate: JerkTrajectory) -> None:
        nonlocal best
        value = float(problem.value(candidate))
        if value < history[-1] - _ROUNDED and float(problem.violation(candidate)) <= 0:
            best = candidate
            history.append(value)

    if effort.newton_rounds:
        report("quasi-Newton steps", 0.0)
        z = space.coordinates(best.jerk)
        found = space.trajectory(_quasi_newton(_still(problem, best), space, z, effort))
        if jnp.all(jnp.isfinite(found.jerk)):  # NaN if the objective has no gradient
            accept(repaired(problem, deep, found))
    report("linear programs", 0.5 if effort.newton_rounds else 0.0)
    accept(refined(problem, deep, best, effort.programs, effort.smoothings))
    return Design(best, history[-1], tuple(history))


def _still(problem: Problem, trajectory: JerkTrajectory) -> Problem:
    """Return the problem with fixed deviations of the axis from its motion, without simulation."""
    if problem.axis is None:
        return problem
    axis = freeze(problem.axis, problem.limits, trajectory)
    return eqx.tree_at(lambda p: p.axis, problem, axis)


@eqx.filter_jit
def _quasi_newton(
    problem: Problem, space: MotionSpace, z: Float[Array, " d"], effort: Effort
) -> Float[Array, " d"]:
    """Return coordinates improved by L-BFGS steps on an augmented Lagrangian."""
    penalty, smoothing = jnp.asarray(effort.newton_penalty), jnp.asarray(effort.newton_smoothing)
    method = optax.lbfgs()

    def round_of_steps(
        carry: tuple[Float[Array, " d"], Multipliers], _: None
    ) -> tuple[tuple[Float[Array, " d"], Multipliers], None]:
        """Take some steps with fixed multipliers, then update the multipliers."""
        z, multipliers = carry

        def lagrangian(z: Float[Array, " d"]) -> Scalar:
            return problem.lagrangian(space.trajectory(z), multipliers, penalty, smoothing)

        value_and_grad = optax.value_and_grad_from_state(lagrangian)

        def step(
            carry: tuple[Float[Array, " d"], optax.OptState], _: None
        ) -> tuple[tuple[Float[Array, " d"], optax.OptState], None]:
            """Take one step, its length by a line search."""
            z, state = carry
            value, grad = value_and_grad(z, state=state)
            update, state = method.update(
                grad, state, z, value=value, grad=grad, value_fn=lagrangian
            )
            return (eqx.apply_updates(z, update), state), None

        z = jax.lax.scan(step, (z, method.init(z)), length=effort.newton_steps)[0][0]
        return (z, problem.pushed(space.trajectory(z), multipliers, penalty)), None

    nothing = jax.tree.map(jnp.zeros_like, problem.violations(space.trajectory(z)))
    (z, _), _ = jax.lax.scan(round_of_steps, (z, nothing), length=effort.newton_rounds)
    return z
