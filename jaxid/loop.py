"""The closed loop as a function of the motion, and the plants that it may meet."""

import itertools
from collections.abc import Callable, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxid.control import Controller
from jaxid.disturbance import Disturbance, Mixture
from jaxid.limits import Envelope, Prediction
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
    return Scenarios(system, jnp.repeat(thetas, d, axis=0), Mixture(parts, one_at_a_time))


def vertices(system: System) -> Float[Array, "corners m"]:
    """The corners of Ω_θ."""
    return jnp.stack([jnp.stack(c) for c in itertools.product(*(t.interval for t in system.terms))])


def random_parameters(key: PRNGKeyArray, system: System, count: int) -> Float[Array, "count m"]:
    """Uniform in Ω_θ; the k-th does not depend on how many there are."""
    keys = jax.vmap(lambda k: jax.random.fold_in(key, k))(jnp.arange(count))
    share = jax.vmap(lambda key: jax.random.uniform(key, system.lower.shape))(keys)
    return system.lower[None] + share * (system.upper - system.lower)[None]


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
def _envelope(loop: Loop, scenarios: Scenarios, trajectory: JerkTrajectory) -> Envelope:
    def one(plant: Plant) -> tuple[Motion, ...]:
        signals = loop(plant, trajectory)[1]
        rate = jnp.diff(signals.input, prepend=jnp.zeros(1)) / loop.period
        return signals.position[1:], signals.velocity[1:], signals.input, rate

    def extremes(values: Float[Array, "k n"]) -> Range:
        # at each tick of the motion: over plants, repeats and the steps within the tick
        apart = values.reshape(values.shape[0], loop.repeats, loop.ticks, -1)
        return Range(jnp.min(apart, (0, 1, 3)), jnp.max(apart, (0, 1, 3)))

    return Envelope(*map(extremes, scenarios.map(one)))
