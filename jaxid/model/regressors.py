"""What multiplies the unknown parameters: known functions of position and velocity."""

import abc
import functools
import math
import operator
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import require_at_least_zero, require_positive
from jaxid._types import Interval, Motion, Scalar, as_array, as_interval
from jaxid.model.interval_arithmetic import Range, around, exactly, where
from jaxid.model.smoothing import Nonsmooth

_CELLS = 64  # per side, in which a user's own regressor is looked at for (18)
_TRIED = (0.0, 0.25, 0.5, 0.75, 1.0)  # of a range, if nothing is known of its slopes


class Regressor(eqx.Module):
    """A known function f(y, ẏ) that multiplies one unknown parameter."""

    @abc.abstractmethod
    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        """F at each pair of position and velocity."""

    @abc.abstractmethod
    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """An upper bound of |f| while position and velocity stay in their intervals, for (18)."""

    @abc.abstractmethod
    def range(self, position: Range, velocity: Range) -> Range:
        """All values of f while position and velocity stay in their ranges; wider is allowed."""

    @property
    def proved(self) -> bool:
        """Whether `range` really holds all values, or only those that were tried."""
        return True


class Custom(Regressor):
    """A user's own f(y, ẏ), with bounds of its slopes or without.

    Without them its values between any points are only estimated, by some that are tried, and what
    rests on them is marked so.

    Attributes:
        function: of arrays of one shape.
        slopes: |∂f/∂y| and |∂f/∂ẏ| at most, where f is used.
    """

    function: Callable[[Motion, Motion], Motion] = eqx.field(static=True)
    slopes: Float[Array, "2"] | None = eqx.field(
        converter=lambda slopes: None if slopes is None else as_interval(slopes), default=None
    )

    def __check_init__(self) -> None:
        if self.slopes is not None:
            require_at_least_zero("slopes", "a Custom regressor", self.slopes)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.function(position, velocity)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """Over cells of the box, in each of which `range` holds."""
        shares = jnp.linspace(0.0, 1.0, _CELLS + 1)
        (y0, y1), (v0, v1) = (
            (low + shares[:-1] * (high - low), low + shares[1:] * (high - low))
            for low, high in (position, velocity)
        )
        cells = [
            jnp.stack([x.ravel() for x in jnp.meshgrid(*pair)]) for pair in ((y0, v0), (y1, v1))
        ]
        values = self.range(*(Range(low, high) for low, high in zip(*cells, strict=True)))
        return jnp.max(abs(values).upper)

    def range(self, position: Range, velocity: Range) -> Range:
        """By the slopes from the middle on; without them, as far as points that are tried show."""
        if self.slopes is not None:
            reach = self.slopes[0] * position.half_width + self.slopes[1] * velocity.half_width
            return self(position.middle, velocity.middle) + around(reach)
        tried = [
            exactly(
                self(
                    position.lower + s * (position.upper - position.lower),
                    velocity.lower + t * (velocity.upper - velocity.lower),
                )
            )
            for s in _TRIED
            for t in _TRIED
        ]
        return functools.reduce(operator.or_, tried)

    @property
    def proved(self) -> bool:
        return self.slopes is not None


class Viscous(Regressor):
    """f = ẏ."""

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return velocity

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        return jnp.max(jnp.abs(velocity))

    def range(self, position: Range, velocity: Range) -> Range:
        return velocity


