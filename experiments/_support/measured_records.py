"""The paper's identification on a sampled, quantised log: (28) as printed, and repaired."""

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
    """The Record that the paper's identification makes of a log, with differences for derivatives.

    Tick k has the measured velocity (y_{k+1} − y_k)/h, its mean, and for its mean acceleration the
    backward difference of those velocities, which lags by half a tick. Quantisation, that lag and
    S_f and δ taken at the measured velocity are *not* in the bound δ: no guarantee follows.
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
    """(28) as printed, on a log: w·(ẏ − ẏ_f) for the acceleration, ẏ by backward differences.

    The difference is the velocity of half a tick ago, so w·(ẏ − ẏ_f) is too large by about
    w·period/2, 10 % at w = 1000 rad/s and 0.2 ms: the estimate of the inertia is that much too low,
    outside its own bound (29) whatever the disturbance. `differenced_record`, filtered, has no such
    error, but quantisation and the rest of its docstring stay.

    Args:
        system: for its regressors and δ.
        input: as commanded, one value per tick.
        position: as logged, one instant more.
        bandwidth: w of H_f in rad/s.
        period: of the ticks, s.
    """
    velocity = jnp.diff(position, prepend=position[:1])[:-1] / period

    def so_far(column: Float[Array, " n"]) -> Float[Array, " n"]:
        """What the filter holds at the start of each tick."""
        return jnp.append(0.0, low_pass(column, bandwidth, period)[:-1])

    states = States(position[:-1], velocity, jnp.zeros_like(velocity))
    rows = rows_of(system, states, jnp.full_like(input, period))
    acceleration = bandwidth * (velocity - so_far(velocity))
    columns = (acceleration, *(so_far(column) for column in rows.columns[1:]))
    return Record(Rows(columns, so_far(rows.delta), rows.measure), so_far(input), None)
