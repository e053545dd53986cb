"""Regressors: known functions of position and velocity that multiply the unknown parameters."""

import abc
import functools
import math
import operator
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import (
    is_concrete,
    require,
    require_at_least_zero,
    require_positive,
    require_shape,
)
from jaxid._types import Interval, Motion, Scalar, as_array, or_none
from jaxid.model.arctangent import arctan
from jaxid.model.interval_arithmetic import Range, around, exactly, where
from jaxid.model.smoothing import Nonsmooth

_CELLS = 64  # per side of (y, ẏ), for the magnitude of a user's regressor in (18)
_PARTS = 8  # of each range of y and of ẏ, so that slopes of a regressor act over short distances
_PAIRS = {"slopes": "|∂f/∂y| and |∂f/∂ẏ|", "bounds": "smallest and largest value"}
_TRIED = (0.0, 0.25, 0.5, 0.75, 1.0)  # fractions of a range at which f is sampled


class Regressor(eqx.Module):
    """Base class of regressors: a known function f(y, ẏ) that multiplies one unknown parameter."""

    @abc.abstractmethod
    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        """Return f at each pair of position and velocity."""

    @abc.abstractmethod
    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """Return an upper bound of |f| over intervals, for `acceleration_limit` (18)."""

    @abc.abstractmethod
    def range(self, position: Range, velocity: Range) -> Range:
        """Return a range that contains f for all positions and velocities in the given ranges.

        It has the shape of the ranges. A loose range widens every guaranteed interval.
        """

    @property
    def proved(self) -> bool:
        """True if `range` is certain to contain all values of f, False if samples estimate it."""
        return True

    @property
    def formula(self) -> str:
        """The function f as text, for reports; default the name of the class."""
        return f"{type(self).__name__}(y, ẏ)"


class Custom(Regressor):
    """A user-defined regressor f(y, ẏ), with or without bounds on its partial derivatives.

    Without these bounds, its range is estimated from samples; parameters whose results depend on
    that estimate are listed in `System.estimated`. With them results are guaranteed if the bounds
    are true, which is not checked. A function that is steep somewhere, such as tanh(ẏ/0.02), also
    needs `bounds`, or the intervals become wide; a `Regressor` with an exact `range` is tightest.

    Attributes:
        function: f of two arrays of one shape, position and velocity; returns that shape.
        slopes: upper bounds of |∂f/∂y| and |∂f/∂ẏ| wherever f is used, in SI units; None if
            unknown.
        bounds: smallest and largest value of f wherever it is used; None if unknown.

    Raises:
        ValueError: if `slopes` or `bounds` is not a pair of numbers, a slope is below zero or not
            finite, or the bounds are not in increasing order.
    """

    function: Callable[[Motion, Motion], Motion] = eqx.field(static=True)
    slopes: Float[Array, "2"] | None = eqx.field(
        converter=or_none(as_array("slopes")), default=None
    )
    bounds: Float[Array, "2"] | None = eqx.field(
        converter=or_none(as_array("bounds")), default=None
    )

    def __check_init__(self) -> None:
        require(
            callable(self.function),
            f"Argument `function` of a Custom regressor must be a function of position and "
            f"velocity, but is {self.function!r}.",
        )
        for name in ("slopes", "bounds"):
            pair = getattr(self, name)
            if pair is not None:
                require_shape(name, "a Custom regressor", pair, (2,), _PAIRS[name])
        if self.slopes is not None:
            require_at_least_zero("slopes", "a Custom regressor", self.slopes)
        if self.bounds is not None and is_concrete(self.bounds):
            require(
                bool(self.bounds[0] <= self.bounds[1]),
                "Argument `bounds` of a Custom regressor must be its smallest and its largest "
                f"value, but is {self.bounds.tolist()}.",
            )

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.function(position, velocity)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """Return an upper bound of |f|, the largest over 64 × 64 cells of position and velocity.

        Without `slopes`, it is an estimate from samples.
        """
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
        """Return a range of f, from its values in 8 × 8 cells ± its change by `slopes` in a cell.

        Without `slopes`, it is the range of 5 × 5 samples, an estimate.
        """
        found = (
            self._sampled(position, velocity)
            if self.slopes is None
            else self._by_slopes(self.slopes, position, velocity)
        )
        return found if self.bounds is None else found & Range(*self.bounds)

    def _by_slopes(self, slopes: Float[Array, "2"], position: Range, velocity: Range) -> Range:
        shares = (jnp.arange(_PARTS) + 0.5) / _PARTS  # midpoints of cells

        def midpoints(over: Range) -> Array:
            return jnp.stack([over.lower + s * (over.upper - over.lower) for s in shares])

        y, v = midpoints(position)[:, None], midpoints(velocity)[None, :]
        values = self(*jnp.broadcast_arrays(y, v))
        reach = (slopes[0] * position.half_width + slopes[1] * velocity.half_width) / _PARTS
        return Range(jnp.min(values, axis=(0, 1)), jnp.max(values, axis=(0, 1))) + around(reach)

    def _sampled(self, position: Range, velocity: Range) -> Range:
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
        """True if `slopes` is given, so that `range` is certain to contain all values of f."""
        return self.slopes is not None

    @property
    def formula(self) -> str:
        """The formula of f as text: the name of the function."""
        return f"{getattr(self.function, '__name__', 'f').replace('<lambda>', 'f')}(y, ẏ)"


