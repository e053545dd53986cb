"""The tables of an axis file, with a check of every entry.

`jaxid.axis.objects` makes the objects of the library from them. This module imports nothing that is
slow, so that a mistake in a file is found at once.
"""

import math
from typing import Literal

import msgspec

Coordinate = Literal["linear", "rotary"]
_MOST = 10_000  # limit for intervals of a motion and for a delay in sample periods
_RESERVED = ("all", "wanted")  # targets of a design that are no parameters
Pair = tuple[float, float]
Direction = Literal["both", "forward", "backward"]


class Table(msgspec.Struct, forbid_unknown_fields=True):
    """Base class of the tables of an axis file.

    Unknown entries and numbers that are not finite raise an error.
    """

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            entry = getattr(self, name)
            several = tuple(entry.values()) if isinstance(entry, dict) else entry
            for number in several if isinstance(several, tuple) else (several,):
                if isinstance(number, float) and not math.isfinite(number):
                    raise ValueError(f"`{name}` must be finite, but is {entry}")


class Kind(Table, tag_field="kind"):
    """Base class of the entries of [[terms]]: a parameter, and the regressor that it multiplies.

    Attributes:
        name: name of the parameter, which must be usable as the name of a folder.
        unit: unit of the parameter.
        interval: prior interval (lower, upper) of the parameter, in `unit`.
    """

    name: str
    unit: str
    interval: Pair

    def __post_init__(self) -> None:
        super().__post_init__()
        folder = self.name.strip(" .") and self.name.isprintable() and len(self.name) <= 50
        if not folder or set(self.name) & set("/\\"):
            raise ValueError(
                "`name` is used as a folder name, and must be text of up to 50 characters without "
                f"/ and \\, but is {self.name[:60]!r}"
            )
        if self.name in _RESERVED:
            raise ValueError(f"`name` must not be all or wanted, but is {self.name!r}")


class Inertia(Kind, tag="inertia"):
    """An inertia: the acceleration is its regressor."""


class Constant(Kind, tag="constant"):
    """A constant offset of the input."""


class Spring(Kind, tag="spring"):
    """A spring, with its position at rest in m or rad."""

    rest: float = 0.0


class Gravity(Kind, tag="gravity"):
    """Gravity on a rotary axis, with its phase in rad."""

    phase: float = 0.0


class Cogging(Kind, tag="cogging", kw_only=True):
    """A harmonic of cogging, with the pitch in m or rad and the phase in rad."""

    pitch: float
    harmonic: int = 1
    phase: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pitch <= 0 or self.harmonic < 1:
            raise ValueError(
                "`pitch` must be above zero and `harmonic` 1 or more, but they are "
                f"{self.pitch:g} and {self.harmonic}"
            )


class Friction(Kind, kw_only=True):
    """Friction, a function of velocity, in both directions or in one."""

    direction: Direction = "both"


class Viscous(Friction, tag="viscous"):
    """Friction in proportion to the velocity."""


class Sign(Friction, tag="sign"):
    """Friction with the sign of the velocity."""


class Coulomb(Friction, tag="coulomb", kw_only=True):
    """Friction with a smooth sign of the velocity, of steepness `beta` in s/m or s/rad."""

    beta: float


class Input(Table):
    """The table [input]; the gain is the unit of the input per unit of the command."""

    unit: Literal["V", "A", "N", "N m"]
    gain: float = 1.0
    delay: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gain == 0:
            raise ValueError("`gain` must not be zero")
        if not 0 <= self.delay <= _MOST:
            raise ValueError(f"`delay` must be 0 to {_MOST}, but is {self.delay}")

    def pushed(self, commanded: Pair) -> Pair:
        """Return an interval of commands in the unit of the input."""
        low, high = sorted(self.gain * end for end in commanded)
        return low, high


class Servo(Table):
    """The table [servo], in s, m or rad, and m/s or rad/s."""

    period: float
    resolution: float
    velocity_error: float = 0.0


