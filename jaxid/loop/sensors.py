"""Sensors: the position and velocity that a controller measures."""

import abc
import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require_at_least_zero
from jaxid._types import Scalar, as_array


class Measurement(NamedTuple):
    """The measured position and velocity at one sample.

    Attributes:
        position: measured position, m or rad.
        velocity: measured velocity, m/s or rad/s.
    """

    position: Scalar
    velocity: Scalar


class SensorError(NamedTuple):
    """The largest error of a measurement, for proofs about a closed loop.

    Attributes:
        position: largest |measured − true| position, m or rad.
        differenced: true if the velocity is the difference of two measured positions over the
            sample period, false if it is exact.
    """

    position: Scalar
    differenced: bool


class Sensor(eqx.Module):
    """Base class of sensors: the measurement of the state at each sample, with a memory."""

    @abc.abstractmethod
    def error(self) -> SensorError:
        """Return the bounds of the measurement errors."""

    @abc.abstractmethod
    def initial(self, position: Scalar) -> Any:
        """Return the memory of the sensor before the first sample, at rest at `position`."""

    @abc.abstractmethod
    def read(
        self, memory: Any, position: Scalar, velocity: Scalar, period: Scalar
    ) -> tuple[Measurement, Any]:
        """Return the measurement at one sample, and the memory for the next one.

        Args:
            memory: memory of the sensor.
            position: true position, m or rad.
            velocity: true velocity, m/s or rad/s.
            period: sample period, s.
        """


class IdealSensor(Sensor):
    """A sensor that measures position and velocity exactly."""

    def error(self) -> SensorError:
        """Return the bounds of the measurement errors, which are zero for this sensor."""
        return SensorError(jnp.zeros(()), differenced=False)

    def initial(self, position: Scalar) -> tuple[()]:
        """Return an empty tuple: this sensor remembers nothing from sample to sample."""
        return ()

    def read(
        self, memory: tuple[()], position: Scalar, velocity: Scalar, period: Scalar
    ) -> tuple[Measurement, tuple[()]]:
        """Return the true position and velocity; the memory stays an empty tuple."""
        return Measurement(position, velocity), ()


class Encoder(Sensor):
    """An encoder: a quantised position, and a velocity by its backward difference.

    Its readings have no derivative. Differentiation through them raises an error; use
    `IdealSensor`, and a `Servo` of resolution 0 if it records a log.

    Attributes:
        resolution: encoder resolution (one count), m or rad; zero for exact positions.

    Raises:
        ValueError: if `resolution` is below zero or not finite.
    """

    resolution: Scalar = eqx.field(converter=as_array("resolution"))

    def __check_init__(self) -> None:
        require_at_least_zero("resolution", "an encoder", self.resolution)

    def error(self) -> SensorError:
        """Return the bounds of the errors: half a count, and a velocity by differences."""
        return SensorError(self.resolution / 2, differenced=True)

    def initial(self, position: Scalar) -> Scalar:
        """Return the quantised position before the first sample."""
        return self.quantise(position)

    def read(
        self, memory: Scalar, position: Scalar, velocity: Scalar, period: Scalar
    ) -> tuple[Measurement, Scalar]:
        """Return the quantised position and its backward difference, and the position as memory.

        Args:
            memory: quantised position of the sample before, m or rad.
            position: true position, m or rad.
            velocity: not used.
            period: sample period, s.
        """
        count = self.quantise(position)
        return Measurement(count, (count - memory) / period), count

    def quantise(self, position: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Return the multiple of the resolution nearest to each position; exact if that is zero.

        Raises:
            ValueError: if it is differentiated, unless the resolution is known to be zero.
        """
        if is_concrete(self.resolution) and float(self.resolution) == 0:
            return position
        return _quantised(position, self.resolution)


@jax.custom_jvp
def _quantised(position: Float[Array, "*shape"], resolution: Scalar) -> Float[Array, "*shape"]:
    exact = resolution == 0
    count = jnp.where(exact, 1.0, resolution)
    return jnp.where(exact, position, count * jnp.round(position / count))


@functools.partial(_quantised.defjvp, symbolic_zeros=True)
def _without_slope(primals: tuple[Any, Any], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    """Refuse derivatives: those of steps are zero or infinite, and useless through a loop."""
    if not all(isinstance(tangent, SymbolicZero) for tangent in tangents):
        raise ValueError(
            "The position that an `Encoder` reads goes in steps of one count and has no "
            "derivative: use `IdealSensor` in what is differentiated, with a servo of resolution 0 "
            "if it records a log, or stop the gradient of what the encoder reads."
        )
    found = _quantised(*primals)
    return found, jnp.zeros_like(found)
