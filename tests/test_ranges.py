"""Every range holds the values that a dense sampling finds, and is not wider than it need be."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.axes import linear_motor as motor
from experiments.axes import one_link_arm as arm
from jaxid.model.disturbance_bound import SpeedBand
from jaxid.model.interval_arithmetic import (
    Range,
    around,
    common,
    exactly,
    hull,
    minus,
    plus,
    scaled,
    size,
    times,
)
from jaxid.model.regressors import Coulomb, Custom, OneWay, Sign, Sine, Spring, Viscous

ends = st.floats(-3.0, 3.0, allow_subnormal=False)
pairs = st.tuples(ends, ends).map(sorted)


def samples(x, count=41):
    return np.linspace(float(x.lower), float(x.upper), count)


def as_range(pair):
    return Range(*map(jnp.asarray, pair))


def assert_holds(found, values):
    """All values inside, and both ends attained."""
    span = 1e-12 * (1 + np.max(np.abs(values)))
    assert float(found.lower) == pytest.approx(np.min(values), abs=span)
    assert float(found.upper) == pytest.approx(np.max(values), abs=span)


@given(pairs, pairs, ends)
def test_arithmetic_is_exact_for_independent_values(one, other, factor):
    a, b = as_range(one), as_range(other)
    x, y = np.meshgrid(samples(a), samples(b))
    assert_holds(plus(a, b, exactly(jnp.asarray(1.0))), x + y + 1.0)
    assert_holds(minus(a, b), x - y)
    assert_holds(times(a, b), x * y)
    assert_holds(scaled(jnp.asarray(factor), a), factor * x)
    assert_holds(hull(a, b), np.concatenate([x.ravel(), y.ravel()]))


@given(pairs, st.floats(0.0, 3.0, allow_subnormal=False))
def test_size_and_common(one, radius):
    a, b = as_range(one), around(jnp.asarray(radius))
    found = size(a)
    assert float(found.upper) == max(abs(one[0]), abs(one[1]))
    assert float(found.lower) == (0.0 if one[0] <= 0 <= one[1] else min(abs(one[0]), abs(one[1])))
    both = common(a, b)
    assert float(both.lower) == max(one[0], -radius)
    assert float(both.upper) == min(one[1], radius)


BOUNDS = {
    "motor": motor.system().disturbance_bound,
    "rising": SpeedBand(0.1, 0.4, 0.5),
    "spread": SpeedBand(0.3, 0.1, 0.5, 0.2),
    "constant": arm.system().disturbance_bound,
}
FORCES = {
    "viscous": motor.system().terms[1].regressor,
    "coulomb": Coulomb(3.0),
    "blended": Coulomb(3.0, 0.5),
    "constant": motor.system().terms[3].regressor,
    "sine": Sine(),
    "cosine": Sine(np.pi / 2),
    "cogging": Sine(0.3, 0.7),
    "spring": Spring(0.4),
    "viscous forward": OneWay(Viscous()),
    "coulomb backward": OneWay(Coulomb(3.0), forward=False),
}


@pytest.mark.parametrize("name", [*BOUNDS, *FORCES])
@given(position=st.tuples(ends, st.floats(0.0, 9.0)), velocity=pairs)
def test_ranges_of_regressors_and_bounds(name, position, velocity):
    function = (BOUNDS | FORCES)[name]
    y = as_range((position[0], position[0] + position[1]))
    v = as_range(velocity)
    found = function.range(y, v)
    places, speeds = np.meshgrid(samples(y, 101), samples(v, 101))
    values = np.asarray(function(jnp.asarray(places), jnp.asarray(speeds)))
    assert float(found.lower) <= np.min(values) + 1e-12
    assert np.max(values) - 1e-12 <= float(found.upper)
    # as tight as the sampling can tell, but for a jump that lies between two samples
    if "motor" not in name and name != "rising":
        assert float(found.upper - found.lower) <= np.ptp(values) + 0.02


@given(pairs, ends)
def test_dry_friction_may_be_anything_at_rest(velocity, position):
    """Moving, it is the sign; in both directions together one-way frictions are it."""
    v, y = as_range(velocity), exactly(jnp.asarray(position))
    found = Sign().range(y, v)
    at_rest = velocity[0] <= 0 <= velocity[1]
    expected = (-1.0, 1.0) if at_rest else (np.sign(velocity[0]), np.sign(velocity[1]))
    assert (float(found.lower), float(found.upper)) == expected
    speeds = jnp.asarray(samples(v))
    ways = [OneWay(Sign(), forward) for forward in (True, False)]
    np.testing.assert_array_equal(sum(way(speeds, speeds) for way in ways), jnp.sign(speeds))
    for way in ways:
        inside = way.range(y, v)
        values = way(speeds, speeds)
        assert float(inside.lower) <= np.min(values)
        assert np.max(values) <= float(inside.upper)


@pytest.mark.parametrize("wrong", [0.0, -3.0, float("nan"), float("inf")])
def test_what_would_turn_a_range_around_is_refused(wrong):
    """A β or pitch below zero made the lower end the upper one, and so δ too small."""
    with pytest.raises(ValueError, match="`beta` of a Coulomb regressor must be positive"):
        Coulomb(wrong)
    with pytest.raises(ValueError, match="`pitch` of a Sine regressor must be positive"):
        Sine(0.0, wrong)
    with pytest.raises(ValueError, match="`slopes` of a Custom regressor must be at least zero"):
        Custom(jnp.multiply, (1.0, min(wrong, -wrong)) if wrong else (-1.0, 0.0))
