"""The plants that a closed loop may meet."""

import itertools
from collections.abc import Callable, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from jaxid.loop.disturbances import Disturbance, Mixture, random_shares
from jaxid.loop.disturbances import Sequence as Forces
from jaxid.loop.simulate import Plant
from jaxid.model.system import System

Result = TypeVar("Result")


class Scenarios(eqx.Module):
    """K plants of one system.

    Attributes:
        system: of all of them.
        theta: their parameters.
        disturbance: one in kind; every array in it has K entries along its first axis.
    """

    system: System
    theta: Float[Array, "k m"]
    disturbance: Disturbance

    def __getitem__(self, chosen: Int[Array | np.ndarray, " c"]) -> "Scenarios":
        """The plants of these numbers."""
        parts = jax.tree.map(lambda x: x[chosen], (self.theta, self.disturbance))
        return Scenarios(self.system, *parts)

    def map(self, function: Callable[[Plant], Result]) -> Result:
        """The results for every plant, along a new first axis."""

        def one(theta: Float[Array, " m"], disturbance: Disturbance) -> Result:
            return function(Plant(self.system, theta, disturbance))

        if self.theta.shape[0] > 1:
            return jax.vmap(one)(self.theta, self.disturbance)
        # a batch of one takes a quarter longer than no batch
        only = one(*jax.tree.map(lambda x: x[0], (self.theta, self.disturbance)))
        return jax.tree.map(lambda x: x[None], only)


def every(
    system: System, thetas: Float[Array, "p m"], disturbances: Sequence[Disturbance]
) -> Scenarios:
    """Each of p parameters with each of d disturbances."""
    p, d = thetas.shape[0], len(disturbances)
    return mixed(system, jnp.repeat(thetas, d, axis=0), disturbances, jnp.tile(jnp.eye(d), (p, 1)))


def mixed(
    system: System,
    thetas: Float[Array, "k m"],
    parts: Sequence[Disturbance],
    shares: Float[Array, "k parts"],
) -> Scenarios:
    """K plants, each disturbed by its own shares of the same parts."""
    disturbances = jax.vmap(Mixture)(_copies(parts, thetas.shape[0]), shares)
    return Scenarios(system, thetas, disturbances)


def vertices(system: System) -> Float[Array, "corners m"]:
    """The corners of Ω_θ."""
    return jnp.stack([jnp.stack(c) for c in itertools.product(*(t.interval for t in system.terms))])


def _keys_of_items(key: PRNGKeyArray, count: int) -> Key[Array, " count"]:
    """One key per item, which does not depend on how many there are."""
    return jax.vmap(lambda k: jax.random.fold_in(key, k))(jnp.arange(count))


def random_parameters(key: PRNGKeyArray, system: System, count: int) -> Float[Array, "count m"]:
    """Uniform in Ω_θ; the k-th depends on the key and on k alone."""
    share = jax.vmap(lambda key: jax.random.uniform(key, system.lower.shape))(
        _keys_of_items(key, count)
    )
    return system.lower[None] + share * (system.upper - system.lower)[None]


def random_forces(key: PRNGKeyArray, ticks: int, count: int) -> Forces:
    """Forces within ±δ drawn anew at every tick; the k-th depends on the key and on k alone."""
    return jax.vmap(lambda key: random_shares(key, ticks))(_keys_of_items(key, count))


def random_scenarios(
    key: PRNGKeyArray, system: System, kinds: Sequence[Disturbance], ticks: int, count: int
) -> Scenarios:
    """Random parameters, each with one of some disturbances or a force drawn anew at every tick.

    Args:
        key: plant k depends on it and on k alone.
        system: of all plants.
        kinds: the disturbances; together with the random force they take turns.
        ticks: of the whole experiment.
        count: of plants.
    """
    first, second = jax.random.split(key)
    parts = (*_copies(kinds, count), random_forces(second, ticks, count))
    turn = jax.nn.one_hot(jnp.arange(count) % len(parts), len(parts))
    return Scenarios(
        system, random_parameters(first, system, count), jax.vmap(Mixture)(parts, turn)
    )


def _copies(disturbances: Sequence[Disturbance], count: int) -> tuple[Disturbance, ...]:
    """Each array of each of them `count` times, along a new first axis."""
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *jnp.shape(x))), tuple(disturbances))
