"""Estimators as one family: each makes weights on the rows of an experiment, without its data.

What weights guarantee is then exact for every one of them (`affine_worst_case_error`), what they
say about θ is `estimate`, and any of them can be passed to whatever takes an estimator.
"""

import abc
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._types import Scalar, as_array
from jaxid.loop.record import Rows
from jaxid.regression.filters import adjoint, filtered_rows
from jaxid.regression.minimax import minimax
from jaxid.regression.worst_case import Norm, least_squares


class Estimator(eqx.Module):
    """A way from rows to weights."""

    @abc.abstractmethod
    def __call__(
        self, rows: Rows, half_widths: Float[Array, " m"], norm: Norm | None = None
    ) -> Float[Array, "k n"]:
        """Weights on the inputs of the rows, one row of them per functional.

        Args:
            rows: of one motion or record.
            half_widths: of the prior box, in the units of the parameters.
            norm: the functionals of θ; without one, the m parameters themselves.
        """


class LeastSquares(Estimator):
    """Least squares with the matrix diag(measure/δ^power), unbiased: (11) at power 0.

    A power of 2 is the maximum likelihood of Gaussian disturbances with deviations δ. The box does
    not matter.
    """

    power: int = eqx.field(static=True, default=0)

    def __call__(
        self, rows: Rows, half_widths: Float[Array, " m"], norm: Norm | None = None
    ) -> Float[Array, "k n"]:
        # δ may be zero elsewhere
        trust = rows.measure / jnp.where(rows.counted, rows.delta, 1.0) ** self.power
        return least_squares(eqx.tree_at(lambda r: r.measure, rows, trust), norm)


class Minimax(Estimator):
    """The weights of the least worst-case error (`minimax`), biased where the box is worth it.

    At most m of them are not zero: a limit to compare with, not the way to treat a noisy log.
    """

    def __call__(
        self, rows: Rows, half_widths: Float[Array, " m"], norm: Norm | None = None
    ) -> Float[Array, "k n"]:
        return minimax(rows, half_widths, norm).weights


class Filtered(Estimator):
    """Another estimator on the filtered rows (28), as weights H_fᵀ g on the rows themselves.

    Its estimate from the record is that of the other one from the filtered record. Its exact error
    over the unfiltered Δ, Σ |H_fᵀ g|_k δ_k, is never above the Σ |g|_k (H_f δ)_k of (29), since no
    entry of H_f is negative: (29) also counts filtered disturbances that no Δ leads to.

    Attributes:
        estimator: of the filtered rows.
        bandwidth: w of H_f in rad/s.
        period: of the rows' ticks, s.
    """

    estimator: Estimator
    bandwidth: Scalar = eqx.field(converter=as_array("bandwidth"))
    period: Scalar = eqx.field(converter=as_array("period"))

    def __call__(
        self, rows: Rows, half_widths: Float[Array, " m"], norm: Norm | None = None
    ) -> Float[Array, "k n"]:
        passed = filtered_rows(rows, self.bandwidth, self.period)
        weights = self.estimator(passed, half_widths, norm)
        return jax.vmap(adjoint, (0, None, None))(weights, self.bandwidth, self.period)


ESTIMATORS: Mapping[str, Estimator] = {
    "least_squares": LeastSquares(),
    "weighted_1": LeastSquares(power=1),
    "weighted_2": LeastSquares(power=2),
    "minimax": Minimax(),
}
