"""How far a motion, or the axis that follows it, is beyond its limits."""

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

_KEPT = -1.0  # half-widths: of what is no condition, as far from its limit as can be


def violations(
    limits: Limits, boundary: Boundary, trajectory: JerkTrajectory
) -> tuple[Float[Array, "..."], ...]:
    """How far a motion is beyond each limit at its knots and half-way between them.

    Positive entries are violations, in half-widths of the limit; the inequalities of the via points
    come last. For penalties: what a motion keeps exactly is `worst_violation`.
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
    """The largest violation over all of time, in half-widths; ≤ 0 means that every limit is kept.

    From the closed-form extrema, and the inequalities of the via points. A motion that is no number
    keeps nothing.
    """
    values = (*trajectory.extrema(),)
    intervals = (*limits.motion, limits.jerk)
    sides = [_beyond(x, interval) for x, interval in zip(values, intervals, strict=True)]
    worst = jnp.max(jnp.concatenate([*sides, _via_excess(limits, boundary, trajectory)]))
    number = jnp.all(jnp.isfinite(jnp.append(trajectory.jerk, trajectory.start)))
    return jnp.where(number, worst, jnp.inf)


class Envelope(NamedTuple):
    """What the axis itself may do along a motion: ranges over plants and repeats, tick by tick.

    Attributes:
        position: during each tick.
        velocity: during each tick.
        input: commanded at each tick.
        input_rate: from one tick to the next, in the input unit per s.
    """

    position: Range
    velocity: Range
    input: Range
    input_rate: Range


class Prediction(eqx.Module):
    """What the axis will do along a motion: sampled or proved, as the implementation says."""

    @property
    @abc.abstractmethod
    def system(self) -> System:
        """The model, for what a motion asks of the input."""

    @abc.abstractmethod
    def __call__(self, trajectory: JerkTrajectory) -> Envelope:
        """The envelope of the axis, tick by tick of the motion."""


def axis_violations(limits: Limits, envelope: Envelope) -> tuple[Float[Array, "..."], ...]:
    """How far the axis is beyond its limits, in half-widths: position, velocity, input and rate."""
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
        # equalities are met by construction: what is left of them is rounding
        free = via.lower < via.upper
        for side in (state - via.upper, via.lower - state):
            parts.append(jnp.where(free & jnp.isfinite(side), side / scale, _KEPT))
    return jnp.concatenate(parts)
