"""Bounds of the position, velocity and acceleration behind a log, from (1) alone.

They are interval arithmetic on the plant equation with θ in the prior box and |Δ| ≤ δ, on the known
inputs, and on positions that are known to half a count. Nothing is assumed of the motion: the
limits of a reference do not bound the motion of the axis.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require, require_float64
from jaxid._types import Scalar
from jaxid.loop.log import InconsistentLogError, Log
from jaxid.model.interval_arithmetic import Range, around, exactly, where
from jaxid.model.system import System

_WINDOW = 12  # samples: positions farther apart hardly improve the bound of a velocity
_PASSES = 4  # iterations of velocity bounds from acceleration bounds and vice versa


class UnboundedVelocityError(ValueError):
    """The error for a sample period that is too long to bound a velocity with this prior box."""


class StateBounds(NamedTuple):
    """The ranges of position, velocity and acceleration of the axis during each of n samples.

    They hold at every instant of a sample period.

    Attributes:
        position: range of the position, m or rad, shape (n,).
        velocity: range of the velocity, m/s or rad/s, shape (n,).
        acceleration: range of the acceleration, m/s² or rad/s², shape (n,).
        reading: largest |read − true| position at the n + 1 samples, m or rad.
    """

    position: Range
    velocity: Range
    acceleration: Range
    reading: Float[Array, " samples"]


def state_bounds(system: System, log: Log) -> StateBounds:
    """Return ranges of position, velocity and acceleration for all plants that can produce a log.

    Args:
        system: axis with its prior box and δ; the box may have been narrowed by the same log.
        log: log of at least two samples.

    Raises:
        InconsistentLogError: if no plant of the system can have produced the log.
        UnboundedVelocityError: if the sample period is too long to bound a velocity.
        ValueError: if the log is not float64.
    """
    require_float64(log=log)
    found = _state_bounds(system, log)
    if is_concrete(found):
        # NumPy: JAX would compile each operation
        velocity = found.velocity
        require(
            bool(np.all(np.isfinite(velocity.upper))),
            f"Argument `log` has a sample period of {float(log.period):g} s, which is too long to "
            "bound a velocity with this prior box: the axis could accelerate without limit within "
            "it. A narrower prior box or a shorter period is needed.",
            UnboundedVelocityError,
        )
        room = np.asarray(velocity.upper) - np.asarray(velocity.lower)
        room = np.where(np.arange(room.size) < log.samples, room, np.inf)
        tick = int(np.argmin(room))
        require(
            float(room[tick]) >= 0,
            f"Argument `log` is inconsistent around sample {tick}: with these inputs, no axis with "
            "θ in the prior box and |Δ| ≤ δ moves through these positions.",
            InconsistentLogError,
        )
    return found


@eqx.filter_jit
def _state_bounds(system: System, log: Log) -> StateBounds:
    h, known = log.period, log.counted
    mean = jnp.diff(log.position) / h
    speed = _top_speed(system, log, mean)
    reading = log.reading_error(jnp.broadcast_to(speed, log.position.shape))
    position, acceleration = _within(system, log, around(speed), reading)
    # in every sample period the velocity equals its mean at some instant
    reach = (reading[:-1] + reading[1:]) / h + h * abs(acceleration).upper
    velocity = where(known, mean + around(reach), around(speed))
    unread = jnp.where(jnp.append(True, known), 0.0, jnp.inf)

    def narrower(_: Any, found: StateBounds) -> StateBounds:
        """Narrow velocities by accelerations, and accelerations by velocities."""
        velocity = found.velocity
        reading = log.reading_error(_around_samples(abs(velocity).upper, speed))
        position, acceleration = _within(system, log, velocity, reading)
        windows = _from_windows(log, acceleration, reading + unread)
        at_samples = _swept(windows, acceleration, h)
        velocity = where(known, velocity & _between(at_samples, acceleration, h), velocity)
        return StateBounds(position, velocity, acceleration, reading)

    # a loop, because four copies would take four times as long to compile
    first = StateBounds(position, velocity, acceleration, reading)
    return jax.lax.fori_loop(0, _PASSES, narrower, first)


def _around_samples(speed: Float[Array, " n"], top: Scalar) -> Float[Array, " samples"]:
    """Return the larger speed of the samples before and after each instant; the top at the ends."""
    inner = jnp.maximum(speed[:-1], speed[1:])
    return jnp.concatenate([top[None], inner, top[None]])


def _top_speed(system: System, log: Log, mean: Float[Array, " n"]) -> Scalar:
    """Return a V that bounds the speed during the log and its jitter; inf if none is found.

    Between two readings there is an instant with the mean velocity. As long as |ẏ| ≤ V from there
    on, |ÿ| ≤ A(V), so that |ẏ| ≤ mean + h·A(V). If that is below V, the speed never reaches V. With
    jitter the time between two readings may be shorter, and the time until the next sample ends
    longer.
    """
    h, jitter = log.period, log.jitter
    still = jnp.zeros(log.position.shape)
    most = jnp.max(jnp.abs(mean)) + 2 * jnp.max(log.reading_error(still)) / h
    most = most * (h / (h - 2 * jitter))

    def next_speed(speed: Scalar) -> Scalar:
        reading = log.reading_error(jnp.broadcast_to(speed, log.position.shape))
        acceleration = _within(system, log, around(speed), reading)[1]
        return most + (h + 4 * jitter) * jnp.max(abs(acceleration).upper)

    speed = 1.01 * jax.lax.fori_loop(0, 30, lambda _, speed: next_speed(speed), most)
    return jnp.where(next_speed(speed) < speed, speed, jnp.inf)


def _within(
    system: System, log: Log, velocity: Range, reading: Float[Array, " samples"]
) -> tuple[Range, Range]:
    """Return position, from the velocity, and acceleration by (1) during each sample period."""
    first, last = log.position[:-1], log.position[1:]
    velocity = jax.tree.map(lambda x: jnp.broadcast_to(x, first.shape), velocity)
    far = log.period * abs(velocity).upper / 2  # from the nearer end
    reach = jnp.maximum(reading[:-1], reading[1:]) + far
    position = (exactly(first) | last) + around(reach)
    return position, accelerations(system, log.acting(), position, velocity)


def accelerations(system: System, input: Range, position: Range, velocity: Range) -> Range:
    """Return the range of ÿ by (1) for all θ in the prior box, all |Δ| ≤ δ and a range of inputs.

    Args:
        system: axis with its prior box and disturbance bound δ.
        input: range of the input, in the unit of the input.
        position: range of the position, m or rad.
        velocity: range of the velocity, m/s or rad/s.
    """
    inertia, *others = system.box
    forces = system.regressor_ranges(position, velocity)
    delta = system.disturbance_bound.range(position, velocity).upper
    taken = sum(theta * force for theta, force in zip(others, forces, strict=True))
    return (input - (taken + around(delta))) / inertia


class _Sums(NamedTuple):
    """Weighted sums of the accelerations of the p samples on one side of each of n + 1 samples.

    Attributes:
        total: Σ_i a_i.
        gain: Σ_i (p − i − ½)·a_i, with i = 0 for the acceleration next to the sample.
    """

    total: Range
    gain: Range

    def with_next(self, newest: Range) -> "_Sums":
        """Return the sums over one acceleration more, that of the sample period farthest away."""
        return _Sums(self.total + newest, self.gain + self.total + 0.5 * newest)


def _from_windows(log: Log, acceleration: Range, reading: Float[Array, " samples"]) -> Range:
    """Return the velocities at the n + 1 samples from mean ones over windows of many lengths.

    Over the p sample periods after t_k the mean velocity is v_k + h·Σ_i (p − i − ½)/p·a_{k+i} with
    each a somewhere in its range, and so on for the p periods before it and for both together.
    """
    h, y, count = log.period, log.position, log.position.size

    def with_window(index: Array, state: tuple[Range, _Sums, _Sums]) -> tuple[Range, _Sums, _Sums]:
        """Return the velocities, narrowed by windows of index + 1 periods, and longer sums."""
        found, after_it, before_it = state
        after_it = after_it.with_next(_accelerations(acceleration, index, count))
        before_it = before_it.with_next(_accelerations(acceleration, -index - 1, count))
        p = jnp.asarray(index + 1, y.dtype)
        after, before = 1 / p * after_it.gain, 1 / p * before_it.gain
        later, sooner = (_shifted(y, by, count, 0.0) for by in (index + 1, -index - 1))
        future, past = (_shifted(reading, by, count, 0.0) for by in (index + 1, -index - 1))
        gained = h / 2 * before - h / 2 * after
        for mean, error, moved in (
            ((later - y) / (p * h), (future + reading) / (p * h), -h * after),
            ((y - sooner) / (p * h), (reading + past) / (p * h), h * before),
            ((later - sooner) / (2 * p * h), (future + past) / (2 * p * h), gained),
        ):
            found = found & (mean + (around(error) + moved))
        return found, after_it, before_it

    # a loop, because a copy for each length would take twice as long to compile
    zero = exactly(jnp.zeros(count))
    empty = _Sums(total=zero, gain=zero)
    first = around(jnp.full(count, jnp.inf)), empty, empty
    return jax.lax.fori_loop(0, _WINDOW, with_window, first)[0]


def _accelerations(acceleration: Range, by: Array, count: int) -> Range:
    """Return the accelerations `by` periods later than each sample; unbounded beyond the log."""
    return Range(
        _shifted(acceleration.lower, by, count, -jnp.inf),
        _shifted(acceleration.upper, by, count, jnp.inf),
    )


def _shifted(x: Float[Array, " k"], by: Array, count: int, beyond: float) -> Float[Array, " count"]:
    """Return x_{l+by} for l = 0 … count − 1, with |by| at most the longest window."""
    padded = jnp.pad(x, (_WINDOW, _WINDOW + 1), constant_values=beyond)
    return jax.lax.dynamic_slice_in_dim(padded, _WINDOW + by, count)


def _swept(at_samples: Range, acceleration: Range, h: Scalar) -> Range:
    """Return the velocities at the samples, narrowed by all others and the accelerations."""
    after = _swept_forward(at_samples, acceleration, h)
    backward = jax.tree.map(jnp.flip, -acceleration)
    return jax.tree.map(jnp.flip, _swept_forward(jax.tree.map(jnp.flip, after), backward, h))


def _swept_forward(at_samples: Range, acceleration: Range, h: Scalar) -> Range:
    """Return the velocities at the samples, narrowed by v_j + h·Σ a from every earlier sample j."""
    fallen, risen = (jnp.append(0.0, jnp.cumsum(x * h)) for x in acceleration)
    return Range(
        fallen + jax.lax.cummax(at_samples.lower - fallen),
        risen + jax.lax.cummin(at_samples.upper - risen),
    )


def _between(at_samples: Range, acceleration: Range, h: Scalar) -> Range:
    """Return the velocity during each sample: at most h/4 of the range of ÿ off its chord."""
    first = jax.tree.map(lambda end: end[:-1], at_samples)
    last = jax.tree.map(lambda end: end[1:], at_samples)
    return (first | last) + around(h / 2 * acceleration.half_width)
