"""Types of arrays by their meaning, and products of the regression form."""

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, ""]
Motion = Float[Array, "*shape"]
Interval = Float[Array, "2"]
Ends = Sequence[float] | Float[Array, "2"]


def as_interval(ends: Sequence[float] | Array) -> Array:
    """Return a few numbers as one array in the default float type."""
    return jnp.asarray(ends, dtype=float)


def dot(columns: Sequence[Motion], theta: Float[Array, " m"]) -> Motion:
    """Return Σ_j columns[j]·θ_j, in the shape of a column.

    It is summed column by column: scalars stay scalars, so that a scan is one kernel.
    """
    total = columns[0] * theta[0]
    for j, column in enumerate(columns[1:], start=1):
        total = total + column * theta[j]
    return total
