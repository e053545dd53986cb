"""From a Record to numbers: an estimate, its bound and the intervals; least squares (11) and (29).

The box is part of every bound. θ lies in it and within `bound` of θ̂, so it lies in the interval
that both have in common, whose half-length is at most min(bound, half-width of the box). The middle
of that interval is therefore an estimate with a guarantee never worse than that of θ̂ or the prior.
Before the data it is no less than this minimum: with θ at the centre and Δ = 0, that is where θ̂ is.
Clipping θ̂ into the box is not enough: from a bound of twice the half-width on, a θ at one end can
be estimated as the other.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid.loop.record import Record
from jaxid.model.system import System
from jaxid.regression.worst_case import bias as bias_of
from jaxid.regression.worst_case import least_squares, worst_case_error


class Estimate(eqx.Module):
    """θ̂, how far it can be from θ, and what that leaves of the prior box; all of shape (m,)."""

    theta: Float[Array, " m"]
    bound: Float[Array, " m"]
    prior_lower: Float[Array, " m"]
    prior_upper: Float[Array, " m"]

    @property
    def lower(self) -> Float[Array, " m"]:
        """Lower ends of θ̂ ± bound inside Ω_θ."""
        return jnp.maximum(self.theta - self.bound, self.prior_lower)

    @property
    def upper(self) -> Float[Array, " m"]:
        """Upper ends of θ̂ ± bound inside Ω_θ; below the lower ones if the data contradict δ."""
        return jnp.minimum(self.theta + self.bound, self.prior_upper)

    @property
    def middle(self) -> Float[Array, " m"]:
        """Of the intervals: at most `half_length` from θ."""
        return (self.lower + self.upper) / 2

    @property
    def half_length(self) -> Float[Array, " m"]:
        """Of the intervals: what these data guarantee, at most `guaranteed`."""
        return (self.upper - self.lower) / 2

    @property
    def guaranteed(self) -> Float[Array, " m"]:
        """The largest `half_length` that any data could have left: bound or box."""
        return jnp.minimum(self.bound, (self.prior_upper - self.prior_lower) / 2)


def estimate(
    record: Record,
    system: System,
    weights: Float[Array, "m n"],
    bias: Float[Array, "m m"] | None = None,
) -> Estimate:
    """The estimate centre + G(u − Φ·centre) with its exact worst-case error.

    The bound holds if u_k = φ_kᵀθ + Δ_k with |Δ_k| ≤ δ_k in every row and θ is in the box.

    Args:
        record: whose inputs the weights are for, filtered or not.
        system: for its prior box.
        weights: G, of any estimator.
        bias: I − GΦ; found from the weights unless known otherwise.
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
    """(11) and (29) from the columns of a record, filtered or not.

    The bound holds if u_k = φ_kᵀθ + Δ_k with |Δ_k| ≤ δ_k in every row. The rows of a simulation do;
    those of a sampled, quantised log do so only approximately, and there the bound is none.
    """
    weights = least_squares(record.rows)
    m = weights.shape[0]
    # (29) takes G Φ = I for granted
    return estimate(record, system, weights, bias=jnp.zeros((m, m), weights.dtype))
