"""Reliable times on a machine with other load: interleaved repetitions, minima and medians."""

import statistics
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax

Action = Callable[[], object]


class Times(NamedTuple):
    """The times of one action in s, one per repetition, interleaved with those of other actions."""

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
    """The ratio of two times: of their minima, and of their medians."""

    least: float
    median: float


def ratio(above: Times, below: Times, scale: float = 1.0) -> Ratio:
    """Return `scale` times the ratio of two times."""
    return Ratio(scale * above.least / below.least, scale * above.median / below.median)


def interleaved(actions: Mapping[str, Action], repetitions: int) -> dict[str, Times]:
    """Return the times of all actions, run in turn `repetitions` times after one warm-up."""
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for action in actions.values():
        action()
    for _ in range(repetitions):
        for name, action in actions.items():
            seconds[name].append(timed(action))
    return {name: Times(tuple(values)) for name, values in seconds.items()}


def timed(action: Action) -> float:
    """Return the seconds until the result of an action is there."""
    begin = time.perf_counter()
    jax.block_until_ready(action())
    return time.perf_counter() - begin
