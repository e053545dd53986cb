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

LAST_SMOOTHING = 0.0003  # of the objective's corners
_HALVING_SMOOTHING = 0.001  # where unfinished motions are compared


@runtime_checkable
class Chart(Protocol):
    """Motions by numbers of order one: a `MotionSpace`, or a family with less freedom."""

    def trajectory(self, z: Float[Array, " d"]) -> JerkTrajectory:
        """The motion with these numbers."""
        ...


class Stage(NamedTuple):
    """One stage of the descent.

    Attributes:
        penalty: ρ, the weight of a squared violation (in half-widths) against the objective.
        step: of Adam, in normalised trajectory; it shrinks to a fiftieth within the stage.
        smoothing: of the objective's corners.
    """

    penalty: Scalar
    step: Scalar
    smoothing: Scalar


class _Lanes(NamedTuple):
    z: Float[Array, "starts d"]
    multipliers: Multipliers


# motions that are improved at once: they stay in the second-level cache, a quarter faster than 64
_BATCH = 16


def stages(count: int) -> list[Stage]:
    """From loose to tight, geometrically."""
    columns = (
        jnp.geomspace(3.0, 100.0, count),
        jnp.geomspace(0.1, 0.01, count),
        jnp.geomspace(0.003, LAST_SMOOTHING, count),
    )
    return [Stage(*values) for values in zip(*columns, strict=True)]


def descend(
    problem: Problem, space: Chart, z: Float[Array, "starts d"], count: int, steps: int
) -> Float[Array, "survivors d"]:
    """All starts through the stages; before each stage but the first, the worse half is given up.

    Halving gives most of the time to the few that deserve it: the last stages decide between
    motions that differ by a per cent, the first between those that differ by ten. It ends at one
    batch: fewer motions would need a compilation of their own.

    Args:
        problem: its limits as penalties; what remains of a violation is left to `walk`.
        space: of the motions, a pytree.
        z: coordinates of the starts.
        count: of stages.
        steps: of gradient descent per stage.
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
    """One compilation for a batch, whatever the number of starts."""
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
        """A lane, and its multipliers pushed."""

        def step(
            carry: tuple[Float[Array, " d"], optax.OptState], _: None
        ) -> tuple[tuple[Float[Array, " d"], optax.OptState], None]:
            z, state = carry
            update, state = method.update(jax.grad(lagrangian)(z, multipliers), state)
            return (eqx.apply_updates(z, update), state), None

        (z, _), _ = jax.lax.scan(step, (z, method.init(z)), length=steps)
        return _Lanes(z, problem.pushed(space.trajectory(z), multipliers, stage.penalty))

    return jax.vmap(one)(*lanes)
