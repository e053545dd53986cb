"""Interval arithmetic on arrays: what a value can be while others vary in ranges (Moore 1966).

Every function returns a range that contains all values of its expression. Rounding is not directed:
who prints an end as a guarantee leaves room for it.
"""

import functools
import operator
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

Values = Float[Array, "*shape"]


class Range(NamedTuple):
    """All numbers from `lower` to `upper`, entry by entry."""

    lower: Values
    upper: Values


def exactly(value: Values) -> Range:
    """The range that holds one number."""
    return Range(value, value)


def around(radius: Values) -> Range:
    """±radius."""
    return Range(-radius, radius)


def plus(*terms: Range) -> Range:
    """The sum."""
    return Range(_sum([t.lower for t in terms]), _sum([t.upper for t in terms]))


def minus(one: Range, other: Range) -> Range:
    """The difference."""
    return Range(one.lower - other.upper, one.upper - other.lower)


def scaled(factor: Values | float, x: Range) -> Range:
    """A number of either sign times a range."""
    a, b = factor * x.lower, factor * x.upper
    return Range(jnp.minimum(a, b), jnp.maximum(a, b))


def times(one: Range, other: Range) -> Range:
    """The product."""
    return hull(scaled(one.lower, other), scaled(one.upper, other))


def hull(*parts: Range) -> Range:
    """The smallest range that holds all parts."""
    lower, upper = parts[0]
    for part in parts[1:]:
        lower, upper = jnp.minimum(lower, part.lower), jnp.maximum(upper, part.upper)
    return Range(lower, upper)


def common(one: Range, other: Range) -> Range:
    """What two ranges of the same value have in common."""
    return Range(jnp.maximum(one.lower, other.lower), jnp.minimum(one.upper, other.upper))


def size(x: Range) -> Range:
    """|x|."""
    ends = jnp.abs(x.lower), jnp.abs(x.upper)
    across = (x.lower <= 0) & (x.upper >= 0)
    return Range(jnp.where(across, 0.0, jnp.minimum(*ends)), jnp.maximum(*ends))


def _sum(values: Sequence[Values]) -> Values:
    return functools.reduce(operator.add, values)
