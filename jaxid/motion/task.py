"""The task of a motion: its limits, conditions and length."""

from typing import NamedTuple

from jaxid.motion.limits import Boundary, Limits
from jaxid.motion.violation import Prediction


class Task(NamedTuple):
    """The conditions on a motion (16): its limits, start, end, via points and length.

    Attributes:
        limits: limits of the motion, kept exactly, between the knots too.
        boundary: start, end and via points of the motion, kept exactly.
        intervals: number of intervals of constant jerk (2·N_i in the paper).
        period: duration of each interval, s.
        axis: prediction of the closed loop along a motion, if its states must keep the limits too;
            a search calls it very often, so it must not be a simulation (see
            `jaxid.search.frozen_loop.freeze`); default None: only the planned motion keeps them.
        size: number of intervals to pad motions to, so that several lengths share one compilation;
            default no padding.

    Example:
        >>> task = jd.Task(limits, ends, intervals=60, period=0.01)
    """

    limits: Limits
    boundary: Boundary
    intervals: int
    period: float
    axis: Prediction | None = None
    size: int | None = None
