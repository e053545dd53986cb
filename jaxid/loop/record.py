"""The Record: what an experiment leaves, as weighted integrals of (1); everything after is linear.

Integrate u = φᵀθ + Δ against a test function and divide by its integral. One row k is then

    u_k = φ_kᵀ θ + Δ_k,     |Δ_k| ≤ δ_k,

with means instead of point values, and exact. A box over one controller tick is one choice of
test function, a hat over two ticks or a filter's impulse response another: the type assumes none.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxid._checks import require_shape
from jaxid._types import as_array, or_none
from jaxid.model.system import System
from jaxid.motion.trajectory import States


def _as_columns(columns: Sequence[Any]) -> tuple[Array, ...]:
    return tuple(map(as_array("columns"), columns))


class Rows(eqx.Module):
    """What a motion offers to an estimator: the left-hand sides of n rows.

    Attributes:
        columns: the m columns of Φ, each of shape (n,); apart, since a gradient through slices of
            one (n, m) array takes twice as long.
        delta: δ_k, shape (n,), in the unit of the input.
        measure: what row k counts in an integral over time, s. A row without measure says nothing.
    """

    columns: tuple[Float[Array, " n"], ...] = eqx.field(converter=_as_columns)
    delta: Float[Array, " n"] = eqx.field(converter=as_array("delta"))
    measure: Float[Array, " n"] = eqx.field(converter=as_array("measure"))

    def __check_init__(self) -> None:
        for name in ("delta", "measure", "columns"):
            values = getattr(self, name)
            for x in values if name == "columns" else (values,):
                require_shape(name, "rows", x, (self.delta.size,), "one per row")

    @property
    def counted(self) -> Bool[Array, " n"]:
        """Which rows say something: the others may be anything finite."""
        return self.measure > 0

    @property
    def regressors(self) -> Float[Array, "n m"]:
        """Φ, one row φ_kᵀ per row."""
        return jnp.stack(self.columns, axis=-1)


class Record(eqx.Module):
    """Rows and their inputs: one experiment.

    Attributes:
        rows: the regressors, disturbance bounds and measures.
        input: u_k, shape (n,): the commanded input, never one computed from θ.
        disturbance: Δ_k, shape (n,), where a simulation knows it: for tests, not for estimators.
    """

    rows: Rows
    input: Float[Array, " n"] = eqx.field(converter=as_array("input"))
    disturbance: Float[Array, " n"] | None = eqx.field(
        converter=or_none(as_array("disturbance")), default=None
    )

    def __check_init__(self) -> None:
        require_shape("input", "a record", self.input, self.rows.delta.shape, "one per row")

    def only(self, counted: Bool[Array, " n"]) -> "Record":
        """The record whose other rows are zero and have no measure: padding."""
        # nothing of them: what a loop that diverges leaves there would spoil 0·x of the measure
        return jax.tree.map(lambda column: jnp.where(counted, column, 0.0), self)


def rows_of(system: System, states: States, measure: Float[Array, " n"]) -> Rows:
    """The rows of a motion sampled at the nodes of a quadrature."""
    delta = system.disturbance_bound(states.position, states.velocity)
    return Rows(system.regressors(*states), delta, measure)
