"""What a motion must respect: limits (4), the acceleration limit (18), boundary and via points."""

import abc
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require, require_interval
from jaxid._types import Ends, Interval, Motion, Scalar, as_interval
from jaxid.model.interval_arithmetic import Range
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory, States


def _as_interval_or_none(ends: Ends | None) -> Interval | None:
    return None if ends is None else as_interval(ends)


class Limits(eqx.Module):
    """Closed intervals (lower, upper) that need not be symmetric, in SI units of the axis.

    Attributes:
        position: m or rad.
        velocity: m/s or rad/s; zero lies inside.
        acceleration: m/s² or rad/s²; zero lies inside. See `acceleration_limit`.
        jerk: m/s³ or rad/s³; zero lies inside.
        input: in the system's input unit; zero lies inside.
        input_rate: in the input unit per s, what the amplifier follows; None, the default, is
            no limit.
    """

    position: Interval = eqx.field(converter=as_interval)
    velocity: Interval = eqx.field(converter=as_interval)
    acceleration: Interval = eqx.field(converter=as_interval)
    jerk: Interval = eqx.field(converter=as_interval)
    input: Interval = eqx.field(converter=as_interval)
    input_rate: Interval | None = eqx.field(converter=_as_interval_or_none, default=None)

    def __check_init__(self) -> None:
        for name in ("position", "velocity", "acceleration", "jerk", "input", "input_rate"):
            interval = getattr(self, name)
            if interval is None:
                continue
            require_interval(name, interval)
            if name != "position" and is_concrete(interval):
                require(
                    float(interval[0]) < 0 < float(interval[1]),
                    f"Argument `{name}` must have zero inside, so that the axis can rest, but is "
                    f"({float(interval[0]):g}, {float(interval[1]):g}).",
                )

    @property
    def motion(self) -> Float[Array, "3 2"]:
        """Rows position, velocity, acceleration; columns lower, upper."""
        return jnp.stack([self.position, self.velocity, self.acceleration])


def shrunk(limits: Limits, share: Float[Array, "3"]) -> Limits:
    """Position, velocity and input limits moved inwards by shares of their half-widths."""

    def inwards(interval: Interval, share: Scalar) -> Interval:
        room = share * (interval[1] - interval[0]) / 2
        return interval + jnp.stack([room, -room])

    return eqx.tree_at(
        lambda x: (x.position, x.velocity, x.input),
        limits,
        (
            inwards(limits.position, share[0]),
            inwards(limits.velocity, share[1]),
            inwards(limits.input, share[2]),
        ),
    )


class Via(eqx.Module):
    """Bounds on the state [y, ẏ, ÿ] at one instant, `at` being its fraction of the whole time.

    Equal lower and upper bounds fix a component; ±inf leaves it free.
    """

    at: float = eqx.field(static=True)
    lower: Float[Array, "3"] = eqx.field(converter=as_interval)
    upper: Float[Array, "3"] = eqx.field(converter=as_interval)

    def __check_init__(self) -> None:
        require(
            0 < self.at <= 1,
            f"Argument `at` must be a fraction of the whole time in (0, 1], but is {self.at:g}.",
        )
        if is_concrete((self.lower, self.upper)):
            require(
                bool(jnp.all(self.lower <= self.upper)),
                "Argument `lower` of a via point must not exceed `upper`, but they are "
                f"{self.lower.tolist()} and {self.upper.tolist()}.",
            )


class Boundary(eqx.Module):
    """Where a motion starts, and what it must pass on the way and at the end.

    Attributes:
        start: [y, ẏ, ÿ] at t = 0.
        vias: later conditions, the final one included (`at = 1`).
    """

    start: Float[Array, "3"] = eqx.field(converter=as_interval)
    vias: tuple[Via, ...]


def through(state: Sequence[float], at: float) -> Via:
    """The state [y, ẏ, ÿ] is met exactly at the fraction `at` of the whole time."""
    return Via(at, state, state)


def position_at_least(position: float, at: float) -> Via:
    """Y ≥ `position` at the fraction `at` of the whole time."""
    free = float("inf")
    return Via(at, (position, -free, -free), (free, free, free))


def acceleration_limit(system: System, position: Ends, velocity: Ends, input: Ends) -> Interval:
    """(18), read sharply: what the input has left for θ_x2·ÿ after Σ_j max|f_j|·max|θ_j|.

    As in the paper the disturbance and the feedback effort are left out, so that |u| ≤ u_max in
    closed loop does not follow from it. For the motor 400/9 = 44.4 m/s².
    """
    peaks = _peak_parameters(system)[1:] * _peak_regressors(system, position, velocity)
    return _remaining(system, as_interval(input), jnp.sum(peaks))


