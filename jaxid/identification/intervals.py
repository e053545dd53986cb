"""From a log to intervals that hold for the axis in continuous time, encoder and servo included."""

import functools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.identification.joined_rows import rows_of_logs
from jaxid.identification.modulating_functions import KNOTS, Knots, modulating
from jaxid.identification.regression_rows import RegressionRows, guaranteed_estimate
from jaxid.loop.log import InconsistentLogError, Log
from jaxid.model.system import System
from jaxid.regression.estimate import Estimate

# of reading the log with the box that the round before left; a third one gains nothing
ROUNDS = 2


class Guarantee(NamedTuple):
    """What a log proves.

    Attributes:
        estimate: by optimal modulating functions, its box that which the round before left, or
            each of several logs: the intervals are inside everything known before.
        logged: the rows of the last round, for other estimators.
    """

    estimate: Estimate
    logged: RegressionRows


def identify_log(system: System, log: Log, knots: int = KNOTS) -> Guarantee:
    """Intervals for θ of every plant of a system that can have left a log.

    Args:
        system: its box and δ, which the intervals rest on.
        log: inputs as held, positions as read.
        knots: of the modulating functions, at most.

    Raises:
        ContradictionError: if no plant of the system can have left the log.
    """
    return identify_logs(system, [log], knots)


def identify_logs(system: System, logs: Sequence[Log], knots: Knots = KNOTS) -> Guarantee:
    """Intervals for θ of every plant of a system that can have left all of several logs.

    The brackets of the motion are the narrower the smaller the box is, and a log makes the box
    smaller: all are read together with the box that each has left alone. No bound and no interval
    is wider than that of any log alone.

    Args:
        system: its box and δ, which the intervals rest on.
        logs: of the same axis; their periods and encoders may differ.
        knots: of the modulating functions, at most, for each log: one number, or one of each.

    Raises:
        ContradictionError: if no plant of the system can have left the logs.
    """
    require(
        any(log.input.size > 1 for log in logs),
        f"Argument `logs` must hold one log at least of two ticks or more, but holds {len(logs)} "
        "that have fewer.",
    )
    each = knots if isinstance(knots, tuple) else (knots,) * len(logs)
    several = zip(logs, each, strict=True) if len(logs) > 1 else ()
    alone = [_read(system, system, [x], own).estimate for x, own in several if x.input.size > 1]
    narrow = narrowed(system, *alone) if alone else system
    together = _read(narrow, system, logs, knots)
    return Guarantee(best([together.estimate, *alone]), together.logged)


def _read(narrow: System, system: System, logs: Sequence[Log], knots: Knots) -> Guarantee:
    """All logs as the rows of one, read again with the box that the first reading leaves."""
    found = _once(narrow, system, logs, knots)
    for _ in range(ROUNDS - 1):
        found = _once(narrowed(system, found.estimate), system, logs, knots)
    narrowed(system, found.estimate)  # refuses what nothing can have left
    return found


def _once(narrow: System, system: System, logs: Sequence[Log], knots: Knots) -> Guarantee:
    logged = rows_of_logs(narrow, logs)
    weights = modulating(logged, system.half_widths, knots=knots)
    return Guarantee(guaranteed_estimate(logged, weights), logged)


def best(found: Sequence[Estimate]) -> Estimate:
    """Of each parameter the one with the least bound; what all intervals have in common."""
    if len(found) == 1:
        return found[0]
    theta, bound = (jnp.stack(x) for x in zip(*((e.theta, e.bound) for e in found), strict=True))
    least = jnp.argmin(bound, axis=0), jnp.arange(bound.shape[1])
    lower = functools.reduce(jnp.maximum, [one.lower for one in found])
    upper = functools.reduce(jnp.minimum, [one.upper for one in found])
    return Estimate(theta[least], bound[least], lower, upper)


def assumptions(system: System, *logs: Log, delay: int = 0) -> tuple[str, ...]:
    """What the intervals from logs rest on: sentences to print beside them.

    Args:
        system: with the prior box.
        logs: that were read, alone or together.
        delay: periods until a command acts, which the logs count already.
    """
    length = "m" if system.coordinate == "linear" else "rad"
    box = ", ".join(
        f"{term.name} in [{float(low):g}, {float(high):g}] {term.unit}"
        for term, low, high in zip(system.terms, system.lower, system.upper, strict=True)
    )
    most = system.disturbance_bound.describe(system.input_unit, f"{length}/s")
    together = ("All logs are of one axis, whose parameters and zero of position stayed the same.",)
    estimated = (
        f"What multiplies {name} is estimated by samples: its slopes were not bounded."
        for name in system.estimated
    )
    return (
        f"The box: {box}.",
        f"Everything unmodelled is at all times at most δ: {most}.",
        *dict.fromkeys(_of_the_servos(logs, length, delay)),
        *(together if len(logs) > 1 else ()),
        *estimated,
    )


def _of_the_servos(logs: Sequence[Log], length: str, delay: int) -> Iterator[str]:
    """Of each servo once, with the largest jitter of its logs."""
    jitters: dict[tuple[str, float], float] = {}
    for log in logs:
        servo = f"{float(log.period):.4g}", float(log.resolution) / 2
        jitters[servo] = max(jitters.get(servo, 0.0), float(log.jitter))
    late = f"{delay} periods later" if delay else "without delay"
    for (period, half), jitter in jitters.items():
        encoder = f"to {half:.4g} {length}" if half > 0 else "exactly"
        steady = f"; both up to {jitter:.4g} s too early or too late" if jitter > 0 else ""
        yield f"The input acts as commanded, {late}, and is held for {period} s."
        yield f"The encoder reads the position at the beginning of each hold, {encoder}{steady}."


def narrowed(system: System, *found: Estimate) -> System:
    """The system with what the intervals of all estimates have in common for its box.

    Raises:
        ContradictionError: if they have nothing.
    """
    lower = functools.reduce(jnp.maximum, [one.lower for one in found])
    upper = functools.reduce(jnp.minimum, [one.upper for one in found])
    return within(system, lower, upper)


def within(system: System, lower: Float[Array, " m"], upper: Float[Array, " m"]) -> System:
    """The system with another box.

    Raises:
        ContradictionError: if an interval is empty.
    """
    for name, low, high in zip(system.names, lower, upper, strict=True):
        require(
            float(low) <= float(high),
            f"Argument `log`: no {name} in its prior interval can have left it; the box, δ or the "
            f"resolution is too small (the data ask for {name} from {float(low):.6g} on, the box "
            f"and the data before allow it up to {float(high):.6g}). `smallest_factor` says by how "
            "much δ is.",
            InconsistentLogError,
        )
    ends = [jnp.stack(pair) for pair in zip(lower, upper, strict=True)]
    return eqx.tree_at(lambda s: [term.interval for term in s.terms], system, ends)
