"""Sets of plants for simulations: parameters with disturbances."""

import itertools
from collections.abc import Callable, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from jaxid._batches import map_in_batches
from jaxid.loop.disturbances import Disturbance, Mixture, random_shares
from jaxid.loop.disturbances import Sequence as Forces
from jaxid.loop.simulate import Plant
from jaxid.model.system import System

Result = TypeVar("Result")


class Scenarios(eqx.Module):
    """A set of k plants of one system, each with its own parameters and disturbance.

    Attributes:
        system: system of all plants.
        theta: parameters θ of each plant, shape (k, m).
        disturbance: disturbances of one kind; every array in it has k entries along its first axis.
    """

    system: System
    theta: Float[Array, "k m"]
    disturbance: Disturbance

    def __getitem__(self, chosen: Int[Array | np.ndarray, " c"]) -> "Scenarios":
        """Return the plants with the given indices."""
        parts = jax.tree.map(lambda x: x[chosen], (self.theta, self.disturbance))
        return Scenarios(self.system, *parts)

    def map(self, function: Callable[[Plant], Result]) -> Result:
        """Return the results of a function for every plant, along a new first axis.

        Many plants are computed in batches, see `jaxid._batches`.
        """

        def one(item: tuple[Float[Array, " m"], Disturbance]) -> Result:
            return function(Plant(self.system, *item))

        return map_in_batches(one, (self.theta, self.disturbance))


def every(
    system: System, thetas: Float[Array, "p m"], disturbances: Sequence[Disturbance]
) -> Scenarios:
    """Return the p·d plants that combine each of p parameter vectors with each of d disturbances.

    Args:
        system: system of all plants.
        thetas: parameter vectors, shape (p, m).
        disturbances: d disturbances.
    """
    p, d = thetas.shape[0], len(disturbances)
    return mixed(system, jnp.repeat(thetas, d, axis=0), disturbances, jnp.tile(jnp.eye(d), (p, 1)))


def mixed(
    system: System,
    thetas: Float[Array, "k m"],
    parts: Sequence[Disturbance],
    shares: Float[Array, "k parts"],
) -> Scenarios:
    """Return k plants, each with its own weighted sum of the same disturbances.

    Args:
        system: system of all plants.
        thetas: parameters of each plant, shape (k, m).
        parts: disturbances that are summed.
        shares: weights of the disturbances for each plant, shape (k, parts).
    """
    disturbances = jax.vmap(Mixture)(_copies(parts, thetas.shape[0]), shares)
    return Scenarios(system, thetas, disturbances)


def vertices(system: System) -> Float[Array, "corners m"]:
    """Return the 2^m corners of the prior box Ω_θ, shape (2^m, m)."""
    return jnp.stack([jnp.stack(c) for c in itertools.product(*(t.interval for t in system.terms))])


def _keys_of_items(key: PRNGKeyArray, count: int) -> Key[Array, " count"]:
    """Return one JAX key per item, which does not depend on the number of items."""
    return jax.vmap(lambda k: jax.random.fold_in(key, k))(jnp.arange(count))


def random_parameters(key: PRNGKeyArray, system: System, count: int) -> Float[Array, "count m"]:
    """Return random parameters, uniform in the prior box Ω_θ, shape (count, m).

    Row k depends only on the key and on k.

    Args:
        key: JAX key of the random numbers.
        system: system with its prior box.
        count: number of parameter vectors.
    """
    share = jax.vmap(lambda key: jax.random.uniform(key, system.lower.shape))(
        _keys_of_items(key, count)
    )
    return system.lower[None] + share * (system.upper - system.lower)[None]


def random_forces(key: PRNGKeyArray, ticks: int, count: int) -> Forces:
    """Return random disturbances as shares of δ, uniform and independent from sample to sample.

    Disturbance k depends only on the key and on k.

    Args:
        key: JAX key of the random numbers.
        ticks: number of samples.
        count: number of disturbances, along the first axis of the result.
    """
    return jax.vmap(lambda key: random_shares(key, ticks))(_keys_of_items(key, count))


def random_scenarios(
    key: PRNGKeyArray, system: System, kinds: Sequence[Disturbance], ticks: int, count: int
) -> Scenarios:
    """Return plants with random parameters and, in turn, given or random disturbances.

    Args:
        key: JAX key; plant k depends only on it and on k.
        system: system of all plants.
        kinds: disturbances that the plants take in turn, together with a random one.
        ticks: number of samples of the whole experiment.
        count: number of plants.
    """
    first, second = jax.random.split(key)
    parts = (*_copies(kinds, count), random_forces(second, ticks, count))
    turn = jax.nn.one_hot(jnp.arange(count) % len(parts), len(parts))
    return Scenarios(
        system, random_parameters(first, system, count), jax.vmap(Mixture)(parts, turn)
    )


def _copies(disturbances: Sequence[Disturbance], count: int) -> tuple[Disturbance, ...]:
    """Repeat each array of the disturbances `count` times, along a new first axis."""
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *jnp.shape(x))), tuple(disturbances))
