"""The paper's identification from a sampled, quantised log: (28) as printed, and corrected."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._types import Scalar
from jaxid.loop.record import Record, Rows, rows_of
from jaxid.model.system import System
from jaxid.motion.trajectory import States
from jaxid.regression.filters import low_pass


def differenced_record(
    system: System,
    input: Float[Array, " n"],
    position: Float[Array, " n+1"],
    period: Scalar | float,
) -> Record:
    """Return the record of a log by the paper's identification, with differences as derivatives.

    Row k has the measured velocity (y_{k+1} − y_k)/h, which is the mean of sample period k. Its
    acceleration is the backward difference of these velocities, which lags by half a sample period.
    The bound δ does *not* account for quantisation, for this lag, or for S_f and δ being evaluated
    at the measured velocity, so no guarantee follows.
    """
    velocity = jnp.diff(position, prepend=position[:1]) / period
    states = States(position[1:], velocity[1:], jnp.diff(velocity) / period)
    return Record(rows_of(system, states, jnp.full_like(input, period)), input, None)


def printed_record(
    system: System,
    input: Float[Array, " n"],
    position: Float[Array, " n+1"],
    bandwidth: Scalar | float,
    period: Scalar | float,
) -> Record:
    """Return the record of a log by (28) as printed, with backward differences for ẏ.

    The acceleration is w·(ẏ − ẏ_f). The difference is the velocity of half a sample period ago, so
    w·(ẏ − ẏ_f) is too large by about w·period/2: 10 % at w = 1000 rad/s and 0.2 ms. The estimate of
    the inertia is too small by as much, outside its own bound (29) whatever the disturbance. The
    filtered `differenced_record` does not have this error, but still has the other ones that its
    docstring lists.

    Args:
        system: system with its regressors and disturbance bound δ.
        input: commanded input, one value per sample.
        position: logged position, one sample more than the input.
        bandwidth: bandwidth w of H_f, rad/s.
        period: sample period, s.
    """
    velocity = jnp.diff(position, prepend=position[:1])[:-1] / period

    def so_far(column: Float[Array, " n"]) -> Float[Array, " n"]:
        """Return the output of the filter at the start of each sample period."""
        return jnp.append(0.0, low_pass(column, bandwidth, period)[:-1])

    states = States(position[:-1], velocity, jnp.zeros_like(velocity))
    rows = rows_of(system, states, jnp.full_like(input, period))
    acceleration = bandwidth * (velocity - so_far(velocity))
    columns = (acceleration, *(so_far(column) for column in rows.columns[1:]))
    return Record(Rows(columns, so_far(rows.delta), rows.measure), so_far(input), None)
