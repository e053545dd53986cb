"""Filters on a Record: a lower-triangular Toeplitz matrix on ticks, applied alike to every column.

The regression identity is linear in its columns, so it survives any such filter exactly; and
|Δ_f| ≤ δ_f as long as the entries of the matrix are nowhere negative.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid.record import Record
from jaxid.system import Scalar


def low_pass(
    columns: Float[Array, "n *c"], bandwidth: Scalar | float, period: Scalar | float
) -> Float[Array, "n *c"]:
    """H_f(s) = w/(s + w) of (28), started at zero, on signals that are constant over each tick.

    x_f,k = α·x_f,k−1 + (1 − α)·x_k with α = exp(−w·period): exact at the end of each tick for the
    held input, and the same linear map of every other column.

    Args:
        columns: time along the first axis.
        bandwidth: w in rad/s.
        period: of the ticks, s.
    """
    keep = jnp.exp(-bandwidth * period)

    def step(
        filtered: Float[Array, "*c"], column: Float[Array, "*c"]
    ) -> tuple[Float[Array, "*c"], Float[Array, "*c"]]:
        filtered = keep * filtered + (1 - keep) * column
        return filtered, filtered

    return jax.lax.scan(step, jnp.zeros_like(columns[0]), columns)[1]


def adjoint(
    weights: Float[Array, " n"], bandwidth: Scalar | float, period: Scalar | float
) -> Float[Array, " n"]:
    """What weights on filtered rows are as weights on the rows themselves: H_fᵀ g."""
    return jnp.flip(low_pass(jnp.flip(weights), bandwidth, period))


@eqx.filter_jit
def filtered(record: Record, bandwidth: Scalar | float, period: Scalar | float) -> Record:
    """(28): the record with u, φ, δ and Δ all filtered by H_f; the measure of a row stays."""
    passed = jax.tree.map(lambda column: low_pass(column, bandwidth, period), record)
    return eqx.tree_at(lambda r: r.rows.measure, passed, record.rows.measure)
