"""The assumptions of guaranteed intervals, in sentences for reports."""

from collections.abc import Iterator, Sequence

from jaxid._checks import require_concrete, require_float64
from jaxid._text import at_most, quantity
from jaxid.loop.log import Log
from jaxid.model.system import System

_ALIKE = 1.01  # largest ratio of two periods that count as those of one servo


def assumptions(system: System, *logs: Log, delay: int = 0) -> tuple[str, ...]:
    """Return the assumptions of the guaranteed intervals from logs, as sentences for reports.

    Args:
        system: axis with its prior box and disturbance bound δ.
        logs: logs that the intervals were computed from.
        delay: number of sample periods from a command until it acts; the logs already take it into
            account.

    Example:
        >>> jd.assumptions(slide, log)[2]
        'The sum Δ of all unmodelled effects never exceeds δ in magnitude: 6 N.'
    """
    require_float64(system=system, logs=logs)
    require_concrete(
        "a sentence about it", "Call it outside of what is traced.", system=system, logs=logs
    )
    length = "m" if system.coordinate == "linear" else "rad"
    box = ", ".join(
        f"{term.name} in [{float(low):.12g}, {float(high):.12g}] {term.unit}"
        for term, low, high in zip(system.terms, system.lower, system.upper, strict=True)
    )
    most = system.disturbance_bound.describe(system.input_unit, f"{length}/s")
    together = ("All logs are of one axis with the same parameters and the same zero of position.",)
    estimated = (
        f"The regressor of {name} is user-defined without slope bounds: its range was estimated "
        "from samples, so that these intervals are estimates, not guarantees."
        for name in system.estimated
    )
    return (
        f"The axis obeys {system.equation}, without any other term.",
        f"The prior intervals contain the true parameters: {box}.",
        f"The sum Δ of all unmodelled effects never exceeds δ in magnitude: {most}.",
        f"The input u is known exactly, scale and sign included, in {system.input_unit}.",
        *dict.fromkeys(_of_the_servos(logs, length, delay)),
        *(together if len(logs) > 1 else ()),
        *estimated,
    )


def _of_the_servos(logs: Sequence[Log], length: str, delay: int) -> Iterator[str]:
    """Yield the assumptions on each servo once, with the largest jitter of its logs."""
    periods = "sample period" if delay == 1 else "sample periods"
    late = f"acts {delay} {periods} after its command" if delay else "acts without delay"
    for servo in _by_servo(logs):
        shortest, longest = (f"{float(log.period):.4g}" for log in (servo[0], servo[-1]))
        period = quantity(float(shortest), "s")
        if longest != shortest:
            period = f"{period} to {quantity(float(longest), 's')}"
        half, jitter = float(servo[0].resolution) / 2, max(float(log.jitter) for log in servo)
        error = f"with an error of at most ±{quantity(half, length)}" if half > 0 else "exactly"
        yield (
            f"The input {late} and is held constant (zero-order hold) over each sample period of "
            f"{period}."
        )
        yield (
            f"The position is sampled at the start of each sample period, {error}; its scale is "
            "exact."
        )
        if jitter > 0:
            most = quantity(float(at_most(jitter)), "s")
            yield f"These instants deviate from equal spacing by at most {most}."


def _by_servo(logs: Sequence[Log]) -> Iterator[list[Log]]:
    """Yield the logs of each servo: those of equal resolution, with periods that differ by 1 %."""
    servo: list[Log] = []
    for log in sorted(logs, key=lambda log: (float(log.resolution), float(log.period))):
        if servo and (
            float(log.resolution) != float(servo[0].resolution)
            or float(log.period) > _ALIKE * float(servo[0].period)
        ):
            yield servo
            servo = []
        servo.append(log)
    if servo:
        yield servo
