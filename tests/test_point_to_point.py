"""The approach from home to the start: exact, at half of the limits, without overshoot."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.axes import linear_motor as motor
from jaxid.motion.limits import Boundary, Limits
from jaxid.motion.point_to_point import approach, joined, wait
from jaxid.motion.violation import worst_violation

ends = st.tuples(st.floats(0.1, 10.0), st.floats(0.1, 10.0)).map(lambda x: (-x[0], x[1]))


def integrated(start, jerk, period):
    """Return the states by a NumPy loop with ten steps per interval."""
    y, v, a, h = start, 0.0, 0.0, period / 10
    states = [(y, v, a)]
    for j in np.repeat(jerk, 10):
        y, v, a = y + h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j
        states.append((y, v, a))
    return np.array(states)


@settings(max_examples=25, deadline=None)
@given(ends, ends, ends, st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.floats(0.02, 0.5))
def test_an_approach_is_gentle_and_stays_on_its_way(
    velocity, acceleration, jerk, home, start, period
):
    limits = Limits((-1.0, 1.0), velocity, acceleration, jerk, (-1.0, 1.0))
    found = approach(limits, home, start, period)
    states = integrated(home, np.asarray(found.jerk), period)
    scale = 1e-9 * max(1.0, float(found.duration)) ** 2
    np.testing.assert_allclose(states[-1], [start, 0.0, 0.0], atol=scale)
    assert states[:, 0].min() >= min(home, start) - scale
    assert states[:, 0].max() <= max(home, start) + scale
    for values, interval in zip(
        (states[:, 1], states[:, 2], np.asarray(found.jerk)),
        (velocity, acceleration, jerk),
        strict=True,
    ):
        assert np.all(np.abs(values) <= min(map(abs, interval)) / 2 + scale)


def test_no_shorter_one_is_as_gentle():
    """The duration is at most five intervals above the optimum in continuous time.

    The exact extrema keep all limits.
    """
    limits, period = motor.limits(), 0.001
    found = approach(limits, 0.35, 0.0, period)
    assert worst_violation(limits, Boundary((0.35, 0.0, 0.0), ()), found) < 0
    # optimum: distance / v + v / a + a / j, at 1 m/s, 22.2 m/s² and 500 m/s³
    a = float(limits.acceleration[1]) / 2
    assert 0 <= float(found.duration) - (0.35 / 1.0 + 1.0 / a + a / 500) < 5 * period


def test_motions_one_after_another():
    move, rest = approach(motor.limits(), 0.2, 0.0, 0.01), wait(0.0, 3, 0.01)
    whole = joined(move, rest)
    assert float(whole.duration) == pytest.approx(float(move.duration) + 0.03)
    assert approach(motor.limits(), 0.2, 0.2, 0.01).jerk.size == 0
    with pytest.raises(ValueError, match=r"one ends in .* and the next begins in"):
        joined(move, wait(0.1, 2, 0.01))
    with pytest.raises(
        ValueError, match=r"`home` = .* is outside the position limits \[-0.01, 0.4\]"
    ):
        approach(motor.limits(), 0.5, 0.0, 0.01)
