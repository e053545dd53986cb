"""Ranges contain all values of their expression; ranges of regressors are not too wide."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from experiments.axes import linear_motor as motor
from experiments.axes import one_link_arm as arm
from jaxid.model.disturbance_bound import SpeedBand
from jaxid.model.interval_arithmetic import Range, around, exactly, where
from jaxid.model.regressors import Constant, Coulomb, Custom, OneWay, Sign, Sine, Spring, Viscous

ends = st.floats(-3.0, 3.0, allow_subnormal=False)
pairs = st.tuples(ends, ends).map(sorted)
SIZE = 5
vectors = arrays(float, SIZE, elements=ends)
shares = arrays(float, SIZE, elements=st.floats(0.0, 1.0))
widths = arrays(float, SIZE, elements=st.floats(0.01, 2.0))
# both signs occur, far enough from zero for a division
divisors = vectors.map(lambda c: np.where(c < 0, c - 0.1, c + 0.1))

# expressions of numbers or ranges x and y, and of known numbers c
EXPRESSIONS = {
    "x + y": lambda x, y, c: x + y,
    "x - y": lambda x, y, c: x - y,
    "x * y": lambda x, y, c: x * y,
    "x / y": lambda x, y, c: x / y,
    "-x": lambda x, y, c: -x,
    "abs(x)": lambda x, y, c: abs(x),
    "x + c": lambda x, y, c: x + c,
    "c + x": lambda x, y, c: c + x,
    "x - c": lambda x, y, c: x - c,
    "c - x": lambda x, y, c: c - x,
    "x * c": lambda x, y, c: x * c,
    "c * x": lambda x, y, c: c * x,
    "x / c": lambda x, y, c: x / c,
    "c / x": lambda x, y, c: c / x,
    "sum": lambda x, y, c: sum([x, y, c * x]),
    "all": lambda x, y, c: c * (2 - x) * y - abs(y - x) / 3 + x,
}
TRANSFORMS = {
    "as it is": lambda f: f,
    "jit": jax.jit,
    "vmap": lambda f: jax.jit(jax.vmap(f)),
    "scan": lambda f: jax.jit(
        lambda *args: jax.lax.scan(lambda _, entry: (None, f(*entry)), None, args)[1]
    ),
}


def samples(x, count=41):
    return np.linspace(float(x.lower), float(x.upper), count)


def as_range(pair):
    return Range(*map(jnp.asarray, pair))


def assert_holds(found, values):
    """Require that the range contains all values and that both ends are attained."""
    span = 1e-12 * (1 + np.max(np.abs(values)))
    assert float(found.lower) == pytest.approx(np.min(values), abs=span)
    assert float(found.upper) == pytest.approx(np.max(values), abs=span)


@pytest.mark.parametrize("transform", TRANSFORMS)
@pytest.mark.parametrize("name", EXPRESSIONS)
def test_every_value_is_inside(name, transform):
    """Values of the expression at random points lie in its range, except for rounding."""
    expression = EXPRESSIONS[name]
    of_ranges = TRANSFORMS[transform](expression)

    @given(vectors, vectors, widths, widths, divisors, shares, shares)
    def check(x, y, dx, dy, c, at_x, at_y):
        ranges = Range(x, x + dx), Range(y, y + dy)
        found = of_ranges(*ranges, jnp.asarray(c))
        assert isinstance(found, Range)
        lower, upper = map(np.array, found)
        if name == "x / y":  # 0·∞ is NaN and bounds nothing
            lower[(y <= 0) & (y + dy >= 0) & np.isnan(lower)] = -np.inf
            upper[(y <= 0) & (y + dy >= 0) & np.isnan(upper)] = np.inf
        for s, t in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0), (at_x, at_y)):
            # a division by zero, or a quotient that overflows
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                value = expression(x + s * dx, y + t * dy, c)
            real = np.isfinite(value)
            slack = 1e-12 * (1 + np.abs(value[real]))
            assert np.all(lower[real] - slack <= value[real])
            assert np.all(value[real] <= upper[real] + slack)

    check()


@given(pairs, pairs, ends)
def test_arithmetic_is_exact_for_independent_values(one, other, factor):
    a, b = as_range(one), as_range(other)
    x, y = np.meshgrid(samples(a), samples(b))
    assert_holds(a + b + 1.0, x + y + 1.0)
    assert_holds(a - b, x - y)
    assert_holds(a * b, x * y)
    assert_holds(factor * a, factor * x)
    assert_holds(factor - a, factor - x)
    assert_holds(a | b, np.concatenate([x.ravel(), y.ravel()]))
    assert_holds(a | factor, np.append(x, factor))
    if abs(factor) > 0.1:
        assert_holds(a / factor, x / factor)
    if min(one) > 0.1 or max(one) < -0.1:
        assert_holds(factor / a, factor / x)
        assert_holds(b / a, y / x)


@given(pairs, st.floats(0.0, 3.0, allow_subnormal=False))
def test_magnitude_intersection_middle_and_half_width(one, radius):
    a, b = as_range(one), around(radius)
    found = abs(a)
    assert float(found.upper) == max(abs(one[0]), abs(one[1]))
    assert float(found.lower) == (0.0 if one[0] <= 0 <= one[1] else min(abs(one[0]), abs(one[1])))
    both = a & b
    assert float(both.lower) == max(one[0], -radius)
    assert float(both.upper) == min(one[1], radius)
    assert (float(b.middle), float(b.half_width)) == (0.0, radius)
    assert float(a.middle + a.half_width) == pytest.approx(one[1], abs=1e-15)
    assert float(a.middle - a.half_width) == pytest.approx(one[0], abs=1e-15)


def test_a_quotient_is_unbounded_if_the_divisor_may_be_zero():
    for pair in ((-1.0, 2.0), (0.0, 2.0), (-2.0, -0.0), (0.0, 0.0)):
        for found in (1.0 / Range(*pair), 0.0 / Range(*pair), Range(1.0, 2.0) / Range(*pair)):
            assert (float(found.lower), float(found.upper)) == (-np.inf, np.inf)


def test_of_two_ranges_one_is_chosen_entry_by_entry():
    one, other = Range(jnp.zeros(2), jnp.ones(2)), Range(jnp.full(2, 2.0), jnp.full(2, 3.0))
    lower, upper = where(jnp.array([True, False]), one, other)
    np.testing.assert_array_equal(lower, [0.0, 2.0])
    np.testing.assert_array_equal(upper, [1.0, 3.0])


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_ends_have_the_slopes_of_their_differences(name):
    """Gradients of the ends agree with finite differences.

    A wider operand never gives a narrower result.
    """
    expression = EXPRESSIONS[name]

    def both_ends(x, y, c):
        return jnp.stack([*expression(x, y, c)])

    slopes = jax.jit(jax.jacobian(both_ends, argnums=(0, 1)))
    of_ranges = jax.jit(both_ends)
    rng = np.random.default_rng(0)
    for _ in range(20):
        # both signs without zero, where a quotient has no gradient; random points avoid kinks
        x, y = (
            rng.choice([-1, 1]) * Range(low, low + width)
            for low, width in zip(rng.uniform(0.2, 2.0, 2), rng.uniform(0.05, 2.0, 2), strict=True)
        )
        c = rng.choice([-1, 1]) * rng.uniform(0.2, 2.0)
        at_x, at_y = slopes(x, y, c)
        for slope, moved in ((at_x, lambda d: (x + d, y)), (at_y, lambda d: (x, y + d))):  # noqa: B023
            difference = (of_ranges(*moved(1e-6), c) - of_ranges(*moved(-1e-6), c)) / 2e-6
            np.testing.assert_allclose(slope.lower + slope.upper, difference, rtol=1e-6, atol=1e-7)
            assert np.all(slope.lower * np.array([1, -1]) >= 0)
            assert np.all(slope.upper * np.array([-1, 1]) >= 0)


def test_two_ranges_add_up_to_a_range_and_not_to_four_numbers():
    one, other = Range(1.0, 2.0), Range(-3.0, 5.0)
    for found in (one + other, sum([one, other])):
        assert isinstance(found, Range)
        assert [float(end) for end in found] == [-2.0, 7.0]
    assert bool(one + other == Range(-2.0, 7.0))
    assert not bool(one == other)


@pytest.mark.parametrize("known", [np.array([-2.0, 0.5]), np.float64(-2.0), -2.0, -2, np.array(-2)])
@pytest.mark.parametrize("as_array", [lambda x: x, jnp.asarray])
def test_numbers_and_arrays_on_either_side(known, as_array):
    """A NumPy array on the left must not make an array of two or three ranges."""
    x, c = Range(np.array([-1.0, 2.0]), np.array([4.0, 3.0])), as_array(known)
    corners = np.array([[-1.0, 2.0], [4.0, 3.0]])
    for found, values in (
        (c + x, known + corners),
        (x + c, known + corners),
        (c - x, known - corners),
        (x - c, corners - known),
        (c * x, known * corners),
        (x * c, known * corners),
        (x / c, corners / known),
        (c | x, np.stack([*corners, np.broadcast_to(known, 2)])),
        (x | c, np.stack([*corners, np.broadcast_to(known, 2)])),
    ):
        assert isinstance(found, Range)
        assert isinstance(found.lower, jax.Array)
        np.testing.assert_array_equal(found.lower, values.min(axis=0))
        np.testing.assert_array_equal(found.upper, values.max(axis=0))
    for found in (c & x, x & c):
        np.testing.assert_array_equal(found.lower, np.maximum(known, corners[0]))
        np.testing.assert_array_equal(found.upper, np.minimum(known, corners[1]))


REFUSED = {
    "index": (lambda x: x[0], "not indexed"),
    "part": (lambda x: x[:1], "not indexed"),
    "order": (lambda x: x < 1.0, "not compared"),
    "order of two": (lambda x: x <= x, "not compared"),
    "order of an array": (lambda x: np.ones(2) > x, "not compared"),
    "largest": (lambda x: max(x, x), "not compared"),
    "pair": (lambda x: x == (0.0, 1.0), "not compared"),
    "pair on the left": (lambda x: (0.0, 1.0) != x, "not compared"),  # noqa: SIM300
    "array on the left": (lambda x: np.ones(2) == x, "not compared"),
    "member": (lambda x: 0.5 in x, "not compared"),
    "array": (lambda x: np.asarray(x), "not an array"),
    "array of JAX": (lambda x: jnp.asarray(x), "not an array"),
    "sum with a pair": (lambda x: x + (0.0, 1.0), "tuple"),  # noqa: RUF005
    "a pair before": (lambda x: (0.0, 1.0) + x, "tuple"),  # noqa: RUF005
    "a list before": (lambda x: [0.0] * x, "list"),
    "common with nothing": (lambda x: x & None, "NoneType"),
    "function of NumPy": (lambda x: np.maximum(x, 0.0), "'Range' does not support ufuncs"),
    "hash": (hash, "unhashable"),
    "length": (len, "'Range' has no len"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_a_pair_of_numbers_would_allow_is_refused(name):
    attempt, sentence = REFUSED[name]
    for x in (Range(0.0, 1.0), Range(np.zeros(2), np.ones(2))):
        with pytest.raises(TypeError, match=sentence):
            attempt(x)


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
    "offset forward": OneWay(Constant()),
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
    # as narrow as the samples show, except for a jump between two samples
    if "motor" not in name and name not in ("rising", "offset forward"):
        assert float(found.upper - found.lower) <= np.ptp(values) + 0.02


@given(pairs, ends)
def test_dry_friction_may_be_anything_at_rest(velocity, position):
    """The range of the sign is [−1, 1] if it includes rest.

    The sum of both one-way frictions is the sign.
    """
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
    """A negative β or pitch would exchange the ends of a range, and so make δ too small."""
    with pytest.raises(ValueError, match="`beta` of a Coulomb regressor must be positive"):
        Coulomb(wrong)
    with pytest.raises(ValueError, match="`pitch` of a Sine regressor must be positive"):
        Sine(0.0, wrong)
    with pytest.raises(ValueError, match="`slopes` of a Custom regressor must be at least zero"):
        Custom(jnp.multiply, (1.0, min(wrong, -wrong)) if wrong else (-1.0, 0.0))


@pytest.mark.parametrize("wrong", [(1.0,), (1.0, 2.0, 3.0), 1.0])
def test_slopes_and_bounds_are_pairs(wrong):
    for name in ("slopes", "bounds"):
        with pytest.raises(ValueError, match=f"`{name}` of a Custom regressor must"):
            Custom(jnp.multiply, **{name: wrong})
    with pytest.raises(ValueError, match="`bounds` of a Custom regressor must be its smallest"):
        Custom(jnp.multiply, bounds=(1.0, -1.0))


def steep(position, velocity):
    return jnp.tanh(velocity / 0.02) * jnp.cos(position / 0.1)


@given(pairs, pairs)
def test_a_steep_function_has_a_range_that_is_proved_and_narrow(position, velocity):
    """The range follows from slopes in 8 × 8 cells, and from bounds at saturation."""
    y, v = as_range(position), as_range(velocity)
    own = Custom(steep, slopes=(10.0, 50.0))
    found, bounded = own.range(y, v), Custom(steep, (10.0, 50.0), bounds=(-1.0, 1.0)).range(y, v)
    # the grid contains the midpoints of the cells
    grid = np.meshgrid(samples(y, 17), samples(v, 17))
    values = steep(*(jnp.asarray(x.ravel()) for x in grid))
    for one in (found, bounded):
        assert float(one.lower) <= float(jnp.min(values)) + 1e-12
        assert float(one.upper) >= float(jnp.max(values)) - 1e-12
    assert float(bounded.lower) >= -1.0
    assert float(bounded.upper) <= 1.0
    reach = 10.0 * y.half_width + 50.0 * v.half_width
    spread = float(jnp.max(values) - jnp.min(values))
    assert float(found.upper - found.lower) <= spread + 2 * float(reach) / 8 + 1e-9
