"""State bounds step by step: each range contains the worst case, which attains its ends."""

import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.identification.state_bounds import (
    _around_samples,
    _between,
    _from_windows,
    _swept,
    _top_speed,
    _within,
    accelerations,
    state_bounds,
)
from jaxid.loop.log import Log
from jaxid.model.disturbance_bound import ConstantBound, SpeedBand
from jaxid.model.interval_arithmetic import Range, around, exactly
from jaxid.model.regressors import Constant, Viscous
from jaxid.model.system import System, Term

H, Q = 0.01, 2e-3
# only constant forces: the acceleration is constant in each sample period
PUSHED = System(
    (Term("m", "kg", (1.0, 2.0)), Term("d", "N", (-1.0, 1.5), Constant())), ConstantBound(0.5)
)
CORNERS = list(itertools.product((1.0, 2.0), (-1.0, 1.5)))


def states_at(a, v=0.0, y=0.0, h=H):
    """Return position and velocity at the samples, for a constant acceleration in each period."""
    v = v + np.append(0.0, np.cumsum(a * h))
    return y + np.append(0.0, np.cumsum((v[:-1] + v[1:]) / 2 * h)), v


def holds(found, values, slack=1e-12):
    lower, upper = map(np.asarray, found)
    return np.all(lower - slack <= values) and np.all(values <= upper + slack)


def test_velocities_of_windows_hold_for_all_readings_and_accelerations():
    """Four periods of 1 s, with all signs of the reading errors and with extreme accelerations."""
    n, random = 4, np.random.default_rng(0)
    windows = eqx.filter_jit(lambda y, a, e: _from_windows(Log(jnp.zeros(n), y, 1.0, 0.0), a, e))
    for signs in itertools.product((-1.0, 1.0), repeat=n + 1):
        for _ in range(4):
            lower = random.uniform(-2.0, 1.0, n)
            upper, e = lower + random.uniform(0.0, 3.0, n), random.uniform(0.0, 2.0, n + 1)
            y, v = states_at(np.where(random.uniform(size=n) < 0.5, lower, upper), 0.3, h=1.0)
            found = windows(jnp.asarray(y + signs * e), Range(lower, upper), jnp.asarray(e))
            assert holds(found, v)


@pytest.mark.parametrize("at", [0, 1, 2])
def test_velocities_of_windows_are_reached(at):
    """With three samples, the ranges equal the largest velocities by hand."""
    A, e, h = 3.0, 0.02, 0.1
    log = Log(jnp.zeros(2), jnp.zeros(3), h, 0.0)
    found = _from_windows(log, around(jnp.full(2, A)), jnp.full(3, e))
    one, two = 2 * e / h + h * A / 2, 2 * e / (2 * h) + h * A
    # both periods around the middle sample may curve the path in the same direction
    both = 2 * e / (2 * h) + h * A / 2
    expected = min(one, both) if at == 1 else min(one, two)
    np.testing.assert_allclose(found.upper[at], expected, rtol=1e-12)
    np.testing.assert_allclose(found.lower[at], -expected, rtol=1e-12)


def test_what_one_sample_says_of_all_others_is_reached():
    """The velocity is known at one sample; accelerations before and after it are extreme."""
    lower, upper = np.array([-1.0, -2.0, 0.5, -3.0]), np.array([2.0, 1.0, 1.5, 4.0])
    unknown = around(jnp.full(5, jnp.inf).at[2].set(0.0))
    found = _swept(unknown, Range(lower, upper), jnp.asarray(H))
    low = H * np.array([-upper[0] - upper[1], -upper[1], 0.0, lower[2], lower[2] + lower[3]])
    high = H * np.array([-lower[0] - lower[1], -lower[1], 0.0, upper[2], upper[2] + upper[3]])
    np.testing.assert_allclose(found.lower, low, atol=1e-15)
    np.testing.assert_allclose(found.upper, high, atol=1e-15)


def test_the_velocity_within_a_tick_leaves_its_chord_as_far_as_it_may():
    """The acceleration is A and then −A, from rest to rest: the velocity reaches hA/2."""
    still = exactly(jnp.zeros(3))
    found = _between(still, Range(jnp.array([-3.0, 1.0]), jnp.array([3.0, 5.0])), jnp.asarray(H))
    np.testing.assert_allclose(found.upper, [H / 2 * 3.0, H / 2 * 2.0])
    np.testing.assert_allclose(found.lower, [-H / 2 * 3.0, -H / 2 * 2.0])


def test_the_position_within_a_tick_is_as_far_from_its_ends_as_speed_allows():
    """The axis moves there and back at full speed, and both readings have their largest error."""
    log = Log(jnp.zeros(1), jnp.array([0.1, 0.2]), H, Q)
    fast, reading = jnp.array([25.0]), jnp.array([0.01, 0.03])
    position, _ = _within(PUSHED, log, around(fast), reading)
    np.testing.assert_allclose(position.lower, 0.1 - 0.03 - H / 2 * 25.0)
    np.testing.assert_allclose(position.upper, 0.2 + 0.03 + H / 2 * 25.0)


