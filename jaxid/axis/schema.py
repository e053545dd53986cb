"""The tables of an axis file, with the check of every entry."""

import math
from collections.abc import Iterable, Mapping
from typing import Literal

import jax.numpy as jnp
import msgspec
from jaxtyping import Array, Float

from jaxid.io.recorded import Column, Columns
from jaxid.loop.controllers import ARC, Controller, PDFeedforward
from jaxid.model.disturbance_bound import ConstantBound, DisturbanceBound, SpeedBand
from jaxid.model.regressors import Constant, Coulomb, OneWay, Regressor, Sign, Sine, Spring, Viscous
from jaxid.model.system import System, Term
from jaxid.motion.acceleration_limit import acceleration_limit
from jaxid.motion.limits import Boundary, Limits, Via

Coordinate = Literal["linear", "rotary"]
_LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "rev": 2 * math.pi}
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
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

    def regressor(self) -> Regressor | None:
        """Return the regressor of the term; None for the inertia."""
        raise NotImplementedError

    def term(self) -> Term:
        """Return the entry as a term of a `System`."""
        return Term(self.name, self.unit, self.interval, self.regressor())


class _Inertia(Kind, tag="inertia"):
    def regressor(self) -> None:
        return None


class _Constant(Kind, tag="constant"):
    def regressor(self) -> Regressor:
        return Constant()


class _Spring(Kind, tag="spring"):
    rest: float = 0.0

    def regressor(self) -> Regressor:
        return Spring(self.rest)


class _Gravity(Kind, tag="gravity"):
    phase: float = 0.0

    def regressor(self) -> Regressor:
        return Sine(self.phase)


class _Cogging(Kind, tag="cogging", kw_only=True):
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

    def regressor(self) -> Regressor:
        return Sine(self.phase, self.pitch / self.harmonic)


class _Friction(Kind, kw_only=True):
    """Friction, a function of velocity, in both directions or in one."""

    direction: Direction = "both"

    def both(self) -> Regressor:
        raise NotImplementedError

    def regressor(self) -> Regressor:
        if self.direction == "both":
            return self.both()
        return OneWay(self.both(), self.direction == "forward")


class _Viscous(_Friction, tag="viscous"):
    def both(self) -> Regressor:
        return Viscous()


class _Sign(_Friction, tag="sign"):
    def both(self) -> Regressor:
        return Sign()


class _Coulomb(_Friction, tag="coulomb", kw_only=True):
    beta: float

    def both(self) -> Regressor:
        return Coulomb(self.beta)


class _Input(Table):
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


class _Servo(Table):
    period: float
    resolution: float
    velocity_error: float = 0.0


class _Disturbance(Table):
    level: float
    slow: float | None = None
    threshold: float | None = None

    def bound(self) -> DisturbanceBound:
        if self.slow is None and self.threshold is None:
            return ConstantBound(self.level)
        if self.slow is None or self.threshold is None:
            raise ValueError("[disturbance] must have both `slow` and `threshold`, or neither")
        return SpeedBand(self.slow, self.level, self.threshold)


class _Limits(Table):
    position: Pair
    velocity: Pair
    input: Pair
    jerk: Pair
    acceleration: Pair | None = None
    input_rate: Pair | None = None

    def of(self, system: System, input: _Input) -> Limits:
        """Return the limits in the unit of the input."""
        rate = None if self.input_rate is None else input.pushed(self.input_rate)
        box = {"position": self.position, "velocity": self.velocity}
        pushed = input.pushed(self.input)
        acceleration = self.acceleration
        if acceleration is None:
            acceleration = acceleration_limit(system, **box, input=pushed)
        return Limits(
            **box, acceleration=acceleration, jerk=self.jerk, input=pushed, input_rate=rate
        )


class _Log(Table):
    """The columns of a log; units are names, or numbers: SI units per unit of the column."""

    position: Column
    input: Column
    time: Column | None = None
    position_unit: str | float = 1.0
    time_unit: str | float = 1.0
    input_unit: float = 1.0

    def columns(self, coordinate: Coordinate, gain: float) -> Columns:
        """Return the columns, with the input in the unit of the axis."""
        lengths = _LENGTHS if coordinate == "linear" else _ANGLES
        position = _unit("position_unit", self.position_unit, lengths)
        time = _unit("time_unit", self.time_unit, _TIMES)
        input = gain * _unit("input_unit", self.input_unit, {})
        return Columns(self.position, self.input, self.time, position, input, time)


