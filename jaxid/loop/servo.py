"""The drive that runs a motion and records its log: sample period, encoder, delay, timing."""

import equinox as eqx
import jax.numpy as jnp

from jaxid._checks import (
    is_concrete,
    require,
    require_at_least_zero,
    require_positive,
)
from jaxid._types import as_known
from jaxid.loop.controllers import Controller, Delayed
from jaxid.loop.log import JITTER, Log
from jaxid.loop.sensors import Encoder
from jaxid.loop.simulate import Signals
from jaxid.motion.trajectory import JerkTrajectory, ticks


class Servo(eqx.Module):
    """The drive that runs a motion and records its log.

    Attributes:
        period: between two samples, s. The input is held for one period (zero-order hold).
        resolution: of the encoder, m or rad; 0 stands for exact positions.
        delay: whole periods from a command of the controller until it acts.
        jitter: by which samples and inputs may miss the multiples of the period, s; a tenth of the
            period at most.

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
        """What a controller measures: positions by the encoder, velocities by differences."""
        return Encoder(self.resolution)

    def delayed(self, controller: Controller) -> Controller:
        """A controller whose commands act as late as this drive lets them."""
        return Delayed(controller, self.delay) if self.delay else controller

    def ticks(self, trajectory: JerkTrajectory) -> int:
        """How many periods a motion lasts.

        Raises:
            ValueError: if these are not a whole number, two at least.
        """
        count = ticks(trajectory, self.period)
        require(
            count >= 2,
            "Argument `period` of a servo must be half of the motion's duration, or less, but is "
            f"{self.period:g} s for {count * self.period:g} s.",
        )
        return count

    def log(self, signals: Signals) -> Log:
        """What this drive records of a simulated experiment: inputs as they act, positions read.

        Args:
            signals: of one plant, in periods of this drive; Runge-Kutta steps within a period are
                left out.
        """
        steps = (signals.position.size - 1) // signals.input.size
        position = self.sensor.quantise(signals.position[::steps])
        counted = signals.counted
        whole = is_concrete(counted) and bool(jnp.all(counted))
        count = None if whole else jnp.sum(counted)
        return Log(signals.input, position, self.period, self.resolution, self.jitter, _count=count)
