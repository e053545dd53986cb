"""The paper's identification (28)-(29): least squares of a filtered record."""

from jaxid._checks import is_concrete, require_float64, require_positive
from jaxid._types import Scalar
from jaxid.loop.record import Record
from jaxid.model.system import System
from jaxid.regression.estimate import Estimate, least_squares_estimate
from jaxid.regression.filters import filtered
from jaxid.regression.worst_case import require_informative


def filtered_least_squares(
    record: Record, system: System, bandwidth: Scalar | float, period: Scalar | float
) -> Estimate:
    """Return the least-squares estimate of a filtered record, with its error bound J_f (28)-(29).

    This is the identification of Lu and Yao (2010).

    For recorded logs the bound is no guarantee. It holds if every row of the record obeys u = φᵀθ +
    Δ with |Δ| ≤ δ exactly, as the rows of a simulation do. Rows made of sampled, quantised
    positions do not: there the true parameters may lie outside θ̂ ± J_f, and `jaxid.identify`
    computes intervals that contain them.

    Args:
        record: exact regression rows with their inputs, SI units and the unit of the input.
        system: system with its prior box; its δ is not used, but that of the rows of the record.
        bandwidth: bandwidth w of the filter H_f(s) = w/(s + w), rad/s.
        period: sample period of the record, s.

    Returns:
        The estimate θ̂ with its bound J_f, and the intersection of θ̂ ± J_f with the prior box.

    Raises:
        ValueError: if `bandwidth` or `period` is not above zero, the record is not float64,
            or its motion cannot identify all parameters.

    Example:
        >>> estimate = jd.filtered_least_squares(record, slide, bandwidth=1000.0, period=0.001)
        >>> estimate.theta.round(3).tolist(), estimate.bound.round(2).tolist()
        ([7.0, 20.0, 15.0], [1.24, 36.45, 10.08])
    """
    require_float64(record=record, system=system)
    require_positive("bandwidth", "a filter", bandwidth)
    require_positive("period", "a filter", period)
    passed = filtered(record, bandwidth, period)
    if is_concrete(passed.rows):
        require_informative(passed.rows, system.names, system.half_widths)
    return least_squares_estimate(passed, system)
