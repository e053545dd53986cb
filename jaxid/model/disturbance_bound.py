"""δ: what everything unmodelled stays below, by position and velocity (3)."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxid._checks import require_at_least_zero, require_positive
from jaxid._types import Motion, Scalar, as_array
from jaxid.model.interval_arithmetic import Range, around, exactly
from jaxid.model.smoothing import Nonsmooth

_OWNER = "a disturbance bound δ"


class DisturbanceBound(eqx.Module):
    """δ(y, ẏ) > 0 with |Δ| ≤ δ, in the unit of the input (3)."""

    @abc.abstractmethod
    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        """δ at each pair of position and velocity."""

    @abc.abstractmethod
    def range(self, position: Range, velocity: Range) -> Range:
        """All values of δ while position and velocity stay in their ranges; wider is allowed."""

    def describe(self, unit: str, speed: str) -> str:
        """What |Δ| is at most, in words.

        Args:
            unit: of the input.
            speed: unit of ẏ.
        """
        return f"δ of {type(self).__name__}, in {unit}"


class ConstantBound(DisturbanceBound):
    """One level at all positions and speeds."""

    level: Scalar = eqx.field(converter=as_array("level"))

    def __check_init__(self) -> None:
        require_positive("level", _OWNER, self.level)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.level * jnp.ones_like(velocity)

    def range(self, position: Range, velocity: Range) -> Range:
        return exactly(self(position.lower, velocity.lower))

    def describe(self, unit: str, speed: str) -> str:
        return f"{float(self.level):g} {unit}"


class SpeedBand(DisturbanceBound, Nonsmooth):
    """One level up to a threshold of |ẏ| and another above it (33).

    `blend` spreads the jump over about that speed; zero, the default, is the exact bound, in which
    the threshold itself belongs to the slow side.
    """

    slow: Scalar = eqx.field(converter=as_array("slow"))
    fast: Scalar = eqx.field(converter=as_array("fast"))
    threshold: Scalar = eqx.field(converter=as_array("threshold"))
    blend: Motion = eqx.field(converter=as_array("blend"), default=0.0)

    def __check_init__(self) -> None:
        require_positive("slow", _OWNER, self.slow)
        require_positive("fast", _OWNER, self.fast)
        require_at_least_zero("threshold", _OWNER, self.threshold)
        require_at_least_zero("blend", _OWNER, self.blend)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        below = self.threshold - jnp.abs(velocity)
        width = jnp.where(self.blend > 0, self.blend, 1.0)  # keeps the unused branch finite
        share = jnp.where(self.blend > 0, jax.nn.sigmoid(below / width), below >= 0)
        return self.fast + (self.slow - self.fast) * share

    def range(self, position: Range, velocity: Range) -> Range:
        slowest, fastest = (self(position.lower, speed) for speed in abs(velocity))
        return exactly(slowest) | fastest  # monotone in |ẏ|

    def describe(self, unit: str, speed: str) -> str:
        return (
            f"{float(self.slow):g} {unit} up to {float(self.threshold):g} {speed} and "
            f"{float(self.fast):g} {unit} above"
        )

    def smoothed(self, speed: Motion) -> "SpeedBand":
        return SpeedBand(self.slow, self.fast, self.threshold, self.blend + speed)


class ScaledBound(DisturbanceBound):
    """s·δ, for another δ and s > 0."""

    bound: DisturbanceBound
    factor: Scalar = eqx.field(converter=as_array("factor"))

    def __check_init__(self) -> None:
        require_positive("factor", _OWNER, self.factor)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.factor * self.bound(position, velocity)

    def range(self, position: Range, velocity: Range) -> Range:
        return self.factor * self.bound.range(position, velocity)

    def describe(self, unit: str, speed: str) -> str:
        return f"{float(self.factor):g} times {self.bound.describe(unit, speed)}"


class NearbyVelocityBound(DisturbanceBound):
    """Another δ, at its largest while the velocity is off by up to `reach` (m/s or rad/s)."""

    bound: DisturbanceBound
    reach: Scalar = eqx.field(converter=as_array("reach"))

    def __check_init__(self) -> None:
        require_at_least_zero("reach", _OWNER, self.reach)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.range(exactly(position), exactly(velocity)).upper

    def range(self, position: Range, velocity: Range) -> Range:
        return self.bound.range(position, velocity + around(self.reach))

    def describe(self, unit: str, speed: str) -> str:
        inner = self.bound.describe(unit, speed)
        return f"{inner}, while the velocity is off by up to {float(self.reach):g} {speed}"
