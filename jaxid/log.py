"""What a servo leaves of an experiment, and what it proves of the motion: brackets from (1) alone.

All of this is interval arithmetic on the plant equation with θ in the box and |Δ| ≤ δ, on the
known inputs, and on positions that are known to half a count. Nothing is assumed of the motion: the
limits of a reference say nothing about what the axis did.
"""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid.checks import (
    is_concrete,
    require,
    require_at_least_zero,
    require_float64,
    require_positive,
)
from jaxid.quantities import Scalar
from jaxid.ranges import Range, around, common, exactly, hull, minus, plus, size, times
from jaxid.system import System

_WINDOW = 12  # ticks: positions farther apart say less about a velocity than nearer ones
_ROUNDINGS = 4  # of a position: when it is read, and in a difference of two or three
_PASSES = 4  # of velocity from acceleration and acceleration from velocity


class Log(eqx.Module):
    """A sampled experiment: u_k is held from t_k to t_{k+1}, positions are read at t_0 … t_n.

    Attributes:
        input: u_k as commanded, shape (n,).
        position: as read, shape (n + 1,): |read − true| ≤ resolution/2.
        period: t_{k+1} − t_k, s.
        resolution: of the encoder, m or rad; zero for one that is exact.
    """

    input: Float[Array, " n"]
    position: Float[Array, " samples"]
    period: Scalar = eqx.field(converter=jnp.asarray)
    resolution: Scalar = eqx.field(converter=jnp.asarray)

    def __check_init__(self) -> None:
        require_positive("period", "a log", self.period)
        require_at_least_zero("resolution", "a log", self.resolution)
        require(
            self.position.size == self.input.size + 1,
            "Argument `position` must have one entry more than `input`, the end of its last tick, "
            f"but they have {self.position.size} and {self.input.size}.",
        )

    @property
    def reading_error(self) -> Scalar:
        """|read − true| at most, with what doubles of this size and their differences lose."""
        rounded = _ROUNDINGS * jnp.finfo(self.position.dtype).eps
        return self.resolution / 2 + rounded * jnp.max(jnp.abs(self.position))


class Brackets(NamedTuple):
    """What the axis did during each of n ticks, at any instant of it."""

    position: Range
    velocity: Range
    acceleration: Range


def brackets(system: System, log: Log) -> Brackets:
    """Position, velocity and acceleration of every plant of the system that leaves this log.

    Args:
        system: its box and δ; a box that was narrowed by the same log is as good.
        log: of at least two ticks.

    Raises:
        ValueError: if no plant of the system can have left this log, or if its period is too long
            for any bracket.
    """
    require_float64("log", log)
    found = _brackets(system, log)
    if is_concrete(found):
        require(
            bool(jnp.all(jnp.isfinite(found.velocity.upper))),
            f"Argument `log`: its period of {float(log.period):g} s is too long to bound a "
            "velocity from the box: the axis could accelerate without limit within a tick.",
        )
        room = found.velocity.upper - found.velocity.lower
        tick = int(jnp.argmin(room))
        require(
            float(room[tick]) >= 0,
            "Argument `log`: no plant within the box and δ can have left it; its positions and "
            f"inputs contradict each other around tick {tick}.",
        )
    return found


@eqx.filter_jit
def _brackets(system: System, log: Log) -> Brackets:
    h = log.period
    mean = jnp.diff(log.position) / h
    speed = _top_speed(system, log, mean)
    position, acceleration = _within(system, log, around(speed))
    # in every tick the velocity is once the mean one
    reach = 2 * log.reading_error / h + h * size(acceleration).upper
    velocity = Range(mean - reach, mean + reach)
    for _ in range(_PASSES):
        position, acceleration = _within(system, log, velocity)
        at_samples = _swept(_from_windows(log, acceleration), acceleration, h)
        velocity = common(velocity, _between(at_samples, acceleration, h))
    return Brackets(position, velocity, acceleration)


def _top_speed(system: System, log: Log, mean: Float[Array, " n"]) -> Scalar:
    """A V that the speed stays below; inf if none is found.

    In each tick there is an instant with the mean velocity. As long as |ẏ| ≤ V from there on, |ÿ|
    is at most A(V), so |ẏ| at most mean + h·A(V): if that is below V, V is never reached.
    """
    h = log.period
    most = jnp.max(jnp.abs(mean)) + 2 * log.reading_error / h

    def next_speed(speed: Scalar) -> Scalar:
        return most + h * jnp.max(size(_within(system, log, around(speed))[1]).upper)

    speed = 1.01 * jax.lax.fori_loop(0, 30, lambda _, speed: next_speed(speed), most)
    return jnp.where(next_speed(speed) < speed, speed, jnp.inf)


