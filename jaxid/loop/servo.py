"""The servo that runs a motion and records its log: sample period, encoder, delay, jitter."""

import equinox as eqx
import jax.numpy as jnp

from jaxid._checks import (
    is_concrete,
    require,
    require_at_least_zero,
    require_positive,
)
from jaxid._types import as_known
from jaxid.loop.controllers import Controller, delayed
from jaxid.loop.log import JITTER, Log
from jaxid.loop.sensors import Encoder
from jaxid.loop.simulate import Signals
from jaxid.motion.trajectory import JerkTrajectory, ticks


class Servo(eqx.Module):
    """The servo that runs a motion and records its log: sample period, encoder, delay, jitter.

    Attributes:
        period: sample period, s. The input is held for one period (zero-order hold).
        resolution: encoder resolution, m or rad; 0, the default, for exact positions.
        delay: number of whole sample periods from a command of the controller until it acts.
        jitter: largest deviation of samples and inputs from multiples of the period, s; at most a
            tenth of the period.

    Raises:
        ValueError: if the period is not above zero, or another value is out of its range.

    Example:
        >>> servo = jd.Servo(period=0.001, resolution=1e-6)
        >>> servo.ticks(motion)
        600
    """

    period: float = eqx.field(converter=as_known("period"))
    resolution: float = eqx.field(converter=as_known("resolution"), default=0.0)
    delay: int = 0
    jitter: float = eqx.field(converter=as_known("jitter"), default=0.0)

    def __check_init__(self) -> None:
        require_positive("period", "a servo", self.period)
        for name in ("resolution", "delay", "jitter"):
            require_at_least_zero(name, "a servo", getattr(self, name))
        require(
            self.delay == int(self.delay),
            f"Argument `delay` of a servo must be a whole number of periods, but is {self.delay}.",
        )
        require(
            self.jitter <= JITTER * self.period,
            f"Argument `jitter` of a servo must be {JITTER:g} of its period at most, but is "
            f"{self.jitter:g} s of {self.period:g} s.",
        )

    @property
    def sensor(self) -> Encoder:
        """The encoder that a controller reads: quantised positions, velocities by differences."""
        return Encoder(self.resolution)

    def delayed(self, controller: Controller) -> Controller:
        """Return the controller with the delay of this servo."""
        return delayed(controller, self.delay)

    def ticks(self, trajectory: JerkTrajectory) -> int:
        """Return the number of sample periods that a motion lasts.

        Raises:
            ValueError: if it is not a whole number, or less than two.
        """
        count = ticks(trajectory, self.period)
        require(
            count >= 2,
            "Argument `period` of a servo must be half of the motion's duration, or less, but is "
            f"{self.period:g} s for {count * self.period:g} s.",
        )
        return count

    def log(self, signals: Signals) -> Log:
        """Return the log that this servo records of a simulated experiment.

        It has the input that acts in each sample period, and quantised positions.

        Args:
            signals: signals of one plant, simulated with the sample period of this servo; states
                within a sample period are left out.
        """
        steps = (signals.position.size - 1) // signals.input.size
        position = self.sensor.quantise(signals.position[::steps])
        counted = signals.counted
        whole = is_concrete(counted) and bool(jnp.all(counted))
        count = None if whole else jnp.sum(counted)
        return Log(signals.input, position, self.period, self.resolution, self.jitter, _count=count)
