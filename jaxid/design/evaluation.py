"""Evaluation of a motion before it is run: predicted errors, lower bounds and optimality gaps."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import require, require_concrete, require_float64
from jaxid.design.nominal_log import nominal_log
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.loop.servo import Servo
from jaxid.model.system import System
from jaxid.motion.limits import Limits
from jaxid.motion.trajectory import JerkTrajectory, extrema_of
from jaxid.regression.error_of_motion import planned_error
from jaxid.regression.lower_bound import LowerBound

_ROUNDED = 1e-6  # half-widths: far above the rounding errors of a motion that is read from a file


class ParameterEvaluation(NamedTuple):
    """The evaluation of a motion for one parameter, in plain numbers for tables and files.

    Attributes:
        least_squares: worst-case error of least squares of exact signals (16), in the unit of the
            parameter.
        predicted: predicted guaranteed half-width, in the unit of the parameter.
        lower_bound: proved lower bound on the half-width that any motion and any estimator can
            promise before the data are known, in the unit of the parameter.
        gap: relative optimality gap predicted / lower_bound − 1.
    """

    least_squares: float
    predicted: float
    lower_bound: float
    gap: float


class Evaluation(NamedTuple):
    """The evaluation of a motion before it is run: arrays of shape (m,), in the parameters' units.

    Attributes:
        least_squares: worst-case error J of least squares of exact signals (16).
        predicted: predicted guaranteed half-width, with servo, encoder and prior box: that from
            the log of an undisturbed axis at the centre of the prior box that follows the motion. A
            real log determines the actual one by `jaxid.identify`, which may be larger or smaller.
        lower_bound: proved lower bound on the half-width that any motion within the limits and any
            estimator can promise before the data are known; data may happen to prove more.
        estimated: names of parameters whose lower bound is an estimate.
    """

    least_squares: Float[Array, " m"]
    predicted: Float[Array, " m"]
    lower_bound: Float[Array, " m"]
    estimated: tuple[str, ...]

    @property
    def gap(self) -> Float[Array, " m"]:
        """The relative optimality gap predicted / lower_bound − 1 of each parameter, shape (m,)."""
        return self.predicted / self.lower_bound - 1

    @property
    def by_parameter(self) -> tuple[ParameterEvaluation, ...]:
        """The evaluation as one `ParameterEvaluation` per parameter, in the order of θ."""
        columns = (self.least_squares, self.predicted, self.lower_bound, self.gap)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return tuple(ParameterEvaluation(*row) for row in rows)


def evaluate(
    system: System, trajectory: JerkTrajectory, servo: Servo, least: LowerBound
) -> Evaluation:
    """Evaluate a motion before it is run: predicted errors, lower bounds and optimality gaps.

    Args:
        system: axis with its prior box and disturbance bound δ.
        trajectory: motion to evaluate.
        servo: servo that runs the motion and records its log.
        least: result of `lower_bound(system, limits)`: it has one number per parameter, and the
            limits, within which the motion must be.

    Raises:
        ValueError: if `least` does not have one number per parameter, the motion exceeds its
            limits, or it does not last a whole number of sample periods, two at least.

    Example:
        >>> worth = jd.evaluate(slide, motion, servo, least)
        >>> (100 * worth.gap).round().tolist()  # %, above the lower bound
        [35.0, 58.0, 10.0]
    """
    require(
        isinstance(least, LowerBound),
        "Argument `least` must be the result of jaxid.lower_bound(system, limits), but is a "
        f"{type(least).__name__}.",
    )
    require_float64(system=system, trajectory=trajectory, servo=servo, least=least)
    require_concrete(
        "the evaluation, which solves linear programs,",
        "Trace `jaxid.planned_error`, or the criterion of a `PredictedError`.",
        system=system,
        trajectory=trajectory,
        servo=servo,
        least=least,
    )
    names = system.names
    require(
        least.value.shape == (len(names),),
        f"Argument `least` must be the lower bound of each of the parameters {', '.join(names)}, "
        f"one number each, but has {least.value.size}.",
    )
    _require_within(trajectory, least.limits)
    found = guaranteed_intervals(system, [nominal_log(system, trajectory, servo)]).estimate
    error = planned_error(system, trajectory)
    return Evaluation(error, found.half_widths, least.value, least.estimated)


def _require_within(trajectory: JerkTrajectory, limits: Limits) -> None:
    """Refuse a motion to which a lower bound does not apply."""
    extrema = extrema_of(trajectory)
    for name in ("position", "velocity", "acceleration"):
        low, high = np.asarray(getattr(limits, name)).tolist()
        least, most = np.asarray(getattr(extrema, name)).tolist()
        room = _ROUNDED * (high - low) / 2
        require(
            low - room <= least and most <= high + room,
            f"Argument `trajectory` has values of the {name} from {least:g} to {most:g}, outside "
            f"the limits [{low:g}, {high:g}] that the lower bound `least` assumes: it does not "
            "apply to this motion.",
        )
