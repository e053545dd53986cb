"""A local search for the plants that exceed the limits of the axis the most."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jaxid._types import Scalar
from jaxid.loop.closed_loop import ClosedLoop
from jaxid.loop.disturbances import Sequence
from jaxid.loop.scenarios import Scenarios, random_forces, random_parameters
from jaxid.loop.simulate import Plant
from jaxid.model.system import System
from jaxid.motion.limits import Limits
from jaxid.motion.trajectory import JerkTrajectory

# steps by signs; one is nearly enough, because a loop that tracks well is almost linear in Δ
_ROUNDS = 6
_SIDES = 6  # position, velocity and input, each below and above


class _Plants(eqx.Module):
    """One plant, or several along a leading axis."""

    theta: Float[Array, "*k m"]
    shares: Float[Array, "*k n"]


def find_worst_case_plants(
    loop: ClosedLoop,
    system: System,
    limits: Limits,
    trajectory: JerkTrajectory,
    key: PRNGKeyArray,
    count: int,
) -> Scenarios:
    """Return `count` plants, each found by a local search for the largest excess of one limit.

    The plants take the lower and upper limits of position, velocity and input in turn. Each search
    starts at a random point of Ω_θ, or at the corner next to it, with random Δ. It moves θ to
    corners and Δ to ±δ by the sign of the gradient of the excess, six times, and keeps the worst
    plant.

    Args:
        loop: closed loop, with a sensor that can be differentiated (`IdealSensor`).
        system: system whose prior box and δ the plants keep.
        limits: limits of the axis.
        trajectory: motion.
        key: JAX key of the random starts; plant k depends only on it and on k.
        count: number of plants.
    """
    first, second = jax.random.split(key)
    inner = random_parameters(first, system, count)
    which = jnp.arange(count)
    corners = jnp.where(inner > system.centre[None], system.upper[None], system.lower[None])
    # each side of each limit is searched from corners and from inner points
    theta = jnp.where((which // _SIDES % 2 == 0)[:, None], corners, inner)
    forces = random_forces(second, loop.ticks * loop.repeats, count)
    starts = _Plants(theta, forces.shares)
    found = _searched(loop, system, limits, trajectory, starts, which % _SIDES)
    return Scenarios(system, found.theta, jax.vmap(Sequence)(found.shares))


@eqx.filter_jit
def _searched(
    loop: ClosedLoop,
    system: System,
    limits: Limits,
    trajectory: JerkTrajectory,
    starts: _Plants,
    sides: Int[Array, " k"],
) -> _Plants:
    def excess(plant: _Plants, side: Int[Array, ""]) -> Scalar:
        """Return the largest violation of one side of a limit, relative to its range."""
        actual = Plant(system, plant.theta, Sequence(plant.shares))
        signals = loop(actual, trajectory)[1]
        columns = (signals.position, signals.velocity, signals.input)
        intervals = (limits.position, limits.velocity, limits.input)
        levels = []
        for values, (low, high) in zip(columns, intervals, strict=True):
            levels += [jnp.max(low - values) / (high - low), jnp.max(values - high) / (high - low)]
        return jnp.stack(levels)[side]

    def one(start: _Plants, side: Int[Array, ""]) -> _Plants:
        """Return the worst plant found from one start."""

        def step(
            carry: tuple[_Plants, _Plants, Scalar], _: None
        ) -> tuple[tuple[_Plants, _Plants, Scalar], None]:
            """Move to the corner at the signs of the gradient, and keep the best plant so far."""
            plant, best, reached = carry
            value, slope = jax.value_and_grad(excess)(plant, side)
            better = value > reached
            best = jax.tree.map(lambda a, b: jnp.where(better, a, b), plant, best)
            theta = jnp.where(slope.theta > 0, system.upper, system.lower)
            pushed = _Plants(theta, jnp.where(slope.shares > 0, 1.0, -1.0))
            return (pushed, best, jnp.maximum(value, reached)), None

        carry = (start, start, jnp.asarray(-jnp.inf))
        (last, best, reached), _ = jax.lax.scan(step, carry, length=_ROUNDS)
        better = excess(last, side) > reached
        return jax.tree.map(lambda a, b: jnp.where(better, a, b), last, best)

    # in batches: the gradients of all plants together would need too much memory
    return jax.lax.map(lambda pair: one(*pair), (starts, sides), batch_size=10)
