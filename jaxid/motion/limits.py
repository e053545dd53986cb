"""What a motion must respect: limits (4), the acceleration limit (18), boundary and via points."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require, require_interval
from jaxid._types import Interval, Numbers, Scalar, as_interval, as_known, or_none


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

    Example:
        >>> limits = jd.Limits(acceleration=acceleration, jerk=(-200.0, 200.0), **box)
        >>> limits.velocity.tolist()
        [-1.0, 1.0]
    """

    position: Interval = eqx.field(converter=as_interval)
    velocity: Interval = eqx.field(converter=as_interval)
    acceleration: Interval = eqx.field(converter=as_interval)
    jerk: Interval = eqx.field(converter=as_interval)
    input: Interval = eqx.field(converter=as_interval)
    input_rate: Interval | None = eqx.field(converter=or_none(as_interval), default=None)

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

    at: float = eqx.field(converter=as_known("at"), static=True)
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

    Example:
        >>> rest = (0.1, 0.0, 0.0)  # m, m/s, m/s²
        >>> ends = jd.Boundary(rest, (jd.through(rest, at=1.0),))
    """

    start: Float[Array, "3"] = eqx.field(converter=as_interval)
    vias: tuple[Via, ...]


def through(state: Numbers, at: float) -> Via:
    """The state [y, ẏ, ÿ] is met exactly at the fraction `at` of the whole time."""
    return Via(at, state, state)


def position_at_least(position: float, at: float) -> Via:
    """Y ≥ `position` at the fraction `at` of the whole time."""
    free = float("inf")
    return Via(at, (position, -free, -free), (free, free, free))
