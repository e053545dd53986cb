"""True disturbances Δ for simulations. Whatever they say, the plant keeps |Δ| ≤ δ."""

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jaxid._types import Scalar, as_array, dot


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

    def drawn(self, key: PRNGKeyArray, ticks: int, k1: Scalar) -> "Disturbance":
        """What disturbs one run: the same for every run unless it is random or knows the loop.

        Args:
            key: of this run.
            ticks: of the run.
            k1: of the controller, see `Controller.k1_of_p`.
        """
        return self


class NoDisturbance(Disturbance):
    """Δ = 0."""

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        return jnp.zeros_like(velocity)


class Cogging(Disturbance):
    """A force that repeats with the magnet pitch: Σ_i amplitude_i·sin(2π·harmonic_i·y/pitch)."""

    pitch: Scalar = eqx.field(converter=as_array("pitch"))
    harmonics: Float[Array, " k"] = eqx.field(converter=as_array("harmonics"))
    amplitudes: Float[Array, " k"] = eqx.field(converter=as_array("amplitudes"))

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        angle = 2 * jnp.pi * position / self.pitch
        return jnp.sum(self.amplitudes * jnp.sin(self.harmonics * angle))


class LowSpeedFriction(Disturbance):
    """Friction beyond Coulomb's at low speed (Stribeck), odd and smooth in the velocity.

    amplitude·exp(−(ẏ/speed)²)·ẏ/√(ẏ² + (speed/10)²).
    """

    amplitude: Scalar = eqx.field(converter=as_array("amplitude"))
    speed: Scalar = eqx.field(converter=as_array("speed"))

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
    shares: Float[Array, " k"] = eqx.field(converter=as_array("shares"))

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        return dot([part(moment, position, velocity, delta) for part in self.parts], self.shares)

    def drawn(self, key: PRNGKeyArray, ticks: int, k1: Scalar) -> "Mixture":
        keys = [key, *(jax.random.fold_in(key, j) for j in range(1, len(self.parts)))]
        parts = tuple(part.drawn(k, ticks, k1) for part, k in zip(self.parts, keys, strict=True))
        return Mixture(parts, self.shares)


class Sequence(Disturbance):
    """A share of δ, held over each tick: random, constant, a square wave, or −sign of any weights.

    Attributes:
        shares: Δ_k/δ_k within ±1, one per tick.
    """

    shares: Float[Array, " n"]

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        return delta * self.shares[moment.tick]


class AgainstTracking(Disturbance):
    """The adversary of Theorem 4: always pushes p = ė + k₁e away from zero.

    Attributes:
        k1: 1/s; None, the default, for that of the controller, which `drawn` takes.
    """

    k1: Scalar | None = eqx.field(
        converter=lambda k1: None if k1 is None else jnp.asarray(k1), default=None
    )

    def drawn(self, key: PRNGKeyArray, ticks: int, k1: Scalar) -> "AgainstTracking":
        return AgainstTracking(k1) if self.k1 is None else self

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        if self.k1 is None:
            raise ValueError("Argument `k1` of AgainstTracking must be given, or drawn for a run.")
        return -delta * jnp.sign(moment.error_rate + self.k1 * moment.error)


class RandomForce(Disturbance):
    """An independent uniform share of ±δ at every tick, drawn anew for each run by `drawn`."""

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        raise ValueError(
            "A RandomForce must be drawn for a run: call its method `drawn` with a key."
        )

    def drawn(self, key: PRNGKeyArray, ticks: int, k1: Scalar) -> Sequence:
        return random_shares(key, ticks)


def random_shares(key: PRNGKeyArray, ticks: int) -> Sequence:
    """An independent uniform share of ±δ at every tick."""
    return Sequence(jax.random.uniform(key, (ticks,), minval=-1.0, maxval=1.0))
