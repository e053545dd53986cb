"""The paper's identification (28)-(29): filter the record and estimate by least squares."""

from jaxid._checks import require_float64
from jaxid.loop.record import Record
from jaxid.model.system import System
from jaxid.regression.estimate import Estimate, least_squares_estimate
from jaxid.regression.filters import filtered
from jaxid.regression.worst_case import require_informative


def identify(record: Record, system: System, bandwidth: float, period: float) -> Estimate:
    """(28)-(29): filter the record with H_f and estimate by least squares.

    Args:
        record: with exact rows for the bound to hold.
        system: for its prior box.
        bandwidth: w of H_f in rad/s.
        period: of the record's ticks, s.
    """
    require_float64("record", record)
    passed = filtered(record, bandwidth, period)
    require_informative(passed.rows, system.names, system.half_widths)
    return least_squares_estimate(passed, system)