def acceleration_limit_euclidean(
    system: System, position: Ends, velocity: Ends, input: Ends
) -> Interval:
    """(18) as printed: max|f|₂·max|θ_φ|₂ (Cauchy-Schwarz). For the motor 43.8 m/s²."""
    regressor = jnp.linalg.norm(_peak_regressors(system, position, velocity))
    return _remaining(
        system, as_interval(input), regressor * jnp.linalg.norm(_peak_parameters(system)[1:])
    )


def acceleration_reach(system: System, position: Ends, velocity: Ends, input: Ends) -> Interval:
    """The accelerations that `input_demand` leaves at the state that needs the least for the rest.

    For the motor 51.9 m/s²: friction may be zero, and the offset and δ may not help.
    """
    box = (Range(*as_interval(position)), Range(*as_interval(velocity)))
    needs = system.disturbance_bound.range(*box).lower
    up, down = needs, needs
    for term, span in zip(system.terms[1:], system.force_ranges(*box), strict=True):
        up = up + _least_peak(term.interval, span)
        down = down + _least_peak(-term.interval[::-1], span)
    low, high = as_interval(input)
    return jnp.stack([low + down, high - up]) / system.upper[0]


def _least_peak(interval: Interval, span: Range) -> Scalar:
    """The least of max θf over f in a range, θ being the worst in its interval: convex in f."""
    f = jnp.stack([span.lower, span.upper, jnp.clip(0.0, span.lower, span.upper)])
    return jnp.min(jnp.maximum(f * interval[0], f * interval[1]))


def input_demand(system: System, states: States) -> Range:
    """All inputs that the motion itself may ask for: φᵀθ + Δ over θ ∈ Ω_θ and |Δ| ≤ δ.

    The input limit itself, where (18) is one number for all motions: friction helps to brake. What
    feedback adds is left out.
    """
    phi = system.regressors(*states)
    ends = [term.interval for term in system.terms]
    sides = [(f * low, f * high) for f, (low, high) in zip(phi, ends, strict=True)]
    delta = system.disturbance_bound(states.position, states.velocity)
    return Range(
        sum((jnp.minimum(*side) for side in sides), start=-delta),
        sum((jnp.maximum(*side) for side in sides), start=delta),
    )


def _peak_parameters(system: System) -> Float[Array, " m"]:
    return jnp.maximum(jnp.abs(system.lower), jnp.abs(system.upper))


def _peak_regressors(system: System, position: Ends, velocity: Ends) -> Float[Array, " forces"]:
    position, velocity = as_interval(position), as_interval(velocity)
    return jnp.stack(
        [
            term.regressor.magnitude(position, velocity)
            for term in system.terms
            if term.regressor is not None
        ]
    )


def _remaining(system: System, input: Interval, load: Scalar) -> Interval:
    remaining = input + jnp.stack([load, -load])
    if is_concrete(remaining):
        require(
            float(remaining[0]) < 0 < float(remaining[1]),
            f"Argument `input` must leave something for acceleration, but the terms of the system "
            f"may take {float(load):g} {system.input_unit} of {list(map(float, input))}.",
        )
    return remaining / system.upper[0]


def excess(
    limits: Limits, boundary: Boundary, trajectory: JerkTrajectory
) -> tuple[Float[Array, "..."], ...]:
    """How far a motion is beyond each limit at its knots and half-way between them.

    Positive entries are violations, in half-widths of the limit; the inequalities of the via points
    come last. For penalties: what a motion keeps exactly is `worst_excess`.
    """
    inner = trajectory.inside(jnp.array([0.5, 1.0], trajectory.jerk.dtype))
    # the acceleration is linear between the knots: its ends are enough
    values = (inner.position, inner.velocity, inner.acceleration[:, 1], trajectory.jerk)
    intervals = (*limits.motion, limits.jerk)
    sides = [_beyond(x, interval) for x, interval in zip(values, intervals, strict=True)]
    return (*sides, _via_excess(limits, boundary, trajectory))


@eqx.filter_jit
def worst_excess(limits: Limits, boundary: Boundary, trajectory: JerkTrajectory) -> Scalar:
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


def axis_excess(limits: Limits, envelope: Envelope) -> tuple[Float[Array, "..."], ...]:
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
            parts.append(jnp.where(free & jnp.isfinite(side), side / scale, -1.0))
    return jnp.concatenate(parts)