class Viscous(Regressor):
    """Viscous friction: the regressor f = ẏ, in m/s or rad/s."""

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return velocity

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """Return the largest |ẏ| in the interval of the velocity."""
        return jnp.max(jnp.abs(velocity))

    def range(self, position: Range, velocity: Range) -> Range:
        """Return the range of the velocity, which is that of f."""
        return velocity

    @property
    def formula(self) -> str:
        """The formula of f as text: ẏ."""
        return "ẏ"


class Coulomb(Regressor, Nonsmooth):
    """Coulomb friction: the regressor f = S_f(ẏ) = (2/π)·arctan(β ẏ), a smooth sign of ẏ.

    Attributes:
        beta: β, the steepness of the smooth sign, in s/m or s/rad; above zero.
        blend: width over which a search smooths the sign at zero speed, m/s or rad/s; leave it at
            zero, the default, the exact regressor.

    Raises:
        ValueError: if `beta` is not above zero, or `blend` is below zero, or one is not finite.
    """

    beta: Scalar = eqx.field(converter=as_array("beta"))
    blend: Motion = eqx.field(converter=as_array("blend"), default=0.0)

    def __check_init__(self) -> None:
        require_positive("beta", "a Coulomb regressor", self.beta)
        require_at_least_zero("blend", "a Coulomb regressor", self.blend)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        sign = (2 / jnp.pi) * arctan(self.beta * velocity)
        square, width = velocity**2, self.blend**2
        # a smaller β would smooth the sign too, but its tails reach far beyond that speed
        return sign * jnp.where(width > 0, square / jnp.where(width > 0, square + width, 1.0), 1.0)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """Return 1, the limit of |f| at high speed."""
        # "always between -1 and 1", as the paper puts it; the sign itself in the limit β → ∞
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        """Return the exact range of f, which is monotone in ẏ."""
        return Range(*(self(x, v) for x, v in zip(position, velocity, strict=True)))  # monotone

    def smoothed(self, speed: Motion) -> "Coulomb":
        """Return a copy that is flattened around zero over a further `speed` (m/s or rad/s)."""
        return Coulomb(self.beta, self.blend + speed)

    @property
    def formula(self) -> str:
        """The formula of f as text: (2/π)·arctan(β·ẏ) with the number β."""
        return f"(2/π)·arctan({float(self.beta):g}·ẏ)"


class Constant(Regressor):
    """A constant offset of the input: the regressor f = 1."""

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return jnp.ones_like(velocity)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """Return 1, the value of f."""
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        """Return the range that holds only 1, in the shape of the velocity."""
        return exactly(jnp.ones_like(velocity.lower))

    @property
    def formula(self) -> str:
        """The formula of f as text: 1."""
        return "1"


class Sign(Regressor):
    """Dry friction with a jump at rest: the regressor f = sign(ẏ), between −1 and 1 at ẏ = 0.

    A simulation takes f = 0 at ẏ = 0. For a search by gradients `Coulomb` with a large β is better,
    because the derivative of a sign is zero.
    """

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return jnp.sign(velocity)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """Return 1, the largest |f|."""
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        """Return the range of sign(ẏ); at ẏ = 0 it is [−1, 1]."""
        lower, upper = velocity
        return Range(jnp.where(lower > 0, 1.0, -1.0), jnp.where(upper < 0, -1.0, 1.0))

    @property
    def formula(self) -> str:
        """The formula of f as text: sign(ẏ)."""
        return "sign(ẏ)"


