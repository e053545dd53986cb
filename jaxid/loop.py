"""The closed loop as a function of the motion, and the plants that it may meet."""

import itertools
from collections.abc import Callable, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxid.control import Controller
from jaxid.disturbance import Disturbance, Mixture, random_shares
from jaxid.limits import Envelope, Limits, Prediction, axis_excess
from jaxid.ranges import Range
from jaxid.record import Record
from jaxid.sensing import Sensor
from jaxid.simulate import Plant, Signals, simulate
from jaxid.system import Motion, Scalar, System
from jaxid.trajectory import JerkTrajectory, reference

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

    def map(self, function: Callable[[Plant], Result]) -> Result:
        """The results for every plant, along a new first axis."""
        return jax.vmap(lambda theta, d: function(Plant(self.system, theta, d)))(
            self.theta, self.disturbance
        )


def every(
    system: System, thetas: Float[Array, "p m"], disturbances: Sequence[Disturbance]
) -> Scenarios:
    """Each of p parameters with each of d disturbances."""
    p, d = thetas.shape[0], len(disturbances)
    parts = jax.tree.map(lambda x: jnp.broadcast_to(x, (p * d, *jnp.shape(x))), tuple(disturbances))
    one_at_a_time = jnp.tile(jnp.eye(d), (p, 1))
    disturbance = jax.vmap(Mixture)(parts, one_at_a_time)
    return Scenarios(system, jnp.repeat(thetas, d, axis=0), disturbance)


def vertices(system: System) -> Float[Array, "corners m"]:
    """The corners of Ω_θ."""
    return jnp.stack([jnp.stack(c) for c in itertools.product(*(t.interval for t in system.terms))])


def random_parameters(key: PRNGKeyArray, system: System, count: int) -> Float[Array, "count m"]:
    """Uniform in Ω_θ; the k-th does not depend on how many there are."""
    keys = jax.vmap(lambda k: jax.random.fold_in(key, k))(jnp.arange(count))
    share = jax.vmap(lambda key: jax.random.uniform(key, system.lower.shape))(keys)
    return system.lower[None] + share * (system.upper - system.lower)[None]


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
    keys = jax.vmap(lambda k: jax.random.fold_in(second, k))(jnp.arange(count))
    noise = jax.vmap(lambda key: random_shares(key, ticks))(keys)
    parts = jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *jnp.shape(x))), tuple(kinds))
    turn = jax.nn.one_hot(jnp.arange(count) % (len(kinds) + 1), len(kinds) + 1)
    disturbance = jax.vmap(Mixture)((*parts, noise), turn)
    return Scenarios(system, random_parameters(first, system, count), disturbance)


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

    def one(plant: Plant) -> Float[Array, " sides"]:
        columns = _columns(loop, plant, trajectory)
        sides = axis_excess(limits, Envelope(*(Range(x, x) for x in columns)))
        return jnp.nan_to_num(jnp.stack([jnp.max(side) for side in sides]), nan=jnp.inf)

    def plant(item: tuple[Array, Disturbance]) -> Float[Array, " sides"]:
        return one(Plant(scenarios.system, *item))

    # in batches: all signals of all plants at once would fill the memory
    return jax.lax.map(plant, (scenarios.theta, scenarios.disturbance), batch_size=16)


@eqx.filter_jit
def _envelope(loop: Loop, scenarios: Scenarios, trajectory: JerkTrajectory) -> Envelope:
    def extremes(values: Float[Array, "k n"]) -> Range:
        # at each tick of the motion: over plants, repeats and the steps within the tick
        apart = values.reshape(values.shape[0], loop.repeats, loop.ticks, -1)
        return Range(jnp.min(apart, (0, 1, 3)), jnp.max(apart, (0, 1, 3)))

    return Envelope(*map(extremes, scenarios.map(lambda p: _columns(loop, p, trajectory))))


def _columns(loop: Loop, plant: Plant, trajectory: JerkTrajectory) -> tuple[Motion, ...]:
    """Position and velocity after every step; input and its rate at every tick."""
    signals = loop(plant, trajectory)[1]
    rate = jnp.diff(signals.input, prepend=jnp.zeros(1)) / loop.period
    return signals.position[1:], signals.velocity[1:], signals.input, rate
