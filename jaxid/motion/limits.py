"""Conditions on a motion: limits (4), start state, end state and via points."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require, require_interval, require_shape
from jaxid._types import Interval, Numbers, Scalar, as_array, as_known, or_none

_STATE = "position, velocity, acceleration"


class Limits(eqx.Module):
    """The limits of an axis: closed intervals (lower, upper), which need not be symmetric.

    Attributes:
        position: limits of the position, m or rad.
        velocity: limits of the velocity, m/s or rad/s; zero lies inside.
        acceleration: limits of the acceleration, m/s² or rad/s²; zero lies inside. See
            `acceleration_limit`.
        jerk: limits of the jerk, m/s³ or rad/s³; zero lies inside.
        input: limits of the input, in the unit of the input; zero lies inside.
        input_rate: limits of the rate of the input that the amplifier can follow, in the unit of
            the input per s; zero lies inside; None, the default, is no limit.

    Raises:
        ValueError: if an interval is not finite or not in order, or zero is not inside.

    Example:
        >>> limits = jd.Limits(acceleration=acceleration, jerk=(-200.0, 200.0), **box)
        >>> limits.velocity.tolist()
        [-1.0, 1.0]
    """

    position: Interval = eqx.field(converter=as_array("position"))
    velocity: Interval = eqx.field(converter=as_array("velocity"))
    acceleration: Interval = eqx.field(converter=as_array("acceleration"))
    jerk: Interval = eqx.field(converter=as_array("jerk"))
    input: Interval = eqx.field(converter=as_array("input"))
    input_rate: Interval | None = eqx.field(converter=or_none(as_array("input_rate")), default=None)

    def __check_init__(self) -> None:
        for name in ("position", "velocity", "acceleration", "jerk", "input", "input_rate"):
            interval = getattr(self, name)
            if interval is None:
                continue
            require_interval(name, interval)
            if name != "position" and is_concrete(interval):
                lower, upper = np.asarray(interval).tolist()
                require(
                    lower < 0 < upper,
                    f"Argument `{name}` must contain zero, so that the axis can rest, but is "
                    f"({lower:g}, {upper:g}).",
                )

    @property
    def motion(self) -> Float[Array, "3 2"]:
        """The limits of position, velocity and acceleration, one row (lower, upper) each."""
        return jnp.stack([self.position, self.velocity, self.acceleration])


def shrunk(limits: Limits, share: Float[Array, "3"]) -> Limits:
    """Return limits whose position, velocity and input intervals are narrower at both ends.

    Args:
        limits: limits to narrow.
        share: amounts by which both ends of position, velocity and input move inwards, in
            half-widths of each interval.
    """

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
    """Bounds on the state [y, ẏ, ÿ] of a motion at one instant.

    Equal lower and upper bounds fix a component; ±inf leaves it free.

    Attributes:
        at: instant as a fraction of the duration of the motion, in (0, 1]; 1 is the end.
        lower: lower bounds of [y, ẏ, ÿ], SI units.
        upper: upper bounds of [y, ẏ, ÿ], SI units.

    Raises:
        ValueError: if `at` is outside (0, 1] or a lower bound is above its upper bound.
    """

    at: float = eqx.field(converter=as_known("at"), static=True)
    lower: Float[Array, "3"] = eqx.field(converter=as_array("lower"))
    upper: Float[Array, "3"] = eqx.field(converter=as_array("upper"))

    def __check_init__(self) -> None:
        for name in ("lower", "upper"):
            require_shape(name, "a via point", getattr(self, name), (3,), _STATE)
        require(
            0 < self.at <= 1,
            f"Argument `at` must be a fraction of the whole time in (0, 1], but is {self.at:g}.",
        )
        if is_concrete((self.lower, self.upper)):
            require(
                bool(np.all(np.asarray(self.lower) <= np.asarray(self.upper))),
                "Argument `lower` of a via point must not exceed `upper`, but they are "
                f"{self.lower.tolist()} and {self.upper.tolist()}.",
            )


class Boundary(eqx.Module):
    """The start state of a motion, and its conditions at later instants, the end included.

    Attributes:
        start: state [y, ẏ, ÿ] at t = 0, SI units.
        vias: conditions at later instants; one with `at = 1` is the end condition. Without it the
            motion may end in any state within the limits.

    Example:
        >>> rest = (0.1, 0.0, 0.0)  # m, m/s, m/s²
        >>> ends = jd.Boundary(rest, (jd.through(rest, at=1.0),))
    """

    start: Float[Array, "3"] = eqx.field(converter=as_array("start"))
    vias: tuple[Via, ...] = eqx.field(converter=tuple)

    def __check_init__(self) -> None:
        require_shape("start", "a boundary", self.start, (3,), _STATE)


def through(state: Numbers, at: float) -> Via:
    """Return the via point that fixes the state [y, ẏ, ÿ] of a motion at one instant.

    Args:
        state: position, velocity and acceleration, SI units.
        at: instant as a fraction of the duration of the motion, in (0, 1]; 1 is the end.
    """
    return Via(at, state, state)


def position_at_least(position: float, at: float) -> Via:
    """Return the via point that requires y ≥ `position` at one instant of a motion.

    Args:
        position: smallest permitted position, m or rad.
        at: instant as a fraction of the duration of the motion, in (0, 1]; 1 is the end.
    """
    free = float("inf")
    return Via(at, (position, -free, -free), (free, free, free))
