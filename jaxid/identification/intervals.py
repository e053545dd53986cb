"""Guaranteed intervals of the parameters by one fixed linear estimator, with encoder and servo.

The weights are chosen without the inputs. Data that are inconsistent with the disturbance bound are
not detected here; `jaxid.identify` tests that first.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.identification.joined_rows import rows_of_logs
from jaxid.identification.modulating_functions import KNOTS, Knots, modulating
from jaxid.identification.regression_rows import RegressionRows, guaranteed_estimate
from jaxid.loop.log import InconsistentLogError, Log
from jaxid.model.system import System
from jaxid.regression.estimate import Estimate

# passes over the logs, each with the box of the pass before; a third one gains nothing
PASSES = 2


class GuaranteedIntervals(NamedTuple):
    """Intervals that contain θ if the logs are consistent with the system.

    Attributes:
        estimate: estimate by optimal modulating functions. Its prior box is the one left by the
            pass before; of several logs, the intersection of the intervals of all and of each
            alone.
        rows: regression rows of the last pass, for other estimators.
    """

    estimate: Estimate
    rows: RegressionRows


def guaranteed_intervals(
    system: System, logs: Sequence[Log], knots: Knots = KNOTS
) -> GuaranteedIntervals:
    """Return intervals of θ from logs that are known to be consistent with the system.

    A smaller box gives tighter bounds of the motion behind a log, and a log makes the box smaller:
    all logs are used together with the box that each of them leaves alone. No bound and no interval
    is wider than that of any log alone. If |Δ| ≤ δ does not hold for the logs, the intervals are
    wrong, usually without any sign of it: `jaxid.identify` tests δ first.

    Args:
        system: axis with the prior box and δ that the intervals assume.
        logs: logs of one axis; sample periods and encoders may differ.
        knots: largest number of weights per log: one number for all, or one per log.

    Raises:
        InconsistentLogError: if an interval is empty.
        ValueError: if no log has two samples or more.
    """
    require(
        any(log.input.size > 1 for log in logs),
        f"Argument `logs` must hold one log at least of two ticks or more, but holds {len(logs)} "
        "that have fewer.",
    )
    each = knots if isinstance(knots, tuple) else (knots,) * len(logs)
    several = zip(logs, each, strict=True) if len(logs) > 1 else ()
    alone = [_passes(system, system, [x], own).estimate for x, own in several if x.input.size > 1]
    narrow = narrowed(system, *alone) if alone else system
    together = _passes(narrow, system, logs, knots)
    return GuaranteedIntervals(tightest([together.estimate, *alone]), together.rows)


def _passes(
    narrow: System, system: System, logs: Sequence[Log], knots: Knots
) -> GuaranteedIntervals:
    """Return the intervals from all logs as one set of rows, by passes with smaller boxes."""
    found = _once(narrow, system, logs, knots)
    for _ in range(PASSES - 1):
        found = _once(narrowed(system, found.estimate), system, logs, knots)
    narrowed(system, found.estimate)  # refuses empty intervals
    return found


def _once(narrow: System, system: System, logs: Sequence[Log], knots: Knots) -> GuaranteedIntervals:
    rows = rows_of_logs(narrow, logs)
    weights = modulating(rows, system.half_widths, knots=knots)
    return GuaranteedIntervals(guaranteed_estimate(rows, weights), rows)


def tightest(found: Sequence[Estimate]) -> Estimate:
    """Return for each parameter the estimate of the smallest bound, with the intersected boxes.

    Args:
        found: estimates of the same parameters.
    """
    if len(found) == 1:
        return found[0]
    theta, bound = (jnp.stack(x) for x in zip(*((e.theta, e.bound) for e in found), strict=True))
    least = jnp.argmin(bound, axis=0), jnp.arange(bound.shape[1])
    return Estimate(theta[least], bound[least], *_common(found))


def narrowed(system: System, *found: Estimate) -> System:
    """Return the system with the intersection of the intervals of all estimates as its prior box.

    Raises:
        InconsistentLogError: if the intersection is empty.
    """
    return narrowed_to(system, *_common(found))


def narrowed_to(system: System, lower: Float[Array, " m"], upper: Float[Array, " m"]) -> System:
    """Return the system with another prior box.

    Args:
        system: axis.
        lower: lower ends of the box, shape (m,), in the units of the parameters.
        upper: upper ends of the box, shape (m,), in the units of the parameters.

    Raises:
        InconsistentLogError: if an interval is empty.
    """
    for name, low, high in zip(system.names, lower, upper, strict=True):
        require(
            float(low) <= float(high),
            f"Argument `logs` requires {name} ≥ {float(low):.6g}, but the prior interval of {name} "
            f"and the earlier data allow only {name} ≤ {float(high):.6g}.",
            InconsistentLogError,
        )
    return system.with_box(lower, upper)


def _common(found: Sequence[Estimate]) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
    lower = functools.reduce(jnp.maximum, [one.lower for one in found])
    upper = functools.reduce(jnp.minimum, [one.upper for one in found])
    return lower, upper
