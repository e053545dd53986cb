"""The rows of the table that `make bench` prints."""

from typing import NamedTuple

from experiments.bench.timing import Ratio, Times, ratio


class Answer(NamedTuple):
    """A benchmark result beside its target.

    Attributes:
        question: name of the benchmark's module.
        case: description of the case that was run.
        quantity: name of the number, with its unit.
        least: number from the minimum times of the interleaved repetitions.
        median: number from the median times; None if nothing was repeated.
        target: comparison and number that `least` is to meet; None if the number is only reported.
    """

    question: str
    case: str
    quantity: str
    least: float
    median: float | None = None
    target: tuple[str, float] | None = None

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None if there is no target."""
        if self.target is None:
            return None
        side, bound = self.target
        return self.least <= bound if side == "<=" else self.least >= bound


AT_MOST, AT_LEAST = "<=", ">="


def per_step(question: str, case: str, times: Times, steps: int) -> Answer:
    """Return the nanoseconds per plant and sample period, without a target.

    They depend on the machine.
    """
    return Answer(
        question, case, "ns per step", 1e9 * times.least / steps, 1e9 * times.median / steps
    )


def compared(
    question: str,
    case: str,
    quantity: str,
    pair: tuple[Times, Times],
    target: tuple[str, float] | None = None,
    scale: float = 1.0,
) -> Answer:
    """Return `scale` times the ratio of two times, with its target."""
    found: Ratio = ratio(*pair, scale)
    return Answer(question, case, quantity, found.least, found.median, target)
