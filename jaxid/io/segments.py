"""Segments of a recorded log: each has rows one sample period apart, and is a `Log`."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxid._checks import require
from jaxid._text import quantity
from jaxid.io.recorded import Recorded
from jaxid.loop.log import JITTER, Log

_LEAST = 4  # smallest number of samples of a segment
_CLOCKS = 0.01  # relative difference that two clocks may have
_NEGLIGIBLE = 1e-6  # of a period: rounding of time stamps that is ignored
_ROUNDINGS = 4  # rounding errors of a time stamp and of its differences


class Segment(NamedTuple):
    """A segment of a log file: consecutive rows that are one sample period apart.

    Attributes:
        first: first row in the file, from 0.
        last: last row in the file, from 0.
        log: these rows as a log.
    """

    first: int
    last: int
    log: Log


def steady_segments(
    recorded: Recorded,
    period: float,
    resolution: float,
    delay: int = 0,
    longest: int | None = None,
) -> tuple[Segment, ...]:
    """Return all segments of a log whose time stamps are equally spaced to a tenth of the period.

    A segment ends, and another begins, where a row is missing, repeated, late or without a number.
    The deviation of its time stamps from equal spacing is the jitter of a segment.

    Args:
        recorded: rows of a log file.
        period: sample period of the servo, s.
        resolution: encoder resolution, m or rad.
        delay: number of sample periods from a command until it acts.
        longest: largest number of rows of a segment; default any number.

    Raises:
        ValueError: if no segment is long enough, or the rows are not a sample period apart.
    """
    n = recorded.position.size
    time = np.arange(n) * period if recorded.time is None else recorded.time
    whole = np.isfinite(time) & np.isfinite(recorded.position) & np.isfinite(recorded.input)
    _require_clock(time[whole], period)
    steps = np.diff(time)
    close = whole[1:] & whole[:-1] & (np.abs(steps - period) <= 2 * JITTER * period)
    found = [
        _piece(recorded, time, part, resolution, delay)
        for whole_run in _runs(close)
        for run in _cut(whole_run, longest)
        for part in _straight(time, run)
        if part[1] - part[0] - delay > _LEAST
    ]
    require(
        bool(found),
        f"Argument `recorded` has no {_LEAST + 1 + delay} consecutive samples that are "
        f"{quantity(period, 's')} ± {JITTER:.0%} apart, among {n} rows. Check `time_unit`, "
        "`servo.period` and missing samples.",
    )
    return tuple(found)


def _require_clock(time: Float[np.ndarray, " n"], period: float) -> None:
    forward = np.diff(time)
    forward = forward[forward > 0]
    require(forward.size > 0, "Argument `recorded` has no two rows with increasing time stamps.")
    usual = float(np.median(forward))
    thousands = round(np.log10(usual / period) / 3)
    hint = " The unit of time is probably wrong (`log.time_unit`)." if thousands else ""
    require(
        abs(usual / period - 1) <= _CLOCKS,
        f"Argument `recorded` is sampled every {quantity(float(f'{usual:.6g}'), 's')}, but "
        f"`servo.period` is {quantity(period, 's')}. Log every servo period, since the input of "
        f"each hold interval is needed, or correct `servo.period`.{hint}",
    )


def _runs(close: Bool[np.ndarray, " steps"]) -> Iterator[tuple[int, int]]:
    """Yield the first row and the one after the last of all rows close to the one before."""
    edges = np.diff(np.pad(close, 1).astype(int))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return zip(starts.tolist(), (stops + 1).tolist(), strict=True)


def _cut(run: tuple[int, int], longest: int | None) -> Iterator[tuple[int, int]]:
    """Yield equal parts of a run; the sample between two of them belongs to neither."""
    first, stop = run
    count = 1 if longest is None else -(-(stop - first) // longest)
    edges = np.linspace(first, stop, count + 1).round().astype(int).tolist()
    return pairwise(edges)


def _straight(time: Float[np.ndarray, " n"], run: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """Yield a run, halved until its stamps are equally spaced to the permitted jitter."""
    first, stop = run
    if stop - first > _LEAST:
        period, missed = _clock(time[first:stop])
        if missed <= JITTER * period:
            yield run
            return
        middle = (first + stop) // 2
        yield from _straight(time, (first, middle))
        yield from _straight(time, (middle, stop))


def _clock(time: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Return the period of time stamps, and their largest deviation from equal spacing.

    Rounding alone is no deviation, unless stamps are so coarse that it may hide some.
    """
    ticks, since = np.arange(time.size) - (time.size - 1) / 2, time - time[0]
    period = float(ticks @ since / (ticks @ ticks))
    rest = since - period * ticks
    missed, spacing = float(np.ptp(rest) / 2), float(np.spacing(np.max(np.abs(time))))
    if _ROUNDINGS * spacing > _NEGLIGIBLE * period:
        return period, missed + spacing / 2
    return period, missed if missed > _ROUNDINGS * spacing else 0.0


def _piece(
    recorded: Recorded,
    time: Float[np.ndarray, " n"],
    part: tuple[int, int],
    resolution: float,
    delay: int,
) -> Segment:
    first, stop = part
    period, jitter = _clock(time[first:stop])
    # NumPy: JAX would compile each operation for each length
    position = recorded.position[first + delay : stop]
    acting = recorded.input[first : stop - delay]  # one more than sample periods
    if jitter == 0:
        return Segment(first, stop - 1, Log(acting[:-1], position, period, resolution))
    outer = acting[[0, -1]]  # the first period may hold an unknown input
    log = Log(acting[1:-1], position[1:], period, resolution, jitter, outer)
    return Segment(first, stop - 1, log)


def rows_used(pieces: Sequence[Segment]) -> int:
    """Return the number of file rows in all segments together."""
    return sum(piece.last - piece.first + 1 for piece in pieces)
