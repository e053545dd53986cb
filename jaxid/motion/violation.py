"""Violation of the limits by a motion, or by the axis that follows it."""

import abc
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._types import Interval, Motion, Scalar
from jaxid.model.interval_arithmetic import Range
from jaxid.model.system import System
from jaxid.motion.limits import Boundary, Limits
from jaxid.motion.trajectory import JerkTrajectory

_KEPT = -1.0  # half-widths: value of entries that are no condition, i.e. the largest margin


def violations(
    limits: Limits, boundary: Boundary, trajectory: JerkTrajectory
) -> tuple[Float[Array, "..."], ...]:
    """Return by how much a motion exceeds each limit at its knots and half-way between them.

    Positive entries are violations, negative ones margins, in half-widths of the limit. They serve
    as penalties; `worst_violation` is exact over all of time.

    Returns:
        Arrays for position, velocity, acceleration, jerk, and the inequalities of the via points.
    """
    inner = trajectory.inside(jnp.array([0.5, 1.0], trajectory.jerk.dtype))
    # the acceleration is linear between the knots: its ends are enough
    values = (inner.position, inner.velocity, inner.acceleration[:, 1:], trajectory.jerk[:, None])
    intervals = (*limits.motion, limits.jerk)
    counted = trajectory.counted[:, None]
    sides = [
        jnp.where(counted, _beyond(x, interval), _KEPT)
        for x, interval in zip(values, intervals, strict=True)
    ]
    return (*sides, _via_excess(limits, boundary, trajectory))


@eqx.filter_jit
def worst_violation(limits: Limits, boundary: Boundary, trajectory: JerkTrajectory) -> Scalar:
    """Return the largest violation of a motion over all of time, in half-widths of the limit.

    A value ≤ 0 means that the motion keeps every limit of position, velocity, acceleration and
    jerk, and the inequalities of the via points. The extrema are exact (closed form). A motion with
    a NaN or an infinity gives inf.
    """
    values = (*trajectory.extrema(),)
    intervals = (*limits.motion, limits.jerk)
    sides = [_beyond(x, interval) for x, interval in zip(values, intervals, strict=True)]
    worst = jnp.max(jnp.concatenate([*sides, _via_excess(limits, boundary, trajectory)]))
    number = jnp.all(jnp.isfinite(jnp.append(trajectory.jerk, trajectory.start)))
    return jnp.where(number, worst, jnp.inf)


class Envelope(NamedTuple):
    """The ranges of position, velocity and input of the axis along a motion, one per sample.

    They cover several plants and repeats of the motion.

    Attributes:
        position: range of the position during each sample period, m or rad.
        velocity: range of the velocity during each sample period, m/s or rad/s.
        input: range of the commanded input of each sample period, in the unit of the input.
        input_rate: range of the change of the input from one sample to the next, in the unit of the
            input per s.
    """

    position: Range
    velocity: Range
    input: Range
    input_rate: Range


class Prediction(eqx.Module):
    """Base class of predictions of the axis along a motion, by simulated samples or by proof."""

    @property
    @abc.abstractmethod
    def system(self) -> System:
        """The system that gives the input which a motion needs."""

    @abc.abstractmethod
    def __call__(self, trajectory: JerkTrajectory) -> Envelope:
        """Return the ranges of position, velocity and input of the axis along a motion."""


def axis_violations(limits: Limits, envelope: Envelope) -> tuple[Float[Array, "..."], ...]:
    """Return by how much the axis exceeds its limits, in half-widths of the limit.

    Positive entries are violations.

    Returns:
        Arrays for position, velocity, input and, if it is limited, the rate of the input.
    """
    intervals = (limits.position, limits.velocity, limits.input, limits.input_rate)
    return tuple(
        jnp.maximum(_beyond(values.lower, interval), _beyond(values.upper, interval))
        for values, interval in zip(envelope, intervals, strict=True)
        if interval is not None
    )


def _beyond(values: Motion, interval: Interval) -> Motion:
    half_width = (interval[1] - interval[0]) / 2
    beyond = jnp.maximum(values - interval[1], interval[0] - values) / half_width
    # entry by entry: XLA's maximum over a long array may pass over NaN
    return jnp.where(jnp.isnan(beyond), jnp.inf, beyond)


def _via_excess(
    limits: Limits, boundary: Boundary, trajectory: JerkTrajectory
) -> Float[Array, " v"]:
    scale = (limits.motion[:, 1] - limits.motion[:, 0]) / 2
    parts = [jnp.zeros(0, trajectory.jerk.dtype)]
    for via in boundary.vias:
        state = jnp.stack(trajectory.states(via.at * trajectory.duration[None])).ravel()
        # equalities are met by construction, to rounding
        free = via.lower < via.upper
        for side in (state - via.upper, via.lower - state):
            parts.append(jnp.where(free & jnp.isfinite(side), side / scale, _KEPT))
    return jnp.concatenate(parts)
