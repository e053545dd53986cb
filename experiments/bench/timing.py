"""Fair times on a machine that stalls: all interleaved, minima first, medians beside them."""

import statistics
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax

Action = Callable[[], object]


class Times(NamedTuple):
    """Seconds that one action took, repetition by repetition; interleaved with the others'."""

    seconds: tuple[float, ...]

    @property
    def least(self) -> float:
        """The shortest measured time, s: the one that other processes disturbed least."""
        return min(self.seconds)

    @property
    def median(self) -> float:
        """The median of the measured times, s."""
        return statistics.median(self.seconds)


class Ratio(NamedTuple):
    """One time over another: of their minima, and of their medians."""

    least: float
    median: float


def ratio(above: Times, below: Times, scale: float = 1.0) -> Ratio:
    """`scale` times above / below."""
    return Ratio(scale * above.least / below.least, scale * above.median / below.median)


def interleaved(actions: Mapping[str, Action], repetitions: int) -> dict[str, Times]:
    """Every action once to warm up, then all of them in turn, `repetitions` times."""
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for action in actions.values():
        action()
    for _ in range(repetitions):
        for name, action in actions.items():
            seconds[name].append(timed(action))
    return {name: Times(tuple(values)) for name, values in seconds.items()}


def timed(action: Action) -> float:
    """Seconds until the result is there."""
    begin = time.perf_counter()
    jax.block_until_ready(action())
    return time.perf_counter() - begin
