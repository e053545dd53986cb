"""A motion for an axis from a file: design, evaluation, and the approach to its start."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid._progress import Report, silent, within
from jaxid.axis.defaults import ALL
from jaxid.axis.file import Axis
from jaxid.design.evaluation import Evaluation, evaluate
from jaxid.design.nominal_log import nominal_log
from jaxid.design.optimal_motion import optimal_motion
from jaxid.design.predicted_error import PredictedError
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.motion.feasibility import interior
from jaxid.motion.point_to_point import approach, joined, wait
from jaxid.motion.trajectory import JerkTrajectory, trimmed
from jaxid.regression.lower_bound import LowerBound, lower_bound
from jaxid.search.effort import Effort

WANTED = "wanted"  # parameters of [wanted], each error relative to its accuracy
FACTORS = (0.5, 2.0)  # factors of δ, for which predicted errors are reported too


class AxisDesign(NamedTuple):
    """A designed motion of an axis with its evaluation.

    Attributes:
        axis: axis that the motion is for.
        target: name of the parameter that the motion is for, "all" or "wanted".
        search: seed and effort of the search, in words.
        motion: motion within all limits, without its approach.
        worth: evaluation of the motion for each parameter.
        sensitivity: predicted guaranteed errors with 0.5·δ and 2·δ, shape (2, m).
    """

    axis: Axis
    target: str
    search: str
    motion: JerkTrajectory
    worth: Evaluation
    sensitivity: Float[np.ndarray, "factors m"]


def design_axis(
    axis: Axis,
    target: str = ALL,
    seed: int = 0,
    effort: Effort = Effort(),
    report: Report = silent,
) -> AxisDesign:
    """Return the motion of least predicted guaranteed error, with its evaluation.

    Args:
        axis: axis from a file.
        target: name of a parameter, "all" or "wanted". Of several parameters the largest error is
            minimised, relative to its lower bound or to the required accuracy.
        seed: seed of the random search.
        effort: numbers of starts, steps and rounds of the search.
        report: function that is called as each step begins, with its name and the share of the
            work that is done.

    Raises:
        InterruptedDesign: if the user interrupts (Ctrl-C) after a first motion was found. Its
            `found` is the best one.
        InfeasibleError: if no motion keeps the limits.
        ValueError: if there is no such target, or the axis cannot approach the start of a motion.
    """
    system, task, servo = axis.system, axis.task, axis.servo
    require_possible(axis, target)
    report("lower bound of every parameter", 0.0)
    least = lower_bound(system, task.limits)
    targets, key = _targets(axis, target, least), jax.random.key(seed)
    criterion = PredictedError(system, targets, servo, velocity_error=axis.velocity_error)
    search, own = in_words(seed, effort), within(report, 0.05, 0.9)
    reached: list[JerkTrajectory] = []
    try:
        found = optimal_motion(task, criterion, key, effort=effort, report=own, show=reached.append)
    except KeyboardInterrupt:
        if not reached:
            raise
        report("evaluation of the best motion so far", 0.9)
        best = min(reached, key=lambda x: float(criterion.near(task, x)(x, jnp.zeros(()))))
        search = f"{search}, interrupted"
        raise InterruptedDesign(evaluated(axis, target, search, trimmed(best), least)) from None
    report("evaluation", 0.9)
    return evaluated(axis, target, search, found.trajectory, least)


class InterruptedDesign(KeyboardInterrupt):
    """The interruption of `design_axis` by the user.

    Attributes:
        found: best motion so far, which keeps all limits.
    """

    def __init__(self, found: AxisDesign) -> None:
        """Keep the best motion so far."""
        super().__init__("Interrupted: the search for a better motion was not finished.")
        self.found = found


def require_possible(axis: Axis, target: str) -> None:
    """Raise an error before a search if no motion can be designed.

    Args:
        axis: axis from a file.
        target: name of a parameter, "all" or "wanted".

    Raises:
        InfeasibleError: if no motion keeps the limits.
        ValueError: if there is no such target, or the approach does not last a whole number of
            sample periods.
    """
    task, period = axis.task, axis.servo.period
    if target == WANTED:
        require(
            bool(jnp.any(jnp.isfinite(axis.wanted))),
            "--target wanted needs a table [wanted] in the axis file, with a required half-width "
            f"such as {axis.system.names[0]} = 0.01.",
        )
    elif target != ALL:
        names = axis.system.names
        require(
            target in names,
            f"--target must be all, wanted or one of {', '.join(names)}, but is {target!r}.",
        )
    before = float(lead_in(axis, task.boundary.start).duration) / period
    require(
        abs(before - round(before)) < 1e-6,
        f"`motion.knot_period` = {task.period:g} s must be a multiple of `servo.period` = "
        f"{period:g} s for the approach.",
    )
    interior(task.limits, task.boundary, task.intervals, task.period)


def in_words(seed: int, effort: Effort) -> str:
    """Return seed and effort of a search in words, to distinguish it from others."""
    return f"seed {seed}, {effort}"


def evaluated(
    axis: Axis, target: str, search: str, motion: JerkTrajectory, least: LowerBound
) -> AxisDesign:
    """Return a motion with its evaluation, for δ and for multiples of δ.

    Args:
        axis: axis from a file.
        target: target that the motion was designed for.
        search: seed and effort of the search, in words.
        motion: motion to evaluate.
        least: lower bounds of the errors of all parameters.
    """
    worth = evaluate(axis.system, motion, axis.servo, least)
    systems = [axis.system.with_scaled_disturbance(factor) for factor in FACTORS]
    log = nominal_log(axis.system, motion, axis.servo)  # without a disturbance, whatever δ is
    found = [guaranteed_intervals(x, [log]).estimate for x in systems]
    sensitivity = np.stack([np.asarray(estimate.half_widths) for estimate in found])
    return AxisDesign(axis, target, search, motion, worth, sensitivity)


def lead_in(axis: Axis, start: Float[Array, "3"]) -> JerkTrajectory:
    """Return the approach from home to the start of a motion, and the rest there.

    It has no intervals if the motion starts at home without waiting.

    Args:
        axis: axis from a file.
        start: start state [y, ẏ, ÿ] of the motion, SI units.

    Raises:
        ValueError: if home or the start is outside the position limits.
    """
    position, period = float(start[0]), axis.task.period
    move = approach(axis.task.limits, axis.home, position, period)
    return joined(move, wait(position, axis.waiting, period))


def played(axis: Axis, motion: JerkTrajectory) -> JerkTrajectory:
    """Return the whole motion of the servo: approach from home, rest, and the designed motion.

    Args:
        axis: axis from a file.
        motion: designed motion.

    Raises:
        ValueError: if home or the start is outside the position limits, or the motion does not
            start at rest.
    """
    return joined(lead_in(axis, motion.start), motion)


def _targets(axis: Axis, target: str, least: LowerBound) -> Float[Array, " m"]:
    """Return the number that each error is divided by; inf leaves a parameter out."""
    if target == ALL:
        return least.value
    if target == WANTED:
        return axis.wanted
    k = axis.system.index(target)
    return jnp.full_like(least.value, jnp.inf).at[k].set(least.value[k])
