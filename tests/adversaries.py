"""Worst-case disturbances and regression rows that several tests use."""

import jax.numpy as jnp

from jaxid.identification.regression_rows import RegressionRows
from jaxid.loop.disturbances import Sequence


def worst_case(weights, size):
    """Return the |Δ| ≤ size that attains the largest error of one row of weights (Theorem 2)."""
    return size * jnp.sign(weights)


def square_wave(ticks, half_period):
    """Return +δ for `half_period` samples, −δ for as many, and so on."""
    return Sequence(1.0 - 2.0 * ((jnp.arange(ticks) // half_period) % 2))


def exact_rows(system, record):
    """Return a record without sensor errors as the regression rows of a log."""
    return RegressionRows(system, record, record.rows.delta, {})
