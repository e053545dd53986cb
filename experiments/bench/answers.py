"""One line of the table that `make bench` prints."""

from typing import NamedTuple

from experiments.bench.timing import Ratio, Times, ratio


class Answer(NamedTuple):
    """A number beside its target.

    Attributes:
        question: the module that asks.
        case: what was run.
        quantity: what the number is.
        least: from the minima of the interleaved repetitions.
        median: from their medians; None where nothing was repeated.
        target: to be met by `least`; None where the number is only reported.
    """

    question: str
    case: str
    quantity: str
    least: float
    median: float | None = None
    target: tuple[str, float] | None = None

    @property
    def met(self) -> bool | None:
        """Whether the target is met."""
        if self.target is None:
            return None
        side, bound = self.target
        return self.least <= bound if side == "<=" else self.least >= bound


AT_MOST, AT_LEAST = "<=", ">="


def per_step(question: str, case: str, times: Times, steps: int) -> Answer:
    """Nanoseconds per plant and tick: to look at, since they depend on the machine."""
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
    """`scale` times the first of two times over the second."""
    found: Ratio = ratio(*pair, scale)
    return Answer(question, case, quantity, found.least, found.median, target)
