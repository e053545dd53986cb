"""What a design is worth, parameter by parameter, and how much better any other could be."""

from typing import NamedTuple

from jaxtyping import Array, Float

from jaxid._checks import require, require_concrete, require_float64
from jaxid.design.nominal_log import nominal_log
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.loop.servo import Servo
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.error_of_motion import planned_error
from jaxid.regression.lower_bound import LowerBound


class ParameterWorth(NamedTuple):
    """What a motion is worth for one parameter: plain numbers, as tables and files have them.

    Attributes:
        J: error of least squares of exact signals, (16), in the unit of the parameter.
        guaranteed: error that the log can be expected to guarantee, in that unit.
        floor: what no motion and no estimator can promise to go below, in that unit.
        gap: guaranteed / floor − 1.
    """

    J: float
    guaranteed: float
    floor: float
    gap: float


class Evaluation(NamedTuple):
    """Of one motion, shape (m,) each, in the units of the parameters.

    Attributes:
        error: J of (16), by least squares of exact signals.
        guaranteed: what the log can be expected to prove, servo, encoder and prior box included:
            that of an undisturbed axis in the middle of its box that follows the motion. What the
            log of another one proves, `jaxid.identify` says; it may be a little more or less.
        floor: what no motion within the limits and no estimator can promise to go below.
        estimated: parameters whose floor is an estimate.
    """

    error: Float[Array, " m"]
    guaranteed: Float[Array, " m"]
    floor: Float[Array, " m"]
    estimated: tuple[str, ...]

    @property
    def gap(self) -> Float[Array, " m"]:
        """By how much of the floor the guaranteed error is above it."""
        return self.guaranteed / self.floor - 1

    @property
    def by_parameter(self) -> tuple[ParameterWorth, ...]:
        """The same, one parameter after the other."""
        columns = (self.error, self.guaranteed, self.floor, self.gap)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return tuple(ParameterWorth(*row) for row in rows)


def evaluate(
    system: System, trajectory: JerkTrajectory, servo: Servo, least: LowerBound
) -> Evaluation:
    """Appraise a motion before it is run.

    Args:
        system: with the prior box.
        trajectory: the motion.
        servo: what runs it and keeps its log.
        least: `floor` of the system under its limits, of every parameter.

    Example:
        >>> worth = jd.evaluate(slide, motion, servo, least)
        >>> (100 * worth.gap).round().tolist()  # %, above the lower bound
        [35.0, 58.0, 10.0]
    """
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
        f"Argument `least` must be the floor of the parameters {', '.join(names)} themselves, one "
        f"number each, but has {least.value.size}.",
    )
    found = guaranteed_intervals(system, [nominal_log(system, trajectory, servo)]).estimate
    error = planned_error(system, trajectory)
    return Evaluation(error, found.half_length, least.value, least.estimated)
