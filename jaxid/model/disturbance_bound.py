"""The disturbance bound δ(y, ẏ): the largest magnitude of all unmodelled effects (3)."""

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
    """Base class of disturbance bounds: δ(y, ẏ) > 0 with |Δ| ≤ δ, in the unit of the input (3)."""

    @abc.abstractmethod
    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        """Return δ at each pair of position and velocity, in the unit of the input."""

    @abc.abstractmethod
    def range(self, position: Range, velocity: Range) -> Range:
        """Return a range that contains δ for all positions and velocities in the given ranges."""

    def scaled(self, factor: Scalar | float) -> "DisturbanceBound":
        """Return `factor` times this disturbance bound, of the same class where that is possible.

        Functions that are compiled for this bound then need not be compiled again.

        Args:
            factor: factor of δ, above zero.
        """
        return ScaledBound(self, factor)

    def describe(self, unit: str, speed: str) -> str:
        """Return the disturbance bound in words and numbers, for reports.

        Args:
            unit: unit of the input, e.g. "V".
            speed: unit of ẏ, e.g. "m/s".
        """
        return f"δ of {type(self).__name__}, in {unit}"


class ConstantBound(DisturbanceBound):
    """A disturbance bound δ that is the same at all positions and velocities.

    Attributes:
        level: value of δ, in the unit of the input; above zero.

    Raises:
        ValueError: if `level` is not above zero and finite.
    """

    level: Scalar = eqx.field(converter=as_array("level"))

    def __check_init__(self) -> None:
        require_positive("level", _OWNER, self.level)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.level * jnp.ones_like(velocity)

    def range(self, position: Range, velocity: Range) -> Range:
        """Return the range that holds only `level`, whatever position and velocity are."""
        return exactly(self(position.lower, velocity.lower))

    def scaled(self, factor: Scalar | float) -> "ConstantBound":
        return ConstantBound(factor * self.level)

    def describe(self, unit: str, speed: str) -> str:
        """Return the level of δ with its unit, e.g. "6 N"."""
        return f"{float(self.level):.12g} {unit}"


class SpeedBand(DisturbanceBound, Nonsmooth):
    """A disturbance bound δ with one level at low speed and another above a threshold of |ẏ| (33).

    Attributes:
        slow: δ where |ẏ| ≤ `threshold`, in the unit of the input; above zero.
        fast: δ where |ẏ| > `threshold`, in the unit of the input; above zero.
        threshold: speed at which δ jumps, m/s or rad/s; at least zero.
        blend: speed range over which the jump is smoothed, m/s or rad/s; zero, the default, is the
            exact bound.

    Raises:
        ValueError: if one of them is out of its range.
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
        """Return the exact range of δ over the range of the velocity, at any position."""
        slowest, fastest = (self(position.lower, speed) for speed in abs(velocity))
        return exactly(slowest) | fastest  # monotone in |ẏ|

    def scaled(self, factor: Scalar | float) -> "SpeedBand":
        return SpeedBand(factor * self.slow, factor * self.fast, self.threshold, self.blend)

    def describe(self, unit: str, speed: str) -> str:
        """Return both levels of δ and the threshold speed, with their units."""
        return (
            f"{float(self.slow):.12g} {unit} up to {float(self.threshold):.12g} {speed} and "
            f"{float(self.fast):.12g} {unit} above"
        )

    def smoothed(self, speed: Motion) -> "SpeedBand":
        """Return a copy whose jump is spread over `speed` (m/s or rad/s) more than before."""
        return SpeedBand(self.slow, self.fast, self.threshold, self.blend + speed)


class ScaledBound(DisturbanceBound):
    """Another disturbance bound times a constant factor.

    Attributes:
        bound: disturbance bound δ that is scaled.
        factor: factor of δ, above zero.

    Raises:
        ValueError: if `factor` is not above zero and finite.
    """

    bound: DisturbanceBound
    factor: Scalar = eqx.field(converter=as_array("factor"))

    def __check_init__(self) -> None:
        require_positive("factor", _OWNER, self.factor)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.factor * self.bound(position, velocity)

    def range(self, position: Range, velocity: Range) -> Range:
        """Return `factor` times the range of the other disturbance bound."""
        return self.factor * self.bound.range(position, velocity)

    def scaled(self, factor: Scalar | float) -> "ScaledBound":
        """Return the other disturbance bound times both factors."""
        return ScaledBound(self.bound, factor * self.factor)

    def describe(self, unit: str, speed: str) -> str:
        """Return the factor, followed by the description of the other disturbance bound."""
        return f"{float(self.factor):.12g} times {self.bound.describe(unit, speed)}"


class NearbyVelocityBound(DisturbanceBound):
    """The largest value of another disturbance bound over all velocities within `reach` of ẏ.

    Attributes:
        bound: disturbance bound δ whose largest value is taken.
        reach: largest deviation of the velocity, m/s or rad/s; at least zero.

    Raises:
        ValueError: if `reach` is below zero or not finite.
    """

    bound: DisturbanceBound
    reach: Scalar = eqx.field(converter=as_array("reach"))

    def __check_init__(self) -> None:
        require_at_least_zero("reach", _OWNER, self.reach)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.range(exactly(position), exactly(velocity)).upper

    def range(self, position: Range, velocity: Range) -> Range:
        """Return the range of the other disturbance bound with `velocity` widened by ±`reach`."""
        return self.bound.range(position, velocity + around(self.reach))

    def describe(self, unit: str, speed: str) -> str:
        """Return the other bound in words, followed by the deviation of the velocity."""
        inner = self.bound.describe(unit, speed)
        return f"{inner}, while the velocity is off by up to {float(self.reach):.12g} {speed}"
