"""Objects of the library from the tables of an axis file."""

import math
from collections.abc import Iterable, Mapping

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid.axis import schema
from jaxid.io.recorded import Columns
from jaxid.loop.controllers import ARC, Controller, PDFeedforward
from jaxid.model.disturbance_bound import ConstantBound, DisturbanceBound, SpeedBand
from jaxid.model.regressors import Constant, Coulomb, OneWay, Regressor, Sign, Sine, Spring, Viscous
from jaxid.model.system import System, Term
from jaxid.motion.acceleration_limit import acceleration_limit
from jaxid.motion.limits import Boundary, Limits, Via

_LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "rev": 2 * math.pi}
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def system_of(tables: schema.AxisTables) -> System:
    """Return the system of the terms and the disturbance bound of an axis file.

    Raises:
        ValueError: if the first term, and only this one, is not an inertia, or an entry of the
            disturbance bound is missing.
    """
    assert tables.disturbance is not None
    inertias = [isinstance(kind, schema.Inertia) for kind in tables.terms]
    if inertias != [True] + [False] * (len(inertias) - 1):
        kinds = ", ".join(str(kind.__struct_config__.tag) for kind in tables.terms)
        raise ValueError(
            'the first of the [[terms]], and only this one, must have kind = "inertia", but '
            f"their kinds are {kinds}."
        )
    terms = tuple(Term(x.name, x.unit, x.interval, _regressor(x)) for x in tables.terms)
    return System(terms, _bound(tables.disturbance), tables.input.unit, tables.coordinate)


def _regressor(kind: schema.Kind) -> Regressor | None:
    """Return the regressor of a term; None for the inertia."""
    match kind:
        case schema.Inertia():
            return None
        case schema.Constant():
            return Constant()
        case schema.Spring():
            return Spring(kind.rest)
        case schema.Gravity():
            return Sine(kind.phase)
        case schema.Cogging():
            return Sine(kind.phase, kind.pitch / kind.harmonic)
        case schema.Friction(direction="both"):
            return _friction(kind)
        case schema.Friction():
            return OneWay(_friction(kind), kind.direction == "forward")
    raise TypeError(f"there is no regressor for {kind}")


def _friction(kind: schema.Friction) -> Regressor:
    if isinstance(kind, schema.Coulomb):
        return Coulomb(kind.beta)
    return Viscous() if isinstance(kind, schema.Viscous) else Sign()


def _bound(table: schema.Disturbance) -> DisturbanceBound:
    if table.slow is None and table.threshold is None:
        return ConstantBound(table.level)
    if table.slow is None or table.threshold is None:
        raise ValueError("[disturbance] must have both `slow` and `threshold`, or neither")
    return SpeedBand(table.slow, table.level, table.threshold)


def limits_of(table: schema.Limits, system: System, input: schema.Input) -> Limits:
    """Return the limits, in the unit of the input.

    Args:
        table: table [limits].
        system: system of the axis, whose input limits the acceleration if the table does not.
        input: table [input].
    """
    rate = None if table.input_rate is None else input.pushed(table.input_rate)
    box = {"position": table.position, "velocity": table.velocity}
    pushed = input.pushed(table.input)
    acceleration = table.acceleration
    if acceleration is None:
        acceleration = acceleration_limit(system, **box, input=pushed)
    return Limits(**box, acceleration=acceleration, jerk=table.jerk, input=pushed, input_rate=rate)


def boundary_of(motion: schema.Motion) -> Boundary:
    """Return the boundary of a motion from rest to rest; without `end`, at any position."""
    low, high = (-math.inf, math.inf) if motion.end is None else (motion.end, motion.end)
    rest = Via(1.0, (low, 0.0, 0.0), (high, 0.0, 0.0))
    return Boundary((motion.start, 0.0, 0.0), (*map(_via, motion.via), rest))


def _via(table: schema.Via) -> Via:
    low, high = (-math.inf, -math.inf), (math.inf, math.inf)
    lower = -math.inf if table.lower is None else table.lower
    upper = math.inf if table.upper is None else table.upper
    return Via(table.at, (lower, *low), (upper, *high))


def controller_of(law: schema.PD | schema.ARC, system: System) -> Controller:
    """Return the controller of a table [controller].

    Raises:
        ValueError: if an adaptation rate is not that of a parameter.
    """
    if isinstance(law, schema.PD):
        return PDFeedforward(system, system.centre, law.kp, law.kd)
    _require_parameters("controller.gamma", law.gamma, system)
    gamma = jnp.array([law.gamma.get(name, 0.0) for name in system.names])
    return ARC(system, law.k1, law.k2, law.epsilon, gamma)


def columns_of(log: schema.Log, coordinate: schema.Coordinate, gain: float) -> Columns:
    """Return the columns of a log, with the input in the unit of the axis.

    Args:
        log: table [log].
        coordinate: coordinate of the axis, for the units of its position.
        gain: gain of the input.

    Raises:
        ValueError: if a unit is unknown.
    """
    lengths = _LENGTHS if coordinate == "linear" else _ANGLES
    position = _unit("position_unit", log.position_unit, lengths)
    time = _unit("time_unit", log.time_unit, _TIMES)
    input = gain * _unit("input_unit", log.input_unit, {})
    return Columns(log.position, log.input, log.time, position, input, time)


def _unit(name: str, unit: str | float, named: Mapping[str, float]) -> float:
    found = named.get(unit) if isinstance(unit, str) else unit
    if not found:
        right = ", ".join([*named, "or a number above zero"])
        raise ValueError(f"`log.{name}` must be {right}, but is {unit!r}.")
    return found


def targets_of(wanted: Mapping[str, float], system: System) -> Float[Array, " m"]:
    """Return the required accuracy of each parameter, shape (m,); inf where none is required.

    Args:
        wanted: table [wanted]: accuracies by the names of parameters, in their units.
        system: system with m parameters.

    Raises:
        ValueError: if a name is not a parameter, or an accuracy is not above zero.
    """
    _require_parameters("wanted", wanted, system)
    for name, error in wanted.items():
        if error <= 0:
            raise ValueError(f"`wanted.{name}` must be above zero, but is {error:g}.")
    return jnp.array([wanted.get(name, math.inf) for name in system.names])


def _require_parameters(table: str, names: Iterable[str], system: System) -> None:
    for name in names:
        if name not in system.names:
            raise ValueError(
                f"[{table}] must have names of parameters, {', '.join(system.names)}, but has "
                f"{name!r}."
            )
