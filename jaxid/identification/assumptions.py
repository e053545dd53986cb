"""The assumptions of guaranteed intervals, in sentences for reports."""

from collections.abc import Iterator, Sequence

from jaxid._checks import require_concrete, require_float64
from jaxid.loop.log import Log
from jaxid.model.system import System


def assumptions(system: System, *logs: Log, delay: int = 0) -> tuple[str, ...]:
    """Return the assumptions of the guaranteed intervals from logs, as sentences for reports.

    Args:
        system: axis with its prior box and disturbance bound δ.
        logs: logs that the intervals were computed from.
        delay: number of sample periods from a command until it acts; the logs already take it into
            account.

    Example:
        >>> jd.assumptions(slide, log)[1]
        'Everything unmodelled is at all times at most δ: 6 N.'
    """
    require_float64(system=system, logs=logs)
    require_concrete(
        "a sentence about it", "Call it outside of what is traced.", system=system, logs=logs
    )
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
    """Yield the assumptions on each servo once, with the largest jitter of its logs."""
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
