"""Several logs of one axis, joined to one set of regression rows.

Between two logs there are padding rows, as many as the longest stencil reaches, so that encoder
errors of one log do not meet those of the other.
"""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.identification.regression_rows import Channel, RegressionRows, hats
from jaxid.identification.state_bounds import state_bounds
from jaxid.loop.log import Log
from jaxid.loop.record import Record, Rows
from jaxid.model.system import System

_BETWEEN = 2  # padding rows: a second difference reaches two rows beyond the weights


def rows_of_logs(system: System, logs: Sequence[Log]) -> RegressionRows:
    """Return several logs of one axis as one set of regression rows, by hat functions.

    Args:
        system: axis with its prior box and disturbance bound δ.
        logs: logs whose sample periods and encoders may differ.

    Raises:
        InconsistentLogError: if no plant of the system can have produced one of the logs.
        ValueError: if `logs` is empty, or a sample period is too long.
    """
    # a multiple of δ has another structure than δ: as a multiple, both share one compilation
    known = system.with_scaled_disturbance(1.0)
    return join_rows([hats(known, log, state_bounds(known, log)) for log in logs])


def join_rows(parts: Sequence[RegressionRows]) -> RegressionRows:
    """Return several sets of regression rows as one, with padding between them.

    Args:
        parts: sets of rows, made in the same way with the same system.

    Raises:
        ValueError: if there are none, or they were made differently.
    """
    require(len(parts) > 0, "Argument `parts` must have one log at least, but is empty.")
    first, records = parts[0], [part.record for part in parts]
    for part in parts[1:]:
        require(
            bool(eqx.tree_equal(part.system, first.system))
            and part.channels.keys() == first.channels.keys(),
            "Argument `parts` must be rows of one kind, made with the same system and box, but "
            "they differ.",
        )
    if len(parts) == 1:
        return first

    def all_of(get: Callable[[Record], Float[Array, "_"]], between: float) -> Float[Array, "_"]:
        return _spaced([get(record) for record in records], _BETWEEN, between)

    columns = tuple(
        all_of(lambda r, j=j: r.rows.columns[j], 0.0) for j in range(len(first.system.names))
    )
    # their δ must not be zero: the linear programs divide by it
    rows = Rows(columns, all_of(lambda r: r.rows.delta, 1.0), all_of(lambda r: r.rows.measure, 0.0))
    channels = {name: _channel([part.channels[name] for part in parts]) for name in first.channels}
    delta = _spaced([part.delta for part in parts], _BETWEEN, 0.0)
    record = Record(rows, all_of(lambda r: r.input, 0.0), None)
    return RegressionRows(first.system, record, delta, channels)


def _spaced(parts: Sequence[Float[Array, "_"]], count: int, value: float) -> Float[Array, "_"]:
    """Return arrays one after the other, with `count` entries of `value` between any two."""
    between = jnp.full(count, value)
    spaced = [x for part in parts for x in (between, part)]
    return jnp.concatenate(spaced[1:])


def _channel(parts: Sequence[Channel]) -> Channel:
    reach = parts[0].stencil.size - 1  # entries of the convolution minus rows
    return Channel(parts[0].stencil, _spaced([part.bound for part in parts], _BETWEEN - reach, 0.0))
