"""What the controller and the log see of a motion: sensors, and a Record from measured signals."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._types import Scalar
from jaxid.loop.record import Record, Rows, rows_of
from jaxid.model.system import System
from jaxid.motion.trajectory import States
from jaxid.regression.filters import low_pass


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


def differenced_record(
    system: System,
    input: Float[Array, " n"],
    position: Float[Array, " n+1"],
    period: Scalar | float,
) -> Record:
    """The Record that the paper's identification makes of a log, with differences for derivatives.

    Tick k has the measured velocity (y_{k+1} − y_k)/h, its mean, and for its mean acceleration the
    backward difference of those velocities, which lags by half a tick. Quantisation, that lag and
    S_f and δ taken at the measured velocity are *not* in the bound δ: no guarantee follows.
    """
    velocity = jnp.diff(position, prepend=position[:1]) / period
    states = States(position[1:], velocity[1:], jnp.diff(velocity) / period)
    return Record(rows_of(system, states, jnp.full_like(input, period)), input, None)


def printed_record(
    system: System,
    input: Float[Array, " n"],
    position: Float[Array, " n+1"],
    bandwidth: Scalar | float,
    period: Scalar | float,
) -> Record:
    """(28) as printed, on a log: w·(ẏ − ẏ_f) for the acceleration, ẏ by backward differences.

    The difference is the velocity of half a tick ago, so w·(ẏ − ẏ_f) is too large by about
    w·period/2, 10 % at w = 1000 rad/s and 0.2 ms: the estimate of the inertia is that much too low,
    outside its own bound (29) whatever the disturbance. `differenced_record`, filtered, has no such
    error, but quantisation and the rest of its docstring stay.

    Args:
        system: for its regressors and δ.
        input: as commanded, one value per tick.
        position: as logged, one instant more.
        bandwidth: w of H_f in rad/s.
        period: of the ticks, s.
    """
    velocity = jnp.diff(position, prepend=position[:1])[:-1] / period

    def so_far(column: Float[Array, " n"]) -> Float[Array, " n"]:
        """What the filter holds at the start of each tick."""
        return jnp.append(0.0, low_pass(column, bandwidth, period)[:-1])

    states = States(position[:-1], velocity, jnp.zeros_like(velocity))
    rows = rows_of(system, states, jnp.full_like(input, period))
    acceleration = bandwidth * (velocity - so_far(velocity))
    columns = (acceleration, *(so_far(column) for column in rows.columns[1:]))
    return Record(Rows(columns, so_far(rows.delta), rows.measure), so_far(input), None)
