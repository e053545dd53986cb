"""Disturbances Δ for simulations; the simulated plant clips each of them to |Δ| ≤ δ."""

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jaxid._types import Scalar, as_array, dot


class Moment(NamedTuple):
    """The instant at which a disturbance is evaluated, with the tracking errors of its sample.

    Attributes:
        tick: index of the sample.
        time: time within the simulation, s.
        error: position error y − y_ref at the start of the sample, m or rad.
        error_rate: velocity error at the start of the sample, m/s or rad/s.
    """

    tick: Int[Array, ""]
    time: Scalar
    error: Scalar
    error_rate: Scalar


class Disturbance(eqx.Module):
    """Base class of disturbances Δ(t, y, ẏ) for simulations, in the unit of the input."""

    @abc.abstractmethod
    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        """Return Δ at one instant, in the unit of the input.

        Args:
            moment: sample, time and tracking errors.
            position: y, m or rad.
            velocity: ẏ, m/s or rad/s.
            delta: disturbance bound δ at this state, in the unit of the input.
        """

    def drawn(self, key: PRNGKeyArray, ticks: int, k1: Scalar) -> "Disturbance":
        """Return the disturbance of one run, with its random numbers drawn; call it before `Plant`.

        It is the disturbance itself unless it is random or depends on the controller's k₁.

        Args:
            key: JAX key of this run.
            ticks: number of samples of the run.
            k1: k₁ of the controller, 1/s, see `Controller.k1_of_p`.
        """
        return self


class NoDisturbance(Disturbance):
    """The disturbance Δ = 0."""

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        return jnp.zeros_like(velocity)


class Cogging(Disturbance):
    """A disturbance that repeats with the position: Σ_i amplitude_i·sin(2π·harmonic_i·y/pitch).

    Attributes:
        pitch: magnet pitch, m or rad.
        harmonics: harmonic numbers, shape (k,).
        amplitudes: amplitude of each harmonic, shape (k,), in the unit of the input.
    """

    pitch: Scalar = eqx.field(converter=as_array("pitch"))
    harmonics: Float[Array, " k"] = eqx.field(converter=as_array("harmonics"))
    amplitudes: Float[Array, " k"] = eqx.field(converter=as_array("amplitudes"))

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        angle = 2 * jnp.pi * position / self.pitch
        return jnp.sum(self.amplitudes * jnp.sin(self.harmonics * angle))


class LowSpeedFriction(Disturbance):
    """Additional friction at low speed (Stribeck effect), odd and smooth in the velocity.

    Δ = amplitude·exp(−(ẏ/speed)²)·ẏ/√(ẏ² + (speed/10)²).

    Attributes:
        amplitude: scale of the friction, in the unit of the input.
        speed: speed at which the exponential has fallen to 1/e, m/s or rad/s.
    """

    amplitude: Scalar = eqx.field(converter=as_array("amplitude"))
    speed: Scalar = eqx.field(converter=as_array("speed"))

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        direction = velocity / jnp.sqrt(velocity**2 + (self.speed / 10) ** 2)
        return self.amplitude * jnp.exp(-((velocity / self.speed) ** 2)) * direction


class Mixture(Disturbance):
    """A weighted sum of several disturbances, so that scenarios differ in data only.

    Attributes:
        parts: k disturbances.
        shares: weight of each disturbance, shape (k,).
    """

    parts: tuple[Disturbance, ...]
    shares: Float[Array, " k"] = eqx.field(converter=as_array("shares"))

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        return dot([part(moment, position, velocity, delta) for part in self.parts], self.shares)

    def drawn(self, key: PRNGKeyArray, ticks: int, k1: Scalar) -> "Mixture":
        """Return the weighted sum of the disturbances, each drawn for one run with its own key.

        Args:
            key: JAX key of this run.
            ticks: number of samples of the run.
            k1: k₁ of the controller, 1/s.
        """
        keys = [key, *(jax.random.fold_in(key, j) for j in range(1, len(self.parts)))]
        parts = tuple(part.drawn(k, ticks, k1) for part, k in zip(self.parts, keys, strict=True))
        return Mixture(parts, self.shares)


class Sequence(Disturbance):
    """A disturbance given as a share of δ for each sample, held over the sample.

    Attributes:
        shares: Δ_k/δ_k, one per sample, between −1 and 1.
    """

    shares: Float[Array, " n"]

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        return delta * self.shares[moment.tick]


class AgainstTracking(Disturbance):
    """The worst-case disturbance of Theorem 4: Δ = −δ·sign(p), with p = ė + k₁e, increases |p|.

    Attributes:
        k1: k₁, 1/s; None, the default, stands for that of the controller, which `drawn` fills in.
    """

    k1: Scalar | None = eqx.field(
        converter=lambda k1: None if k1 is None else jnp.asarray(k1), default=None
    )

    def drawn(self, key: PRNGKeyArray, ticks: int, k1: Scalar) -> "AgainstTracking":
        """Return this disturbance with the k₁ of the controller, unless it has its own.

        Args:
            key: not used.
            ticks: not used.
            k1: k₁ of the controller, 1/s.
        """
        return AgainstTracking(k1) if self.k1 is None else self

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        if self.k1 is None:
            raise ValueError(
                "Argument `k1` of AgainstTracking must be given, e.g. `controller.k1_of_p`."
            )
        return -delta * jnp.sign(moment.error_rate + self.k1 * moment.error)


class RandomForce(Disturbance):
    """A random disturbance, uniform in ±δ and independent from sample to sample.

    It must be drawn for each run by `drawn` before it can be evaluated.
    """

    def __call__(self, moment: Moment, position: Scalar, velocity: Scalar, delta: Scalar) -> Scalar:
        raise ValueError(
            "A RandomForce must be drawn for a run before it is given to a plant: "
            "`RandomForce().drawn(key, ticks, k1=0.0)`, with the number of samples of the run."
        )

    def drawn(self, key: PRNGKeyArray, ticks: int, k1: Scalar) -> Sequence:
        """Return random shares of δ for one run.

        Args:
            key: JAX key of this run.
            ticks: number of samples of the run.
            k1: not used.
        """
        return random_shares(key, ticks)


def random_shares(key: PRNGKeyArray, ticks: int) -> Sequence:
    """Return a disturbance of random shares of δ, uniform in [−1, 1), one per sample.

    Args:
        key: JAX key of the random numbers.
        ticks: number of samples.
    """
    return Sequence(jax.random.uniform(key, (ticks,), minval=-1.0, maxval=1.0))
