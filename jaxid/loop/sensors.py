"""What the controller and the log see of a motion: sensors, and a Record from measured signals."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._types import Scalar


class Measurement(NamedTuple):
    """Position and velocity as the controller gets them at one tick."""

    position: Scalar
    velocity: Scalar


class SensorError(NamedTuple):
    """How far a measurement may be from the truth: for what is proved of a loop.

    Attributes:
        position: |measured − true| at most, m or rad.
        differenced: whether the velocity is the difference of two measured positions; it is exact
            otherwise.
    """

    position: Scalar
    differenced: bool


class Sensor(eqx.Module):
    """Turns the state at a tick into a measurement; carries what it must remember."""

    @abc.abstractmethod
    def error(self) -> SensorError:
        """The bounds of its errors."""

    @abc.abstractmethod
    def initial(self, position: Scalar) -> Any:
        """The memory before the first tick, the axis resting at `position`."""

    @abc.abstractmethod
    def read(
        self, memory: Any, position: Scalar, velocity: Scalar, period: Scalar
    ) -> tuple[Measurement, Any]:
        """The measurement at a tick, and the memory for the next one, `period` seconds later."""


class IdealSensor(Sensor):
    """Exact position and velocity."""

    def error(self) -> SensorError:
        return SensorError(jnp.zeros(()), differenced=False)

    def initial(self, position: Scalar) -> tuple[()]:
        return ()

    def read(
        self, memory: tuple[()], position: Scalar, velocity: Scalar, period: Scalar
    ) -> tuple[Measurement, tuple[()]]:
        return Measurement(position, velocity), ()


class Encoder(Sensor):
    """A quantised position, and the velocity by its backward difference.

    Attributes:
        resolution: of one count, m or rad.
    """

    resolution: Scalar = eqx.field(converter=jnp.asarray)

    def error(self) -> SensorError:
        return SensorError(self.resolution / 2, differenced=True)

    def initial(self, position: Scalar) -> Scalar:
        return self.quantise(position)

    def read(
        self, memory: Scalar, position: Scalar, velocity: Scalar, period: Scalar
    ) -> tuple[Measurement, Scalar]:
        count = self.quantise(position)
        return Measurement(count, (count - memory) / period), count

    def quantise(self, position: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """The nearest multiple of the resolution."""
        return self.resolution * jnp.round(position / self.resolution)
