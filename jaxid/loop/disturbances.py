"""True disturbances Δ for simulations. Whatever they say, the plant keeps |Δ| ≤ δ."""

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jaxid._types import Scalar, dot


class Moment(NamedTuple):
    """When a disturbance is asked for, and what an adversary may know at the start of that tick."""

    tick: Int[Array, ""]
    time: Scalar
    error: Scalar
    error_rate: Scalar


class Disturbance(eqx.Module):
    """Δ(t, y, ẏ) in the unit of the input."""

    @abc.abstractmethod
    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        """Δ where the bound is `delta`."""


class NoDisturbance(Disturbance):
    """Δ = 0."""

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        return jnp.zeros_like(velocity)


class Cogging(Disturbance):
    """A force that repeats with the magnet pitch: Σ_i amplitude_i·sin(2π·harmonic_i·y/pitch)."""

    pitch: Scalar = eqx.field(converter=jnp.asarray)
    harmonics: Float[Array, " k"] = eqx.field(converter=jnp.asarray)
    amplitudes: Float[Array, " k"] = eqx.field(converter=jnp.asarray)

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        angle = 2 * jnp.pi * position / self.pitch
        return jnp.sum(self.amplitudes * jnp.sin(self.harmonics * angle))


class LowSpeedFriction(Disturbance):
    """Friction beyond Coulomb's at low speed (Stribeck), odd and smooth in the velocity.

    amplitude·exp(−(ẏ/speed)²)·ẏ/√(ẏ² + (speed/10)²).
    """

    amplitude: Scalar = eqx.field(converter=jnp.asarray)
    speed: Scalar = eqx.field(converter=jnp.asarray)

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        direction = velocity / jnp.sqrt(velocity**2 + (self.speed / 10) ** 2)
        return self.amplitude * jnp.exp(-((velocity / self.speed) ** 2)) * direction


class Mixture(Disturbance):
    """Several disturbances at once, each times a share: what differs between scenarios is data.

    Attributes:
        parts: k disturbances.
        shares: of each, shape (k,).
    """

    parts: tuple[Disturbance, ...]
    shares: Float[Array, " k"] = eqx.field(converter=jnp.asarray)

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        return dot([part(moment, position, velocity, delta) for part in self.parts], self.shares)


class Sequence(Disturbance):
    """A share of δ, held over each tick: random, constant, a square wave, or −sign of any weights.

    Attributes:
        shares: Δ_k/δ_k within ±1, one per tick.
    """

    shares: Float[Array, " n"]

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        return delta * self.shares[moment.tick]


class AgainstTracking(Disturbance):
    """The adversary of Theorem 4: always pushes p = ė + k₁e away from zero."""

    k1: Scalar = eqx.field(converter=jnp.asarray)

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        return -delta * jnp.sign(moment.error_rate + self.k1 * moment.error)


class Until(Disturbance):
    """Another disturbance that ends at a time t_N, s (Theorem 4 B)."""

    disturbance: Disturbance
    end: Scalar = eqx.field(converter=jnp.asarray)

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        value = self.disturbance(moment, position, velocity, delta)
        return jnp.where(moment.time < self.end, value, 0.0)


def random_shares(key: PRNGKeyArray, ticks: int) -> Sequence:
    """An independent uniform share of ±δ at every tick."""
    return Sequence(jax.random.uniform(key, (ticks,), minval=-1.0, maxval=1.0))


def square_wave(ticks: int, half_period: int) -> Sequence:
    """+δ for `half_period` ticks, then −δ for as many, and so on."""
    return Sequence(1.0 - 2.0 * ((jnp.arange(ticks) // half_period) % 2))
