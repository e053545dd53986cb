"""Estimators as one family: each returns weights on the rows of an experiment, without its data.

The worst-case error of the weights is exact for every estimator (`affine_worst_case_error`), the
parameters follow from them by `estimate`, and functions that take an estimator accept any of them.
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
    """Base class of estimators: functions from regression rows to estimator weights."""

    @abc.abstractmethod
    def __call__(
        self, rows: Rows, half_widths: Float[Array, " m"], norm: Norm | None = None
    ) -> Float[Array, "k n"]:
        """Return estimator weights on the inputs of the rows, one row of weights per functional.

        Args:
            rows: regression rows of one motion or record.
            half_widths: half-widths of the prior box, shape (m,), in the units of the parameters.
            norm: functionals of θ to estimate; default the m parameters themselves.
        """


class LeastSquares(Estimator):
    """Weighted least squares with the matrix diag(measure/δ^power), unbiased: (11) at power 0.

    A power of 2 is the maximum-likelihood estimator for Gaussian disturbances with standard
    deviation δ. The prior box has no influence.

    Attributes:
        power: exponent of δ in the weights; 0, the default, is least squares (11).
    """

    power: int = eqx.field(static=True, default=0)

    def __call__(
        self, rows: Rows, half_widths: Float[Array, " m"], norm: Norm | None = None
    ) -> Float[Array, "k n"]:
        # δ may be zero in rows that do not count
        trust = rows.measure / jnp.where(rows.counted, rows.delta, 1.0) ** self.power
        return least_squares(eqx.tree_at(lambda r: r.measure, rows, trust), norm)


class Minimax(Estimator):
    """The estimator of the least worst-case error (`minimax`), biased where that reduces the error.

    At most m of its weights per functional are not zero. It is a reference for comparisons rather
    than an estimator for noisy logs.
    """

    def __call__(
        self, rows: Rows, half_widths: Float[Array, " m"], norm: Norm | None = None
    ) -> Float[Array, "k n"]:
        return minimax(rows, half_widths, norm).weights


class Filtered(Estimator):
    """Another estimator on the filtered rows (28), as weights H_fᵀ g on the unfiltered rows.

    Its estimate from a record equals that of the other estimator from the filtered record. Its
    exact worst-case error over the unfiltered Δ, Σ |H_fᵀ g|_k δ_k, is never above the Σ |g|_k (H_f
    δ)_k of (29), since no entry of H_f is negative: (29) also counts filtered disturbances that no
    Δ produces.

    Attributes:
        estimator: estimator of the filtered rows.
        bandwidth: bandwidth w of H_f, rad/s.
        period: sample period of the rows, s.
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