class Spring(Regressor):
    """A linear spring: the regressor f = y − rest, in m or rad.

    Attributes:
        rest: position at which the spring exerts no force, m or rad.
    """

    rest: Scalar = eqx.field(converter=as_array("rest"), default=0.0)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return position - self.rest

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """Return the largest |y − rest| in the interval of the position."""
        return jnp.max(jnp.abs(position - self.rest))

    def range(self, position: Range, velocity: Range) -> Range:
        """Return the exact range of y − rest."""
        return position - self.rest

    @property
    def formula(self) -> str:
        """The formula of f as text: (y − rest) with the number."""
        return f"(y{_plus(-float(self.rest))})"


class OneWay(Regressor):
    """A regressor that acts in one direction of motion, and is zero in the other and at rest.

    Two of them, forward and backward, model friction that depends on the direction.

    Attributes:
        regressor: regressor in that direction, a function of velocity that is zero at rest unless
            it jumps there.
        forward: True for ẏ > 0, the default; False for ẏ < 0.
    """

    regressor: Regressor
    forward: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        require(
            isinstance(self.regressor, Regressor),
            "Argument `regressor` of a OneWay must be a regressor such as jaxid.Viscous(), but is "
            f"{self.regressor!r}.",
        )
        require(
            isinstance(self.forward, bool),
            f"Argument `forward` of a OneWay must be True or False, but is {self.forward!r}.",
        )

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        moves = velocity > 0 if self.forward else velocity < 0
        return jnp.where(moves, self.regressor(position, velocity), 0.0)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """Return the upper bound of |f| of the other regressor over the same intervals."""
        return self.regressor.magnitude(position, velocity)

    def range(self, position: Range, velocity: Range) -> Range:
        """Return the range of the other regressor in its direction, and zero elsewhere."""
        lower, upper = velocity
        clip = jnp.maximum if self.forward else jnp.minimum
        moving = self.regressor.range(position, Range(clip(lower, 0.0), clip(upper, 0.0)))
        always = lower > 0 if self.forward else upper < 0
        never = upper < 0 if self.forward else lower > 0
        return where(never, exactly(0.0), where(always, moving, moving | 0.0))

    @property
    def proved(self) -> bool:
        """True if the range of the other regressor is certain to contain all its values."""
        return self.regressor.proved

    @property
    def formula(self) -> str:
        """The formula of f as text: that of the other regressor, and the direction."""
        return f"[{self.regressor.formula} for ẏ {'>' if self.forward else '<'} 0]"


class Sine(Regressor):
    """A periodic force: f = sin(2π y/pitch + phase), such as gravity on a joint or cogging.

    Attributes:
        phase: phase in rad; π/2 makes f a cosine.
        pitch: period of f, m or rad; default 2π; above zero.

    Raises:
        ValueError: if `pitch` is not above zero and finite.
    """

    phase: Scalar = eqx.field(converter=as_array("phase"), default=0.0)
    pitch: Scalar = eqx.field(converter=as_array("pitch"), default=2 * math.pi)

    def __check_init__(self) -> None:
        require_positive("pitch", "a Sine regressor", self.pitch)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return jnp.sin(self._angle(position))

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """Return 1, the amplitude of f."""
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        """Return the exact range of f over the range of the position."""
        low, high = (self._angle(x) for x in position)
        ends = exactly(jnp.sin(low)) | jnp.sin(high)
        crest, trough = (_holds_multiple(low - x, high - x) for x in (jnp.pi / 2, -jnp.pi / 2))
        return Range(jnp.where(trough, -1.0, ends.lower), jnp.where(crest, 1.0, ends.upper))

    @property
    def formula(self) -> str:
        """The formula of f as text: sin(2π·y/pitch + phase) with the numbers."""
        pitch = float(self.pitch)
        angle = "y" if math.isclose(pitch, 2 * math.pi) else f"2π·y/{pitch:g}"
        return f"sin({angle}{_plus(float(self.phase))})"

    def _angle(self, position: Motion) -> Motion:
        return 2 * math.pi / self.pitch * position + self.phase


def _holds_multiple(low: Motion, high: Motion) -> Array:
    """Return whether a multiple of 2π lies between `low` and `high`."""
    return jnp.ceil(low / (2 * jnp.pi)) <= jnp.floor(high / (2 * jnp.pi))


def _plus(number: float) -> str:
    """Return a number as the second summand of a formula; nothing for zero."""
    return f" {'+' if number > 0 else '−'} {abs(number):g}" if number else ""
