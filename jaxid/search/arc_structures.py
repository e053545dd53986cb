"""Starts of a search: motions of constant speeds with fast changes between them.

Good motions hold a few speeds: the top speed, one just above a threshold of δ, or zero. Gradients
do not find which speeds in which order. A motion of constant speeds has few parameters, so an
evolutionary search finds them by values of the objective alone, in many small populations.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxid._types import Scalar
from jaxid.motion.limits import Limits
from jaxid.motion.motion_space import MotionSpace
from jaxid.search.problem import Problem

# constant speeds per motion, motions per population, and populations per batch
_DWELLS, MEMBERS, _POPULATIONS = 7, 12, 8
# uniform random numbers per child, drawn together to save compilation
_CHOICES = 8 + _DWELLS
# smoothing of the objective: the same as at the start of the descent
_SMOOTHING = 0.003


class Arcs(NamedTuple):
    """The parameters of a motion of k constant speeds, held one after the other.

    Attributes:
        speeds: signed speeds in order, m/s or rad/s.
        shares: share of the time at each speed, at least zero and in any unit; the time is what
            the changes of speed leave of the duration.
    """

    speeds: Float[Array, "*batch k"]
    shares: Float[Array, "*batch k"]


def evolve_arcs(
    key: PRNGKeyArray, problem: Problem, space: MotionSpace, count: int, generations: int
) -> Float[Array, "count d"]:
    """Return the best motion of constant speeds from each of `count` evolved populations.

    Args:
        key: JAX key of the random choices.
        problem: objective and limits of the motions.
        space: coordinates of the motions, onto which they are projected.
        count: number of populations.
        generations: number of generations of each population.

    Returns:
        Coordinates in `space`, one row per population.
    """
    # batches of one size need a single compilation
    keys = jax.random.split(key, -(-count // _POPULATIONS))
    batches = [_evolve(key, problem, space, generations) for key in keys]
    return jnp.concatenate(batches)[:count]


@eqx.filter_jit
def _evolve(
    key: PRNGKeyArray, problem: Problem, space: MotionSpace, generations: int
) -> Float[Array, "populations d"]:
    limits, count = problem.limits, _POPULATIONS

    def coordinates(dwells: Arcs) -> Float[Array, " d"]:
        return space.coordinates(jerk_of(dwells, limits, space))

    def merit(dwells: Arcs) -> Scalar:
        return problem.merit(space.trajectory(coordinates(dwells)), _SMOOTHING)

    def merits(dwells: Arcs) -> Float[Array, "populations members"]:
        flat = jax.tree.map(lambda x: x.reshape(-1, _DWELLS), dwells)
        return jax.lax.map(merit, flat, batch_size=16).reshape(count, MEMBERS)

    def generation(
        carry: tuple[Arcs, Float[Array, "populations members"]], key: PRNGKeyArray
    ) -> tuple[tuple[Arcs, Float[Array, "populations members"]], None]:
        """Let each member, or a better one of its population, have a child that may replace it."""
        members, values = carry
        u = jax.random.uniform(key, (*values.shape, 2 + _CHOICES))
        met, mate = jnp.moveaxis(_choice(u[..., :2], MEMBERS), -1, 0)
        better = jnp.take_along_axis(values, met, axis=1) < values
        own = jnp.broadcast_to(jnp.arange(MEMBERS), values.shape)
        parents = _take(members, jnp.where(better, met, own))
        vary = jax.vmap(jax.vmap(_child, (0, 0, 0, None)), (0, 0, 0, None))
        children = vary(u[..., 2:], parents, _take(members, mate), limits)
        reached = merits(children)
        kept = jax.tree.map(
            lambda child, own: jnp.where((reached < values)[..., None], child, own),
            children,
            members,
        )
        return (kept, jnp.minimum(reached, values)), None

    keys = jax.random.split(key, generations + 1)
    u = jax.random.uniform(keys[0], (4, count, MEMBERS, _DWELLS))
    members = Arcs(_random_speed(u[0], u[1], u[2], limits), -jnp.log1p(-u[3]))
    unknown = jnp.full((count, MEMBERS), jnp.inf)  # so that every first child is accepted
    (members, values), _ = jax.lax.scan(generation, (members, unknown), keys[1:])
    best = _take(members, jnp.argmin(values, axis=1)[:, None])
    return jax.vmap(lambda one: coordinates(jax.tree.map(lambda x: x[0], one)))(best)


def jerk_of(dwells: Arcs, limits: Limits, space: MotionSpace) -> Float[Array, " n"]:
    """Return the jerk of a motion of constant speeds that ends with zero speed.

    Every change of speed is as fast as whole intervals and the limits allow: r intervals of jerk, c
    of constant acceleration, r of the opposite jerk. The end position is not controlled; the
    projection onto `space` corrects it.

    Args:
        dwells: parameters of one motion.
        limits: limits of acceleration and jerk.
        space: start state and intervals of the motion; padding gets no jerk.
    """
    period, intervals = space.durations[0], jnp.sum(space.durations > 0)
    fastest = jnp.min(jnp.abs(limits.acceleration))
    jerk = jnp.min(jnp.abs(limits.jerk))
    change = jnp.diff(dwells.speeds, prepend=space.start[1], append=0.0)
    size = jnp.abs(change)
    longest = jnp.ceil(fastest / (jerk * period))
    r = jnp.clip(jnp.floor(jnp.sqrt(size / jerk) / period), 1.0, longest)
    peak = jnp.minimum(fastest, jerk * r * period)
    c = jnp.maximum(jnp.ceil(size / (peak * period)) - r, 0.0)
    length = jnp.where(size > 0, 2 * r + c, 0.0)
    left = jnp.maximum(intervals - jnp.sum(length), 0.0)
    held = jnp.cumsum(dwells.shares) / jnp.maximum(jnp.sum(dwells.shares), 1e-12) * left
    begin = jnp.cumsum(length) - length + jnp.append(0.0, jnp.round(held))
    heights = change / ((r + c) * period)

    def acceleration(knot: Scalar) -> Scalar:
        since = jnp.minimum(knot, intervals) - begin
        return heights @ jnp.clip(jnp.minimum(since, length - since) / r, 0.0, 1.0)

    return jnp.diff(jax.vmap(acceleration)(jnp.arange(space.durations.size + 1.0))) / period


def _child(u: Float[Array, " choices"], parent: Arcs, mate: Arcs, limits: Limits) -> Arcs:
    """Return a variation of the parent by one of six random operators.

    They change all shares, move a share, replace a speed, scale a speed, continue as the mate, or
    swap two speeds.
    """
    speeds, shares = parent
    i, j = _choice(u[0], _DWELLS), _choice(u[1], _DWELLS)
    spread = 10.0 ** (2.0 * u[2] - 2.0)
    factors = jnp.exp(spread * (4.0 * u[-_DWELLS:] - 2.0))
    moved = u[3] * shares[i]
    tuned = jnp.clip(speeds.at[i].multiply(factors[i]), *limits.velocity)
    first = jnp.arange(_DWELLS) < i
    kinds = (
        Arcs(speeds, shares * factors),
        Arcs(speeds, shares.at[i].add(-moved).at[j].add(moved)),
        Arcs(speeds.at[i].set(_random_speed(u[4], u[5], u[6], limits)), shares),
        Arcs(tuned, shares),
        jax.tree.map(lambda a, b: jnp.where(first, a, b), parent, mate),
        jax.tree.map(lambda x: x.at[i].set(x[j]).at[j].set(x[i]), parent),
    )
    kind = _choice(u[7], len(kinds))
    return jax.tree.map(lambda *options: jnp.stack(options)[kind], *kinds)


def _random_speed(kind: Array, sign: Array, size: Array, limits: Limits) -> Float[Array, "..."]:
    """Return a speed at a limit (35 %), log-uniform over two decades below (55 %), or 0 (10 %)."""
    extreme = jnp.where(sign < 0.5, *limits.velocity)
    slower = extreme * 10.0 ** (-2.0 * size)
    return jnp.select([kind < 0.35, kind < 0.9], [extreme, slower], 0.0)


def _choice(u: Array, count: int) -> Array:
    """Return a whole number from 0 to `count` − 1, from a uniform number u in [0, 1)."""
    return jnp.floor(u * count).astype(int)


def _take(members: Arcs, which: Array) -> Arcs:
    return jax.tree.map(lambda x: jnp.take_along_axis(x, which[..., None], axis=1), members)
