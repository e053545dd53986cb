"""Gradient descent of many starts together, by Adam on an augmented Lagrangian."""

from typing import NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float

from jaxid._types import Scalar
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.search.problem import Multipliers, Problem

LAST_SMOOTHING = 0.0003  # of the objective's kinks, in the last stage
_HALVING_SMOOTHING = 0.001  # of the objective's kinks, where motions are compared between stages


@runtime_checkable
class Chart(Protocol):
    """Coordinates of motions: a `MotionSpace`, or a family of motions with fewer parameters."""

    def trajectory(self, z: Float[Array, " d"]) -> JerkTrajectory:
        """Return the motion with the coordinates z, which are of order one."""
        ...


class Stage(NamedTuple):
    """The settings of one stage of the descent on the augmented Lagrangian.

    Attributes:
        penalty: penalty ρ of a squared violation (in half-widths), relative to the objective.
        step: step size of Adam in normalised coordinates; it falls to a fiftieth within the stage.
        smoothing: smoothing parameter of the objective's kinks.
    """

    penalty: Scalar
    step: Scalar
    smoothing: Scalar


class _Lanes(NamedTuple):
    z: Float[Array, "starts d"]
    multipliers: Multipliers


# motions per batch: they fit into the second-level cache, which is 25 % faster than 64
_BATCH = 16


def stages(count: int) -> list[Stage]:
    """Return `count` stages with geometrically growing penalty and shrinking step and smoothing."""
    columns = (
        jnp.geomspace(3.0, 100.0, count),
        jnp.geomspace(0.1, 0.01, count),
        jnp.geomspace(0.003, LAST_SMOOTHING, count),
    )
    return [Stage(*values) for values in zip(*columns, strict=True)]


def descend(
    problem: Problem, space: Chart, z: Float[Array, "starts d"], count: int, steps: int
) -> Float[Array, "survivors d"]:
    """Return improved motions from many starts, by gradient descent in stages.

    Before each stage but the first, the worse half of the motions is discarded, down to one batch
    of 16 motions, so that most of the time is spent on the best ones.

    Args:
        problem: objective, and limits as penalties; remaining violations are left to
            `jaxid.search.restoration.restored`.
        space: coordinates of the motions, a pytree.
        z: coordinates of the starts, one row each.
        count: number of stages.
        steps: number of gradient steps per stage.

    Returns:
        Coordinates of the motions that were not discarded, one row each.
    """
    shapes = jax.eval_shape(jax.vmap(lambda z: problem.violations(space.trajectory(z))), z)
    lanes = _Lanes(z, jax.tree.map(lambda c: jnp.zeros(c.shape, c.dtype), shapes))
    for k, stage in enumerate(stages(count)):
        if k and lanes.z.shape[0] > _BATCH:
            merits = jnp.concatenate([_merits(problem, space, part.z) for part in _batches(lanes)])
            better = jnp.argsort(merits)[: max(_BATCH, merits.size // 2)]
            lanes = jax.tree.map(lambda x, better=better: x[better], lanes)
        done = [_stage(problem, space, part, stage, steps) for part in _batches(lanes)]
        lanes = jax.tree.map(lambda *parts: jnp.concatenate(parts), *done)
    return lanes.z


def _batches(lanes: _Lanes) -> list[_Lanes]:
    """Return the lanes in batches of one size, for a single compilation."""
    return [
        jax.tree.map(lambda x, at=at: x[at : at + _BATCH], lanes)
        for at in range(0, lanes.z.shape[0], _BATCH)
    ]


@eqx.filter_jit
def _merits(problem: Problem, space: Chart, z: Float[Array, "starts d"]) -> Float[Array, " starts"]:
    return jax.vmap(lambda z: problem.merit(space.trajectory(z), _HALVING_SMOOTHING))(z)


@eqx.filter_jit
def _stage(problem: Problem, space: Chart, lanes: _Lanes, stage: Stage, steps: int) -> _Lanes:
    method = optax.adam(optax.linear_schedule(stage.step, 0.02 * stage.step, steps), b2=0.99)

    def lagrangian(z: Float[Array, " d"], multipliers: Multipliers) -> Scalar:
        motion = space.trajectory(z)
        return problem.lagrangian(motion, multipliers, stage.penalty, stage.smoothing)

    def one(z: Float[Array, " d"], multipliers: Multipliers) -> _Lanes:
        """Return an improved motion and its updated multipliers."""

        def step(
            carry: tuple[Float[Array, " d"], optax.OptState], _: None
        ) -> tuple[tuple[Float[Array, " d"], optax.OptState], None]:
            z, state = carry
            update, state = method.update(jax.grad(lagrangian)(z, multipliers), state)
            return (eqx.apply_updates(z, update), state), None

        (z, _), _ = jax.lax.scan(step, (z, method.init(z)), length=steps)
        return _Lanes(z, problem.pushed(space.trajectory(z), multipliers, stage.penalty))

    return jax.vmap(one)(*lanes)
