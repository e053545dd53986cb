"""The Record of an experiment: weighted integrals of (1), linear in θ.

Integrate u = φᵀθ + Δ against a test function and divide by its integral. One row k is then

    u_k = φ_kᵀ θ + Δ_k,     |Δ_k| ≤ δ_k,

with means instead of point values, and exact. A box over one sample period is one choice of test
function, a hat over two of them or a filter's impulse response another: the type assumes none.
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
    """The n regression rows of a motion, without the inputs.

    Attributes:
        columns: m columns of Φ, each of shape (n,). They are separate because a gradient through
            slices of one (n, m) array takes twice as long.
        delta: disturbance bound δ_k of each row, shape (n,), in the unit of the input.
        measure: weight of each row in an integral over time, s; zero for rows that are padding.
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
        """A mask of the rows with a measure above zero; the others are padding, shape (n,)."""
        return self.measure > 0

    @property
    def regressors(self) -> Float[Array, "n m"]:
        """The regressor matrix Φ, whose row k is φ_kᵀ, shape (n, m)."""
        return jnp.stack(self.columns, axis=-1)


class Record(eqx.Module):
    """The regression rows of one experiment with their inputs: u_k = φ_kᵀθ + Δ_k.

    Attributes:
        rows: regressors, disturbance bounds and measures of the n rows.
        input: commanded input u_k of each row, shape (n,), never computed from θ.
        disturbance: true Δ_k of each row, shape (n,), where a simulation knows it, otherwise None;
            it serves tests, not estimators.
    """

    rows: Rows
    input: Float[Array, " n"] = eqx.field(converter=as_array("input"))
    disturbance: Float[Array, " n"] | None = eqx.field(
        converter=or_none(as_array("disturbance")), default=None
    )

    def __check_init__(self) -> None:
        require_shape("input", "a record", self.input, self.rows.delta.shape, "one per row")

    def only(self, counted: Bool[Array, " n"]) -> "Record":
        """Return the record with zeros, and zero measure, in all rows outside the mask."""
        # zero in all columns: if a loop diverges after its motion, 0·inf would be NaN
        return jax.tree.map(lambda column: jnp.where(counted, column, 0.0), self)


def rows_of(system: System, states: States, measure: Float[Array, " n"]) -> Rows:
    """Return the regression rows of a motion that is sampled at the nodes of a quadrature.

    Args:
        system: axis that gives φ and δ.
        states: states at the n nodes.
        measure: weights of the nodes, s.
    """
    delta = system.disturbance_bound(states.position, states.velocity)
    return Rows(system.regressors(*states), delta, measure)