def test_accelerations_are_those_of_the_worst_corner():
    """All corners of box, speed and input are tried, with δ on both sides of its jump."""
    system = System(
        (
            Term("m", "kg", (1.0, 2.0)),
            Term("b", "N s/m", (0.5, 3.0), Viscous()),
            Term("d", "N", (-1.0, 1.5), Constant()),
        ),
        SpeedBand(0.6, 0.2, 0.1),
    )
    for speeds in ((0.05, 0.3), (-0.3, -0.05), (0.2, 0.3), (-0.05, 0.05)):
        for inputs in ((4.0, 4.0), (-3.0, 2.0)):
            velocity = Range(*map(jnp.asarray, speeds))
            found = accelerations(system, Range(*inputs), exactly(jnp.zeros(())), velocity)
            most = 0.6 if min(map(abs, speeds)) <= 0.1 else 0.2
            corners = itertools.product(
                inputs, (1.0, 2.0), (0.5, 3.0), (-1.0, 1.5), speeds, (-most, most)
            )
            values = [(u - b * v - d - D) / m for u, m, b, d, v, D in corners]
            np.testing.assert_allclose([*found], [min(values), max(values)])


@pytest.mark.parametrize("n", [1, 2, 3])
def test_brackets_of_short_logs_hold_for_the_worst_readings(n):
    """All corners of box and δ and all signs of the reading errors, at five instants per period."""
    u, shares = np.array([3.0, -2.0, 1.0])[:n], np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    checked = eqx.filter_jit(lambda y: state_bounds(PUSHED, Log(jnp.asarray(u), y, H, Q)))
    for (m, d), side in itertools.product(CORNERS, (-0.5, 0.5)):
        a = (u - d - side) / m
        y, v = states_at(a, 0.05)
        inside = H * shares[:, None]
        places = y[:-1] + inside * (v[:-1] + inside * a / 2)
        speeds = v[:-1] + inside * a
        for signs in itertools.product((-1.0, 1.0), repeat=n + 1):
            found = checked(jnp.asarray(y + Q / 2 * np.array(signs)))
            assert holds(found.position, places)
            assert holds(found.velocity, speeds)
            assert holds(found.acceleration, a)


def test_no_axis_is_faster_than_the_top_speed():
    """One period with the largest acceleration and reading errors. Jitter shortens the period."""
    for resolution, push, jitter in ((1e-3, 0.0, 0.0), (1e-6, 20.0, 0.0), (5e-3, 0.0, 0.1 * H)):
        log = Log(jnp.array([push]), jnp.zeros(2), H, resolution, jitter)
        top = float(_top_speed(PUSHED, log, jnp.zeros(1)))
        a = push + 1.0 + 0.5
        between = H - 2 * jitter
        assert resolution / between + between / 2 * a <= top


def test_a_reading_may_lie_in_the_tick_before_or_after():
    """The first and last reading may lie outside the log, where only the top speed is known."""
    found = _around_samples(jnp.array([1.0, 3.0, 2.0]), jnp.asarray(9.0))
    np.testing.assert_array_equal(found, [9.0, 3.0, 3.0, 9.0])


def test_a_reading_is_off_by_half_a_count_and_what_jitter_adds():
    log = Log(jnp.zeros(3), jnp.zeros(4), H, Q, 0.1 * H)
    # read at full speed with the largest delay
    np.testing.assert_allclose(log.reading_error(jnp.asarray(2.0)), Q / 2 + 0.1 * H * 2.0)


def acting_by_hand(u, outer, starts, times):
    """Return the inputs that act at some times, each from its own start on."""
    index = np.searchsorted(starts, times, side="right") - 1
    return np.append(u, outer[1])[index] * (index >= 0) + outer[0] * (index < 0)


@pytest.mark.parametrize("signs", list(itertools.product((-1.0, 1.0), repeat=4)))
def test_inputs_that_begin_too_early_or_too_late_are_counted(signs):
    """Means over sample periods and with hat weights are computed by sums.

    Some sign pattern attains the bound of each period.
    """
    u, outer, jitter = np.array([1.0, -2.0, 0.5]), np.array([4.0, -3.0]), 0.1 * H
    log = Log(jnp.asarray(u), jnp.zeros(4), H, 0.0, jitter, jnp.asarray(outer))
    starts = H * np.arange(4) + jitter * np.array(signs)
    times = (np.arange(3000) + 0.5) * H / 1000
    acting = acting_by_hand(u, outer, starts, times).reshape(3, 1000)
    low, high = map(np.asarray, log.acting())
    assert np.all(low <= acting.min(axis=1))
    assert np.all(acting.max(axis=1) <= high)
    missed = np.abs(acting.mean(axis=1) - u)
    most = np.asarray(log.input_error())
    assert np.all(missed <= most + 1e-12)
    ends = np.abs(np.diff([outer[0], *u, outer[1]]))
    np.testing.assert_allclose(most, 0.1 * (ends[:-1] + ends[1:]))
    hat = np.concatenate([np.arange(1000), np.arange(1000)[::-1]]) + 0.5
    for k in range(2):
        mean = hat @ acting[k : k + 2].ravel() / hat.sum()
        assert abs(mean - u[k : k + 2].mean()) <= most[k : k + 2].mean() + 1e-12
