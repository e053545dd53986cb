"""Interval arithmetic on arrays: all values of an expression while its operands vary (Moore 1966).

An expression of ranges is written like one of numbers, `M * a + B * v`, and its result contains
every value that it takes while each operand takes any value of its range, independently of the
others: `x - x` is not zero. Rounding is not directed: leave room for it before you report an end
as a guarantee.
"""

from collections.abc import Callable, Iterator
from typing import Any, NoReturn

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Real

Values = Float[Array, "*shape"]
Number = Real[ArrayLike, "..."]


def _refused(sentence: str) -> Callable[..., NoReturn]:
    """Return a method that raises a TypeError."""

    def method(*operands: Any) -> NoReturn:
        raise TypeError(sentence)

    return method


class Range(eqx.Module):
    """All numbers from `lower` to `upper`, entry by entry, with the operators of numbers.

    `+`, `-`, `*`, `/` and `abs` give the range of the result. `x | y` is the smallest range that
    contains both (the hull), `x & y` the intersection. One operand may be a number or an array, of
    JAX or NumPy, on either side: it stands for the range of that one value, and must not be zero as
    a divisor. `lower, upper = x` unpacks the ends.

    A range whose lower end is above its upper end is empty, as `x & y` is if x and y have no value
    in common. Only `&` is sure to keep an empty range empty: check for it before you apply another
    operator. An end that is NaN, such as 0·∞, bounds nothing.

    Attributes:
        lower: lower ends, an array of any shape.
        upper: upper ends, of the same shape.
    """

    lower: Values = eqx.field(converter=jnp.asarray)
    upper: Values = eqx.field(converter=jnp.asarray)

    __array_ufunc__ = None  # NumPy then passes `array * range` to the range

    @property
    def middle(self) -> Values:
        """The midpoint of the range, entry by entry."""
        return (self.lower + self.upper) / 2

    @property
    def half_width(self) -> Values:
        """Half the distance between the ends, entry by entry; below zero if the range is empty."""
        return (self.upper - self.lower) / 2

    def __iter__(self) -> Iterator[Values]:
        return iter((self.lower, self.upper))

    def __neg__(self) -> "Range":
        return Range(-self.upper, -self.lower)

    def __abs__(self) -> "Range":
        ends = jnp.abs(self.lower), jnp.abs(self.upper)
        return Range(jnp.where(_holds_zero(self), 0.0, jnp.minimum(*ends)), jnp.maximum(*ends))

    def __add__(self, other: "Range | Number") -> "Range":
        lower, upper = _ends(other)
        return Range(self.lower + lower, self.upper + upper)

    def __sub__(self, other: "Range | Number") -> "Range":
        lower, upper = _ends(other)
        return Range(self.lower - upper, self.upper - lower)

    def __rsub__(self, other: Number) -> "Range":
        return -self + other

    def __mul__(self, other: "Range | Number") -> "Range":
        if isinstance(other, Range):
            return other * self.lower | other * self.upper
        factor, _ = _ends(other)
        return exactly(self.lower * factor) | self.upper * factor

    def __truediv__(self, other: "Range | Number") -> "Range":
        if isinstance(other, Range):
            return self * (1 / other)
        divisor, _ = _ends(other)
        return exactly(self.lower / divisor) | self.upper / divisor

    def __rtruediv__(self, other: Number) -> "Range":
        """Return the range of `other`/x; all real numbers where x contains zero."""
        quotient = exactly(other / self.lower) | other / self.upper
        return where(_holds_zero(self), around(jnp.inf), quotient)

    def __or__(self, other: "Range | Number") -> "Range":
        lower, upper = _ends(other)
        return Range(jnp.minimum(self.lower, lower), jnp.maximum(self.upper, upper))

    def __and__(self, other: "Range | Number") -> "Range":
        lower, upper = _ends(other)
        return Range(jnp.maximum(self.lower, lower), jnp.minimum(self.upper, upper))

    __radd__, __rmul__, __ror__, __rand__ = __add__, __mul__, __or__, __and__

    def __eq__(self, other: object) -> Any:
        """Return whether two ranges have equal ends.

        Raises:
            TypeError: if `other` is not a range.
        """
        return super().__eq__(other) if isinstance(other, Range) else self < other

    __lt__ = __le__ = __gt__ = __ge__ = __contains__ = _refused(
        "A Range is not compared with a value, which may be below, within or above it: compare "
        "its ends `lower` and `upper`, which are arrays."
    )
    __getitem__ = _refused(
        "A Range is not indexed, for its ends might be meant or its entries: write `x.lower` and "
        "`x.upper`, or `jax.tree.map(lambda end: end[0], x)`."
    )
    __array__ = _refused("A Range is not an array: its ends `lower` and `upper` are.")


def exactly(value: Number) -> Range:
    """Return the range that holds one number only, or one array entry by entry."""
    return Range(value, value)


def around(radius: Values | float) -> Range:
    """Return the range from −radius to radius, entry by entry."""
    return Range(-radius, radius)


def where(condition: Bool[Array, "..."], one: Range, other: Range) -> Range:
    """Return the range `one` where the condition holds and `other` elsewhere, entry by entry."""
    return jax.tree.map(lambda x, y: jnp.where(condition, x, y), one, other)


def _holds_zero(x: Range) -> Bool[Array, "*shape"]:
    return (x.lower <= 0) & (x.upper >= 0)


def _ends(operand: Any) -> tuple[Number, Number]:
    """Return the ends of a range, or a number twice.

    Raises:
        TypeError: if the operand is neither a range nor a number or array.
    """
    if isinstance(operand, Range):
        return operand.lower, operand.upper
    if not eqx.is_array_like(operand):
        raise TypeError(
            "A Range is combined with ranges, numbers and arrays, but not with a "
            f"{type(operand).__name__}: make a Range or an array of it."
        )
    return operand, operand
