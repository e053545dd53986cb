"""From a Record to numbers: the least-squares estimate (11), its bound (29) and the intervals."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxid.bound import least_squares, worst_case_error
from jaxid.record import Record
from jaxid.system import System


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
        """Upper ends of θ̂ ± bound inside Ω_θ."""
        return jnp.minimum(self.theta + self.bound, self.prior_upper)

    @property
    def reduced(self) -> Bool[Array, " m"]:
        """Whether the bound is below half the width of the prior box."""
        return self.bound < (self.prior_upper - self.prior_lower) / 2


@eqx.filter_jit
def least_squares_estimate(record: Record, system: System) -> Estimate:
    """(11) and (29) from the columns of a record, filtered or not.

    The bound holds if u_k = φ_kᵀθ + Δ_k with |Δ_k| ≤ δ_k in every row. The rows of a simulation do;
    those of a sampled, quantised log do so only approximately, and there the bound is none.
    """
    weights = least_squares(record.rows)
    return Estimate(
        weights @ record.input,
        worst_case_error(weights, record.rows.delta),
        system.lower,
        system.upper,
    )
