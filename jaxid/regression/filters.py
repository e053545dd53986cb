"""Filters on a Record: a lower-triangular Toeplitz matrix on ticks, applied alike to every column.

The regression identity is linear in its columns, so it survives any such filter exactly; and
|Δ_f| ≤ δ_f as long as the entries of the matrix are nowhere negative.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from jaxid._types import Scalar
from jaxid.loop.record import Record, Rows


def low_pass(
    columns: PyTree[Float[Array, "n *c"]], bandwidth: Scalar | float, period: Scalar | float
) -> PyTree[Float[Array, "n *c"]]:
    """H_f(s) = w/(s + w) of (28), started at zero, on signals that are constant over each tick.

    x_f,k = α·x_f,k−1 + (1 − α)·x_k with α = exp(−w·period): exact at the end of each tick for the
    held input, and the same linear map of every other column.

    Args:
        columns: an array or several, time along the first axis. One scan takes them all: each waits
            for its own last value only, so that five take little longer than one.
        bandwidth: w in rad/s.
        period: of the ticks, s.
    """
    keep = jnp.exp(-bandwidth * period)

    def step(filtered: Any, column: Any) -> tuple[Any, Any]:
        filtered = jax.tree.map(lambda f, c: keep * f + (1 - keep) * c, filtered, column)
        return filtered, filtered

    return jax.lax.scan(step, jax.tree.map(lambda c: jnp.zeros_like(c[0]), columns), columns)[1]


def adjoint(
    weights: Float[Array, " n"], bandwidth: Scalar | float, period: Scalar | float
) -> Float[Array, " n"]:
    """What weights on filtered rows are as weights on the rows themselves: H_fᵀ g."""
    return jnp.flip(low_pass(jnp.flip(weights), bandwidth, period))


def filtered_rows(rows: Rows, bandwidth: Scalar | float, period: Scalar | float) -> Rows:
    """The rows that a filtered record has: φ and δ filtered by H_f; the measure of a row stays."""
    passed = low_pass(rows, bandwidth, period)
    return eqx.tree_at(lambda r: r.measure, passed, rows.measure)


@eqx.filter_jit
def filtered(record: Record, bandwidth: Scalar | float, period: Scalar | float) -> Record:
    """(28): the record with u, φ, δ and Δ all filtered by H_f; the measure of a row stays."""
    passed = low_pass(record, bandwidth, period)
    return eqx.tree_at(lambda r: r.rows.measure, passed, record.rows.measure)
