"""The closed loop as a function of the motion, and the plants that it may meet."""

import itertools
from collections.abc import Callable, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from jaxid._types import Motion, Scalar
from jaxid.loop.controllers import Controller
from jaxid.loop.disturbances import Disturbance, Mixture, random_shares
from jaxid.loop.disturbances import Sequence as Forces
from jaxid.loop.record import Record
from jaxid.loop.sensors import Sensor
from jaxid.loop.simulate import Plant, Signals, simulate
from jaxid.model.interval_arithmetic import Range, exactly
from jaxid.model.system import System
from jaxid.motion.limits import Envelope, Limits, Prediction, axis_excess
from jaxid.motion.trajectory import JerkTrajectory, reference

Result = TypeVar("Result")


class Loop(eqx.Module):
    """An experiment but for its motion and its plant.

    Attributes:
        controller: any feedback law.
        sensor: what the controller sees.
        period: of the controller, s.
        ticks: of one motion.
        repeats: how many times the motion is run, back to back, from rest.
        substeps: Runge-Kutta steps per tick.
    """

    controller: Controller
    sensor: Sensor
    period: Scalar = eqx.field(converter=jnp.asarray)
    ticks: int = eqx.field(static=True)
    repeats: int = eqx.field(static=True, default=1)
    substeps: int = eqx.field(static=True, default=1)

    def __call__(self, plant: Plant, trajectory: JerkTrajectory) -> tuple[Record, Signals]:
        """Run the motion on a plant."""
        desired = reference(trajectory, self.period, self.ticks, self.repeats)
        return simulate(plant, self.controller, self.sensor, desired, self.period, self.substeps)


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
    shares = jnp.tile(jnp.eye(d), (p, 1))
    return Scenarios(
        system,
        jnp.repeat(thetas, d, axis=0),
        jax.vmap(Mixture)(_copies(disturbances, p * d), shares),
    )


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


class Sampled(Prediction):
    """What some plants do along a motion: evidence, no proof for the others.

    Attributes:
        loop: that they are in.
        scenarios: the plants.
    """

    loop: Loop
    scenarios: Scenarios

    @property
    def system(self) -> System:
        return self.scenarios.system

    def __call__(self, trajectory: JerkTrajectory) -> Envelope:
        """The lowest and highest over plants, repeats and Runge-Kutta steps."""
        return _envelope(self.loop, self.scenarios, trajectory)


@eqx.filter_jit
def excesses(
    loop: Loop, scenarios: Scenarios, limits: Limits, trajectory: JerkTrajectory
) -> Float[Array, "k sides"]:
    """How far each plant is beyond each limit, at worst, in half-widths; ≤ 0 keeps it.

    The sides are those of `axis_excess`. A plant whose loop diverges is beyond all limits.
    """

    def worst(item: tuple[Array, Disturbance]) -> Float[Array, " sides"]:
        columns = _columns(loop, Plant(scenarios.system, *item), trajectory)
        sides = axis_excess(limits, Envelope(*map(exactly, columns)))
        return jnp.stack([jnp.max(side) for side in sides])

    # in batches: all signals of all plants at once would fill the memory
    return jax.lax.map(worst, (scenarios.theta, scenarios.disturbance), batch_size=16)


@eqx.filter_jit
def _envelope(loop: Loop, scenarios: Scenarios, trajectory: JerkTrajectory) -> Envelope:
    def extremes(values: Float[Array, "k n"]) -> Range:
        # at each tick of the motion: over plants, repeats and the steps within the tick
        apart = values.reshape(values.shape[0], loop.repeats, loop.ticks, -1)
        lost = jnp.isnan(apart)  # a loop that diverged may be anywhere
        lower, upper = (jnp.where(lost, end, apart) for end in (-jnp.inf, jnp.inf))
        return Range(jnp.min(lower, (0, 1, 3)), jnp.max(upper, (0, 1, 3)))

    return Envelope(*map(extremes, scenarios.map(lambda p: _columns(loop, p, trajectory))))


def _columns(loop: Loop, plant: Plant, trajectory: JerkTrajectory) -> tuple[Motion, ...]:
    """Position and velocity after every step; input and its rate at every tick."""
    signals = loop(plant, trajectory)[1]
    rate = jnp.diff(signals.input, prepend=jnp.zeros(1)) / loop.period
    return signals.position[1:], signals.velocity[1:], signals.input, rate