class Disturbance(Table):
    """The table [disturbance]: one level of δ, or two and the speed between them."""

    level: float
    slow: float | None = None
    threshold: float | None = None


class Limits(Table):
    """The table [limits], in SI units and in the unit of the command."""

    position: Pair
    velocity: Pair
    input: Pair
    jerk: Pair
    acceleration: Pair | None = None
    input_rate: Pair | None = None


class Log(Table):
    """The table [log]: columns, each by its name or its number from 1, and their units.

    A unit is a name, or a number of SI units per unit of the column.
    """

    position: str | int
    input: str | int
    time: str | int | None = None
    position_unit: str | float = 1.0
    time_unit: str | float = 1.0
    input_unit: float = 1.0


class Law(Table, tag_field="kind"):
    """A controller, with gains in the unit of the input."""


class PD(Law, tag="pd"):
    """Feed-forward with position and velocity feedback."""

    kp: float
    kd: float


class ARC(Law, tag="arc"):
    """The gains of adaptive robust control, as a table [controller]."""

    k1: float
    k2: float
    epsilon: float
    gamma: dict[str, float] = {}


class Via(Table):
    """A position that the motion must reach at a fraction of its duration."""

    at: float
    lower: float | None = None
    upper: float | None = None


class Motion(Table):
    """The table [motion], in s, m or rad."""

    start: float
    duration: float
    knot_period: float
    end: float | None = None
    home: float | None = None
    settle: float = 0.0
    via: tuple[Via, ...] = ()

    @property
    def intervals(self) -> int:
        """The number of intervals of constant jerk."""
        return whole(self.duration, self.knot_period, "`motion.duration`")

    @property
    def waiting(self) -> int:
        """The number of intervals between the approach and the motion."""
        if self.settle < 0:
            raise ValueError(f"`motion.settle` must be 0 s or more, but is {self.settle:g} s.")
        return whole(self.settle, self.knot_period, "`motion.settle`") if self.settle else 0


def whole(time: float, period: float, name: str) -> int:
    """Return the number of knot periods in a time.

    Args:
        time: time, s.
        period: knot period, s.
        name: name of the time, for the error message.

    Raises:
        ValueError: if it is not a whole number, one or more.
    """
    if not time > 0:
        raise ValueError(f"{name} must be above zero, but is {time:g} s.")
    count = time / period if period > 0 else 0.0
    if not count <= _MOST:
        raise ValueError(
            f"{name} = {time:g} s must be at most {_MOST} times `motion.knot_period` = "
            f"{period:g} s."
        )
    if count < 1 or abs(count - round(count)) > 1e-6:
        raise ValueError(
            f"{name} = {time:g} s must be a whole multiple of `motion.knot_period` = {period:g} s."
        )
    return round(count)


class AxisTables(Table, kw_only=True):
    """The tables and entries of a whole axis file.

    Attributes:
        coordinate: "linear" (m) or "rotary" (rad).
        input: table [input]: unit, gain and delay.
        servo: table [servo]: sample period, encoder resolution and velocity error.
        limits: table [limits].
        motion: table [motion]: start, end, via points and duration.
        terms: entries of [[terms]]; empty if the model is given by `python`.
        disturbance: table [disturbance]; None if the model is given by `python`.
        python: name module:object of a system in Python, or None.
        wanted: required accuracy of parameters, by name, in their units.
        log: table [log], the columns of a log, or None.
        controller: table [controller], or None.
    """

    coordinate: Coordinate
    input: Input
    servo: Servo
    limits: Limits
    motion: Motion
    terms: tuple[
        Inertia | Viscous | Coulomb | Sign | Constant | Spring | Gravity | Cogging,
        ...,
    ] = ()
    disturbance: Disturbance | None = None
    python: str | None = None
    wanted: dict[str, float] = {}
    log: Log | None = None
    controller: PD | ARC | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        said = bool(self.terms), self.disturbance is not None
        if said != ((self.python is None),) * 2:
            raise ValueError(
                "the model must be given either by [[terms]] and [disturbance], or by `python`"
            )
