"""Disturbances and rows that tests hold the library against."""

import jax.numpy as jnp

from jaxid.identification.regression_rows import RegressionRows
from jaxid.loop.disturbances import Sequence


def worst_case(weights, size):
    """What is within ±size and attains the worst case of one row of weights (Theorem 2)."""
    return size * jnp.sign(weights)


def square_wave(ticks, half_period):
    """+δ for `half_period` ticks, then −δ for as many, and so on."""
    return Sequence(1.0 - 2.0 * ((jnp.arange(ticks) // half_period) % 2))


def exact_rows(system, record):
    """A record without errors of a sensor, for what takes the rows of a log."""
    return RegressionRows(system, record, record.rows.delta, {})
