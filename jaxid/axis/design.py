"""A motion for an axis of a file: designed, appraised, and what the servo plays of it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.axis.file import Axis
from jaxid.design.evaluation import Evaluation, evaluate
from jaxid.design.nominal_log import nominal_log
from jaxid.design.optimal_motion import optimal_motion
from jaxid.design.predicted_error import PredictedError
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.motion.feasibility import interior
from jaxid.motion.point_to_point import approach, joined, wait
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.lower_bound import LowerBound, lower_bound
from jaxid.search.effort import Effort
from jaxid.search.problem import Report

ALL = "all"  # parameters at once, each error over its floor
WANTED = "wanted"  # those of the file, each error over what is wanted
FACTORS = (0.5, 2.0)  # of δ, for which it is shown too what could be guaranteed


class AxisDesign(NamedTuple):
    """A motion and what it is worth.

    Attributes:
        axis: that it is for.
        target: the parameter that it is for, `ALL` or `WANTED`.
        search: its seed and effort, in words.
        motion: within all limits.
        worth: of each parameter.
        sensitivity: what would be guaranteed with `FACTORS` of δ, shape (factors, m).
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
    tell: Report = lambda message: None,
) -> AxisDesign:
    """The motion whose log can be expected to prove most.

    Args:
        axis: from a file.
        target: the name of a parameter, `ALL` or `WANTED`; of several the largest error counts,
            over its floor or over what is wanted.
        seed: of the search.
        effort: how long to search.
        tell: told what goes on.

    Raises:
        InfeasibleError: if no motion keeps the limits.
        ValueError: if the target is none, or the axis cannot come to the start of a motion.
    """
    system, task, servo = axis.system, axis.task, axis.servo
    require_possible(axis, target)
    tell("floor of every parameter")
    least = lower_bound(system, task.limits)
    targets, key = _targets(axis, target, least), jax.random.key(seed)
    criterion = PredictedError(system, targets, servo, velocity_error=axis.velocity_error)
    motion = optimal_motion(task, criterion, key, effort=effort, report=tell).trajectory
    tell("what it is worth")
    return appraised(axis, target, in_words(seed, effort), motion, least)


def require_possible(axis: Axis, target: str) -> None:
    """Refuse before a search what it would end in.

    Raises:
        InfeasibleError: if no motion keeps the limits.
        ValueError: if the target is none, or an approach does not end with a tick of the servo.
    """
    task, period = axis.task, axis.servo.period
    if target == WANTED:
        require(
            bool(jnp.any(jnp.isfinite(axis.wanted))),
            f"Argument `target` must not be {WANTED} unless the axis says what is wanted.",
        )
    elif target != ALL:
        axis.system.index(target)
    before = float(lead_in(axis, task.boundary.start).duration) / period
    require(
        abs(before - round(before)) < 1e-6,
        f"`knot_period` must be a multiple of the servo's period {period:g} s for an approach, but "
        f"is {task.period:g} s.",
    )
    interior(task.limits, task.boundary, task.intervals, task.period)


def in_words(seed: int, effort: Effort) -> str:
    """Of a search, to tell it from others."""
    return f"seed {seed}, {effort}"


def appraised(
    axis: Axis, target: str, search: str, motion: JerkTrajectory, least: LowerBound
) -> AxisDesign:
    """A motion with what it is worth, and would be with another δ."""
    worth = evaluate(axis.system, motion, axis.servo, least)
    systems = [axis.system.with_scaled_disturbance(factor) for factor in FACTORS]
    found = [
        guaranteed_intervals(x, [nominal_log(x, motion, axis.servo)]).estimate for x in systems
    ]
    sensitivity = np.stack([np.asarray(estimate.half_length) for estimate in found])
    return AxisDesign(axis, target, search, motion, worth, sensitivity)


def lead_in(axis: Axis, start: Float[Array, "3"]) -> JerkTrajectory:
    """From home to the start of a motion, and the rest there; of no interval if it is at home."""
    position, period = float(start[0]), axis.task.period
    move = approach(axis.task.limits, axis.home, position, period)
    return joined(move, wait(position, axis.waiting, period))


def played(axis: Axis, motion: JerkTrajectory) -> JerkTrajectory:
    """All that the servo plays: from home to the start of the motion, rest, and the motion."""
    return joined(lead_in(axis, motion.start), motion)


def _targets(axis: Axis, target: str, least: LowerBound) -> Float[Array, " m"]:
    """What each error is compared with; inf leaves a parameter out."""
    if target == ALL:
        return least.value
    if target == WANTED:
        return axis.wanted
    k = axis.system.index(target)
    return jnp.full_like(least.value, jnp.inf).at[k].set(least.value[k])
