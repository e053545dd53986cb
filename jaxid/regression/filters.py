"""Filters on a Record: a lower-triangular Toeplitz matrix, applied alike to every column.

The regression identity is linear in its columns, so any such filter preserves it exactly; and
|Δ_f| ≤ δ_f as long as no entry of the matrix is negative.
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
    """Return signals filtered by H_f(s) = w/(s + w) of (28), from a zero initial state.

    The signals are constant over each sample period: x_f,k = α·x_f,k−1 + (1 − α)·x_k with
    α = exp(−w·period). For the held input this is exact at the end of each sample period; to every
    other column the same linear map is applied.

    Args:
        columns: array or structure of arrays, time along the first axis. One scan filters them all,
            so that five take little longer than one.
        bandwidth: bandwidth w, rad/s.
        period: sample period, s.
    """
    keep = jnp.exp(-bandwidth * period)

    def step(filtered: Any, column: Any) -> tuple[Any, Any]:
        filtered = jax.tree.map(lambda f, c: keep * f + (1 - keep) * c, filtered, column)
        return filtered, filtered

    return jax.lax.scan(step, jax.tree.map(lambda c: jnp.zeros_like(c[0]), columns), columns)[1]


def adjoint(
    weights: Float[Array, " n"], bandwidth: Scalar | float, period: Scalar | float
) -> Float[Array, " n"]:
    """Return the weights H_fᵀ g on unfiltered rows that equal the weights g on filtered rows.

    Args:
        weights: weights g on filtered rows, shape (n,).
        bandwidth: bandwidth w of H_f, rad/s.
        period: sample period of the rows, s.
    """
    return jnp.flip(low_pass(jnp.flip(weights), bandwidth, period))


def filtered_rows(rows: Rows, bandwidth: Scalar | float, period: Scalar | float) -> Rows:
    """Return regression rows with φ and δ filtered by H_f of (28), and the same measure.

    Args:
        rows: regression rows.
        bandwidth: bandwidth w of H_f, rad/s.
        period: sample period of the rows, s.
    """
    passed = low_pass(rows, bandwidth, period)
    return eqx.tree_at(lambda r: r.measure, passed, rows.measure)


@eqx.filter_jit
def filtered(record: Record, bandwidth: Scalar | float, period: Scalar | float) -> Record:
    """Return a record with u, φ, δ and Δ filtered by H_f of (28), and the same measure.

    Args:
        record: regression rows with their inputs.
        bandwidth: bandwidth w of H_f, rad/s.
        period: sample period of the record, s.
    """
    passed = low_pass(record, bandwidth, period)
    return eqx.tree_at(lambda r: r.rows.measure, passed, record.rows.measure)
