"""Segments of a log: samples are equally spaced within the jitter, and the rows are named."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxid.io.recorded import Recorded
from jaxid.io.segments import rows_used, steady_segments

H, Q = 0.001, 1e-6


def recorded(time, seed=0):
    n = len(time)
    position, input = np.random.default_rng(seed).normal(size=(2, n))
    return Recorded(np.asarray(time), position, input)


def check(log, pieces, time, delay=0):
    """Check every property of the segments against the rows of the file."""
    for piece in pieces:
        one, first, last = piece.log, piece.first, piece.last
        n, jitter = one.samples, float(one.jitter)
        position, input = np.asarray(one.position), np.asarray(one.input)
        skipped = first + delay + (jitter > 0)
        assert n == last - skipped
        ticks = skipped + np.arange(n)
        assert np.array_equal(position[: n + 1], log.position[skipped : last + 1])
        assert np.array_equal(input[:n], log.input[ticks - delay])
        if jitter > 0:
            ends = [log.input[skipped - 1 - delay], log.input[last - delay]]
            assert np.array_equal(one.outer, ends)
        stamps = time[first : last + 1]
        steps = np.arange(len(stamps)) * float(one.period)
        missed = stamps - steps
        # with the best offset, equal steps miss no stamp by more than the jitter
        assert np.ptp(missed) / 2 <= jitter + 1e-12
        assert jitter <= 0.1 * float(one.period)
    rows = [k for piece in pieces for k in range(piece.first, piece.last + 1)]
    assert len(rows) == len(set(rows)) == rows_used(pieces)


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 1e-6, 0.01, 0.05, 0.09]),
    st.integers(0, 6),
    st.integers(0, 3),
    st.sampled_from([None, 90]),
)
def test_every_piece_is_steady(seed, share, events, delay, longest):
    """Gaps, repeated stamps, missing numbers and jitter occur at random rows."""
    random = np.random.default_rng(seed)
    n = 400
    steps = np.full(n - 1, H)
    steps[random.integers(0, n - 1, events)] = random.choice([0.0, 2.0, 7.3, -0.5, 0.3]) * H
    time = np.append(0.0, np.cumsum(steps)) + share * H * random.uniform(-1, 1, n)
    log = recorded(time, seed)
    missing = random.integers(0, n, events)
    log.position[missing[: events // 2]] = np.nan
    log.input[missing[events // 2 :]] = np.nan
    pieces = steady_segments(log, H, Q, delay, longest)
    check(log, pieces, time, delay)
    assert longest is None or max(p.last - p.first + 1 for p in pieces) <= longest
    assert all(np.isfinite(log.position[p.first : p.last + 1]).all() for p in pieces)
    if share < 0.05:  # an event costs only the few rows around it
        assert rows_used(pieces) >= n - 2 * events * (6 + delay)


def test_a_clock_without_jitter_has_none_and_its_log_is_whole():
    """Stamps with any start, and a period that differs by up to 0.5 %: rounding is not jitter."""
    for period, start in ((H, 0.0), (1.005 * H, 1234.5), (0.0002, 7.0)):
        time = start + period * np.arange(5000)
        (piece,) = steady_segments(recorded(time), round(period, 4), Q)
        assert (piece.first, piece.last, piece.log.outer) == (0, 4999, None)
        assert float(piece.log.jitter) == 0.0
        assert float(piece.log.period) == pytest.approx(period, rel=1e-12)
    (piece,) = steady_segments(Recorded(None, *recorded(time)[1:]), 0.0002, Q)
    assert float(piece.log.jitter) == 0.0


def test_a_clock_that_has_run_since_an_epoch_is_read_to_its_last_digit():
    """Stamps of 1.7e9 s are multiples of 0.24 µs.

    The jitter of the log covers the true instants.
    """
    n, period = 8192, 0.0002
    true = period * np.arange(n)
    (piece,) = steady_segments(recorded(1.7e9 + true), period, Q)
    assert rows_used([piece]) == n
    log = piece.log
    assert 0 < float(log.jitter) < 2.4e-7
    read = float(log.period) * (np.arange(n) - (n - 1) / 2)
    off = read - (true - true.mean())
    assert np.max(np.abs(off)) <= float(log.jitter)


@given(st.integers(0, 2**32 - 1))
def test_what_coarse_stamps_may_hide_counts_as_jitter(seed):
    """The instants deviate by up to 1.1e-7 s from equal steps.

    Rounded time stamps since an epoch do not show this, but the jitter covers it.
    """
    n, period = 400, 2.0**-12
    off = np.random.default_rng(seed).uniform(-1.1e-7, 1.1e-7, n)
    (piece,) = steady_segments(recorded(2.0**30 + 2.0**29 + period * np.arange(n) + off), period, Q)
    log = piece.log
    read = float(log.period) * (np.arange(n) - (n - 1) / 2)
    true = period * (np.arange(n) - (n - 1) / 2) + off
    assert np.ptp(true - read) / 2 <= float(log.jitter)


def test_a_clock_that_drifts_is_cut_where_it_must_be():
    """A period that changes by 1 % gives several segments, each with a nearly constant period."""
    time = np.append(0.0, np.cumsum(np.linspace(0.995, 1.005, 4000) * H))
    log = recorded(time)
    pieces = steady_segments(log, H, Q)
    check(log, pieces, time)
    assert 4 <= len(pieces) <= 64
    assert rows_used(pieces) > 3900


def test_what_no_servo_of_this_period_can_have_left_is_refused():
    with pytest.raises(ValueError, match=r"no 5 consecutive samples that are 1 ms"):
        steady_segments(recorded(np.cumsum(np.tile([1.0, 1.0, 1.0, 0.5, 1.5], 60) * H)), H, Q)
    with pytest.raises(ValueError, match=r"every 1 s, but .* 1 ms.*unit of time is probably wrong"):
        steady_segments(recorded(np.arange(100.0)), H, Q)
    with pytest.raises(ValueError, match=r"every 2 ms, but .*or correct `servo.period`\.$"):
        steady_segments(recorded(2 * H * np.arange(100)), H, Q)
    with pytest.raises(ValueError, match="no two rows with increasing time stamps"):
        steady_segments(recorded(np.zeros(100)), H, Q)