def _unit(name: str, unit: str | float, named: Mapping[str, float]) -> float:
    found = named.get(unit) if isinstance(unit, str) else unit
    if not found:
        right = ", ".join([*named, "or a number above zero"])
        raise ValueError(f"`log.{name}` must be {right}, but is {unit!r}.")
    return found


class _Law(Table, tag_field="kind"):
    """A controller, with gains in the unit of the input."""

    def controller(self, system: System) -> Controller:
        raise NotImplementedError


class _PD(_Law, tag="pd"):
    kp: float
    kd: float

    def controller(self, system: System) -> Controller:
        return PDFeedforward(system, system.centre, self.kp, self.kd)


class _ARC(_Law, tag="arc"):
    k1: float
    k2: float
    epsilon: float
    gamma: dict[str, float] = {}

    def controller(self, system: System) -> Controller:
        _require_parameters("controller.gamma", self.gamma, system)
        gamma = jnp.array([self.gamma.get(name, 0.0) for name in system.names])
        return ARC(system, self.k1, self.k2, self.epsilon, gamma)


class _Via(Table):
    at: float
    lower: float | None = None
    upper: float | None = None

    def via(self) -> Via:
        low, high = (-math.inf, -math.inf), (math.inf, math.inf)
        lower = -math.inf if self.lower is None else self.lower
        upper = math.inf if self.upper is None else self.upper
        return Via(self.at, (lower, *low), (upper, *high))


class _Motion(Table):
    start: float
    duration: float
    knot_period: float
    end: float | None = None
    home: float | None = None
    settle: float = 0.0
    via: tuple[_Via, ...] = ()

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

    def boundary(self) -> Boundary:
        """Return the boundary from rest to rest; without `end`, at any position."""
        low, high = (-math.inf, math.inf) if self.end is None else (self.end, self.end)
        rest = Via(1.0, (low, 0.0, 0.0), (high, 0.0, 0.0))
        return Boundary((self.start, 0.0, 0.0), (*(via.via() for via in self.via), rest))


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
    input: _Input
    servo: _Servo
    limits: _Limits
    motion: _Motion
    terms: tuple[
        _Inertia | _Viscous | _Coulomb | _Sign | _Constant | _Spring | _Gravity | _Cogging,
        ...,
    ] = ()
    disturbance: _Disturbance | None = None
    python: str | None = None
    wanted: dict[str, float] = {}
    log: _Log | None = None
    controller: _PD | _ARC | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        said = bool(self.terms), self.disturbance is not None
        if said != ((self.python is None),) * 2:
            raise ValueError(
                "the model must be given either by [[terms]] and [disturbance], or by `python`"
            )

    def system(self) -> System:
        """Return the system of the built-in terms and disturbance bound."""
        assert self.disturbance is not None
        inertias = [isinstance(kind, _Inertia) for kind in self.terms]
        if inertias != [True] + [False] * (len(inertias) - 1):
            kinds = ", ".join(str(kind.__struct_config__.tag) for kind in self.terms)
            raise ValueError(
                'the first of the [[terms]], and only this one, must have kind = "inertia", but '
                f"their kinds are {kinds}."
            )
        terms = tuple(kind.term() for kind in self.terms)
        return System(terms, self.disturbance.bound(), self.input.unit, self.coordinate)

    def targets(self, system: System) -> Float[Array, " m"]:
        """Return the required accuracy of each parameter, shape (m,); inf where none is required.

        Raises:
            ValueError: if a name is not a parameter, or an accuracy is not above zero.
        """
        _require_parameters("wanted", self.wanted, system)
        for name, error in self.wanted.items():
            if error <= 0:
                raise ValueError(f"`wanted.{name}` must be above zero, but is {error:g}.")
        return jnp.array([self.wanted.get(name, math.inf) for name in system.names])


def _require_parameters(table: str, names: Iterable[str], system: System) -> None:
    for name in names:
        if name not in system.names:
            raise ValueError(
                f"[{table}] must have names of parameters, {', '.join(system.names)}, but has "
                f"{name!r}."
            )
