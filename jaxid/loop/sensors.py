"""What the controller and the log see of a motion: sensors, and a Record from measured signals."""

import abc
import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from jaxid._checks import require_at_least_zero
from jaxid._types import Scalar, as_array


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

    What it reads has no derivative, and differentiating through it is refused; use `IdealSensor`.

    Attributes:
        resolution: of one count, m or rad; zero for a position that is exact.
    """

    resolution: Scalar = eqx.field(converter=as_array("resolution"))

    def __check_init__(self) -> None:
        require_at_least_zero("resolution", "an encoder", self.resolution)

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
        """The nearest multiple of the resolution; the position itself where that is zero.

        Raises:
            ValueError: if it is differentiated.
        """
        return _quantised(position, self.resolution)


@jax.custom_jvp
def _quantised(position: Float[Array, "*shape"], resolution: Scalar) -> Float[Array, "*shape"]:
    exact = resolution == 0
    count = jnp.where(exact, 1.0, resolution)
    return jnp.where(exact, position, count * jnp.round(position / count))


@functools.partial(_quantised.defjvp, symbolic_zeros=True)
def _without_slope(primals: tuple[Any, Any], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    """The slope of steps is zero or infinite: what JAX makes of that through a loop is nonsense."""
    if not all(isinstance(tangent, SymbolicZero) for tangent in tangents):
        raise ValueError(
            "The position that an `Encoder` reads goes in steps of one count and has no "
            "derivative: use `IdealSensor` in what is differentiated, or stop the gradient of what "
            "the encoder reads."
        )
    found = _quantised(*primals)
    return found, jnp.zeros_like(found)