class Coulomb(Regressor, Nonsmooth):
    """f = S_f(ẏ) = (2/π)·arctan(β ẏ), a smooth sign of the velocity. β in s/m or s/rad.

    `blend` notches it around zero over about that speed; zero, the default, is the exact regressor.
    """

    beta: Scalar = eqx.field(converter=as_array("beta"))
    blend: Motion = eqx.field(converter=as_array("blend"), default=0.0)

    def __check_init__(self) -> None:
        require_positive("beta", "a Coulomb regressor", self.beta)
        require_at_least_zero("blend", "a Coulomb regressor", self.blend)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        sign = (2 / jnp.pi) * jnp.arctan(self.beta * velocity)
        square, width = velocity**2, self.blend**2
        # a smaller β would spread the sign too, but its tails reach far beyond the speed asked for
        return sign * jnp.where(width > 0, square / jnp.where(width > 0, square + width, 1.0), 1.0)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        # "always between -1 and 1", as the paper puts it; the sign itself in the limit β → ∞
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        return Range(*(self(x, v) for x, v in zip(position, velocity, strict=True)))  # monotone

    def smoothed(self, speed: Motion) -> "Coulomb":
        return Coulomb(self.beta, self.blend + speed)


class Constant(Regressor):
    """f = 1: an offset."""

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return jnp.ones_like(velocity)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        return exactly(jnp.ones_like(velocity.lower))


class Sign(Regressor):
    """f = sign(ẏ): dry friction, which at rest may be anything from −1 to 1.

    A simulation takes zero there. For a search by gradients `Coulomb` with a large β is the better
    choice, since the slope of a sign is zero.
    """

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return jnp.sign(velocity)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        lower, upper = velocity
        return Range(jnp.where(lower > 0, 1.0, -1.0), jnp.where(upper < 0, -1.0, 1.0))


class Spring(Regressor):
    """f = y − rest."""

    rest: Scalar = eqx.field(converter=as_array("rest"), default=0.0)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return position - self.rest

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        return jnp.max(jnp.abs(position - self.rest))

    def range(self, position: Range, velocity: Range) -> Range:
        return position - self.rest


class OneWay(Regressor):
    """Another regressor while the axis moves forward, or backward, and zero otherwise.

    Two of them make friction that depends on the direction.

    Attributes:
        regressor: of velocity, zero at rest unless it jumps there.
        forward: ẏ > 0; or else ẏ < 0.
    """

    regressor: Regressor
    forward: bool = eqx.field(static=True, default=True)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        moves = velocity > 0 if self.forward else velocity < 0
        return jnp.where(moves, self.regressor(position, velocity), 0.0)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        return self.regressor.magnitude(position, velocity)

    def range(self, position: Range, velocity: Range) -> Range:
        """That of the other regressor where the axis moves so, and zero if it may not."""
        lower, upper = velocity
        clip = jnp.maximum if self.forward else jnp.minimum
        moving = self.regressor.range(position, Range(clip(lower, 0.0), clip(upper, 0.0)))
        always = lower > 0 if self.forward else upper < 0
        never = upper < 0 if self.forward else lower > 0
        return where(never, exactly(0.0), where(always, moving, moving | 0.0))

    @property
    def proved(self) -> bool:
        return self.regressor.proved


class Sine(Regressor):
    """f = sin(2π y/pitch + phase): gravity on a joint (y in rad), or a harmonic of cogging.

    Attributes:
        phase: π/2 makes it a cosine.
        pitch: m or rad until it repeats; default 2π.
    """

    phase: Scalar = eqx.field(converter=as_array("phase"), default=0.0)
    pitch: Scalar = eqx.field(converter=as_array("pitch"), default=2 * math.pi)

    def __check_init__(self) -> None:
        require_positive("pitch", "a Sine regressor", self.pitch)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return jnp.sin(self._angle(position))

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        low, high = (self._angle(x) for x in position)
        ends = exactly(jnp.sin(low)) | jnp.sin(high)
        crest, trough = (_holds_multiple(low - x, high - x) for x in (jnp.pi / 2, -jnp.pi / 2))
        return Range(jnp.where(trough, -1.0, ends.lower), jnp.where(crest, 1.0, ends.upper))

    def _angle(self, position: Motion) -> Motion:
        return 2 * math.pi / self.pitch * position + self.phase


def _holds_multiple(low: Motion, high: Motion) -> Array:
    """Whether a multiple of 2π lies between."""
    return jnp.ceil(low / (2 * jnp.pi)) <= jnp.floor(high / (2 * jnp.pi))