def _within(system: System, log: Log, velocity: Range) -> tuple[Range, Range]:
    """Position and acceleration during each tick, from the velocity; ÿ from (1)."""
    first, last = log.position[:-1], log.position[1:]
    velocity = jax.tree.map(lambda x: jnp.broadcast_to(x, first.shape), velocity)
    reach = log.reading_error + log.period * size(velocity).upper / 2  # from the nearer end
    position = plus(hull(exactly(first), exactly(last)), around(reach))
    return position, accelerations(system, log.input, position, velocity)


def accelerations(
    system: System, input: Float[Array, " n"], position: Range, velocity: Range
) -> Range:
    """ÿ of (1) for all θ in the box and all |Δ| ≤ δ."""
    box = [Range(*term.interval) for term in system.terms]
    forces = system.force_ranges(position, velocity)
    delta = system.disturbance_bound.range(position, velocity).upper
    taken = [times(theta, force) for theta, force in zip(box[1:], forces, strict=True)]
    load = minus(exactly(input), plus(*taken, around(delta)))
    return times(load, Range(1 / box[0].upper, 1 / box[0].lower))


def _from_windows(log: Log, acceleration: Range) -> Range:
    """Velocities at the n + 1 samples from mean ones over windows of many lengths.

    Over the p ticks after t_k the mean velocity is v_k + h·Σ_i (p − i − ½)/p·a_{k+i} with each a
    somewhere in its range, and so on for the p ticks before it and for both together.
    """
    h, y, count = log.period, log.position, log.position.size
    found = Range(jnp.full(count, -jnp.inf), jnp.full(count, jnp.inf))
    both = zip(_gains(acceleration, count, 1), _gains(acceleration, count, -1), strict=True)
    for p, (after, before) in enumerate(both, start=1):
        later, sooner = _shifted(y, p, count, 0.0), _shifted(y, -p, count, 0.0)
        error = jnp.broadcast_to(2 * log.reading_error / (p * h), y.shape)
        gained = minus(_times(h / 2, before), _times(h / 2, after))
        for mean, doubt in (
            ((later - y) / (p * h), minus(around(error), _times(h, after))),
            ((y - sooner) / (p * h), plus(around(error), _times(h, before))),
            ((later - sooner) / (2 * p * h), plus(around(error / 2), gained)),
        ):
            found = common(found, plus(exactly(mean), doubt))
    return found


def _gains(acceleration: Range, count: int, side: int) -> Iterator[Range]:
    """Σ_i (p − i − ½)/p·a_i over the p ticks after (side 1) or before (−1) each sample, by p."""
    total = gain = exactly(jnp.zeros(count))
    for p in range(1, _WINDOW + 1):
        by = p - 1 if side > 0 else -p
        newest = Range(
            _shifted(acceleration.lower, by, count, -jnp.inf),
            _shifted(acceleration.upper, by, count, jnp.inf),
        )
        gain = plus(gain, total, _times(0.5, newest))
        total = plus(total, newest)
        yield _times(1 / p, gain)


def _shifted(x: Float[Array, " k"], by: int, count: int, beyond: float) -> Float[Array, " count"]:
    """x_{l+by} for l = 0 … count − 1."""
    index = jnp.arange(count) + by
    inside = (index >= 0) & (index < x.size)
    return jnp.where(inside, x[jnp.clip(index, 0, x.size - 1)], beyond)


def _times(factor: Scalar | float, x: Range) -> Range:
    """By a factor above zero."""
    return Range(factor * x.lower, factor * x.upper)


def _swept(at_samples: Range, acceleration: Range, h: Scalar) -> Range:
    """What each sample's velocity and the accelerations since or until then say of all others."""
    after = _swept_forward(at_samples, acceleration, h)
    backward = jax.tree.map(lambda x: jnp.flip(-x), Range(acceleration.upper, acceleration.lower))
    return jax.tree.map(jnp.flip, _swept_forward(jax.tree.map(jnp.flip, after), backward, h))


def _swept_forward(at_samples: Range, acceleration: Range, h: Scalar) -> Range:
    """The lowest of all v_j + h·Σ a from j on, and so on."""
    fallen, risen = (jnp.append(0.0, jnp.cumsum(x * h)) for x in acceleration)
    return Range(
        fallen + jax.lax.cummax(at_samples.lower - fallen),
        risen + jax.lax.cummin(at_samples.upper - risen),
    )


def _between(at_samples: Range, acceleration: Range, h: Scalar) -> Range:
    """During each tick: ẏ leaves the chord between its ends by at most h/4 of the range of ÿ."""
    first, last = (Range(*(x[part] for x in at_samples)) for part in (np.s_[:-1], np.s_[1:]))
    return plus(hull(first, last), around(h / 4 * (acceleration.upper - acceleration.lower)))
