"""An estimate from a Record, its worst-case error and its intervals; least squares (11), (29).

The prior box is part of every bound. θ lies in it and within `bound` of θ̂, so it lies in the
intersection of both intervals, whose half-length is at most min(bound, half-width of the box). The
middle of that intersection is therefore an estimate whose guarantee is never worse than that of θ̂
or the prior box. Before the data are known, the guarantee cannot be better than this minimum: with
θ at the centre and Δ = 0, that is where θ̂ is. Clipping θ̂ into the box is not enough: if the bound
is twice the half-width or more, a θ at one end can be estimated as the other.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid.loop.record import Record
from jaxid.model.system import System
from jaxid.regression.worst_case import bias as bias_of
from jaxid.regression.worst_case import least_squares, worst_case_error


class Estimate(eqx.Module):
    """An estimate θ̂ with its worst-case error, and the prior box; all of shape (m,).

    Attributes:
        theta: estimate θ̂, in the units of the parameters.
        bound: worst-case error |θ̂ − θ|, in the units of the parameters.
        prior_lower: lower ends of the prior intervals.
        prior_upper: upper ends of the prior intervals.
    """

    theta: Float[Array, " m"]
    bound: Float[Array, " m"]
    prior_lower: Float[Array, " m"]
    prior_upper: Float[Array, " m"]

    @property
    def lower(self) -> Float[Array, " m"]:
        """The lower ends of the intersection of θ̂ ± bound with the prior box Ω_θ."""
        return jnp.maximum(self.theta - self.bound, self.prior_lower)

    @property
    def upper(self) -> Float[Array, " m"]:
        """The upper ends of the intersection of θ̂ ± bound with the prior box Ω_θ.

        An upper end below its lower end means that the data contradict the disturbance bound δ.
        """
        return jnp.minimum(self.theta + self.bound, self.prior_upper)

    @property
    def half_widths(self) -> Float[Array, " m"]:
        """Half the width of each interval: the worst-case error of its middle for these data."""
        return (self.upper - self.lower) / 2


def estimate(
    record: Record,
    system: System,
    weights: Float[Array, "m n"],
    bias: Float[Array, "m m"] | None = None,
) -> Estimate:
    """Return the estimate centre + G(u − Φ·centre) with its exact worst-case error.

    The bound holds if u_k = φ_kᵀθ + Δ_k with |Δ_k| ≤ δ_k in every row and θ is in the prior box.

    Args:
        record: regression rows with their inputs, filtered or not.
        system: system with its prior box.
        weights: estimator weights G, shape (m, n).
        bias: I − GΦ, shape (m, m); default computed from the weights.
    """
    remainder = bias_of(weights, record.rows) if bias is None else bias
    return Estimate(
        weights @ record.input + remainder @ system.centre,
        worst_case_error(weights, record.rows.delta)
        + worst_case_error(remainder, system.half_widths),
        system.lower,
        system.upper,
    )


@eqx.filter_jit
def least_squares_estimate(record: Record, system: System) -> Estimate:
    """Return the least-squares estimate (11) of a record, filtered or not, with its bound (29).

    The bound holds if u_k = φ_kᵀθ + Δ_k with |Δ_k| ≤ δ_k in every row. The rows of a simulation
    satisfy this. Those of a sampled, quantised log do so only approximately, so that the bound is
    no guarantee.

    Args:
        record: regression rows with their inputs.
        system: system with its prior box.
    """
    weights = least_squares(record.rows)
    m = weights.shape[0]
    # (29) assumes G Φ = I
    return estimate(record, system, weights, bias=jnp.zeros((m, m), weights.dtype))
