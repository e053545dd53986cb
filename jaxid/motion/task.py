"""What a motion must do, whatever it is designed for."""

from typing import NamedTuple

from jaxid.motion.limits import Boundary, Limits
from jaxid.motion.violation import Prediction


class Task(NamedTuple):
    """What a motion must do, whatever it is designed for (16).

    Attributes:
        limits: kept exactly, between the knots too.
        boundary: kept exactly.
        intervals: of constant jerk (2·N_i in the paper).
        period: of each interval, s.
        axis: what the axis does along a motion, if the limits are to hold for it too; a search
            calls it very often, so not a simulation (see `jaxid.search.frozen_loop.freeze`).
        size: pad to this many intervals, so that several lengths share one compilation.

    Example:
        >>> task = jd.Task(limits, ends, intervals=60, period=0.01)
    """

    limits: Limits
    boundary: Boundary
    intervals: int
    period: float
    axis: Prediction | None = None
    size: int | None = None
