"""The rational arctangent against that of NumPy in extended precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.model.arctangent import arctan

RNG = np.random.default_rng(0)
DENSE = np.linspace(-4.0, 4.0, 400_001)
SCALES = RNG.choice([-1.0, 1.0], 200_000) * 10.0 ** RNG.uniform(-307, 308, 200_000)
# around the limits of the ranges that have formulas of their own
ENDS = np.array([0.41421356237309503, 2.414213562373095, 1e-9])
AROUND = (ENDS * (1 + np.arange(-2000, 2001)[:, None] * 2.0**-52)).ravel()
SPECIAL = np.array([0.0, 1.0, np.inf, 1.797e308, 2.2250738585072014e-308])
POINTS = np.sort(np.concatenate([DENSE, SCALES, AROUND, -AROUND, SPECIAL, -SPECIAL]))

more_digits = pytest.mark.skipif(
    np.finfo(np.longdouble).eps >= np.finfo(float).eps,
    reason="no type is more precise than float64",
)


def found_at(points):
    return np.asarray(arctan(jnp.asarray(points)))


@more_digits
@pytest.mark.parametrize(
    "points", [DENSE, SCALES, AROUND, SPECIAL], ids=["dense", "any", "ends", "0"]
)
def test_the_error_is_two_units_in_the_last_place_at_most(points):
    exact = np.arctan(points.astype(np.longdouble))
    units = np.spacing(np.abs(exact.astype(float)))
    assert np.max(np.abs(found_at(points) - exact) / units) <= 2.0


def test_it_is_odd_to_the_last_bit_and_never_falls():
    values = found_at(POINTS)
    np.testing.assert_array_equal(found_at(-POINTS), -values)
    assert np.all(np.diff(values) >= 0)
    assert np.all(np.abs(values) <= np.pi / 2)


def test_special_values_are_those_of_numpy():
    points = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -5e-324, 1e-310])
    found = found_at(points)
    np.testing.assert_array_equal(found, np.arctan(points))
    np.testing.assert_array_equal(np.signbit(found[:2]), [False, True])


def test_derivatives_are_those_of_the_arctangent():
    points = jnp.asarray([-1e100, -3.0, -0.5, 0.0, 1e-12, 0.4, 1.0, 2.5, 1e3, 1e100])
    slope = 1 / (1 + np.asarray(points) ** 2)
    np.testing.assert_allclose(jax.vmap(jax.grad(arctan))(points), slope, rtol=1e-15)
    _, forward = jax.jvp(arctan, (points,), (2 * jnp.ones_like(points),))
    np.testing.assert_allclose(forward, 2 * slope, rtol=1e-15)
    second = jax.vmap(jax.grad(jax.grad(arctan)))(points[1:-1])
    expected = -2 * np.asarray(points[1:-1]) * slope[1:-1] ** 2
    np.testing.assert_allclose(second, expected, rtol=1e-12)


def test_single_precision_stays_single():
    points = np.linspace(-5, 5, 1001, dtype=np.float32)
    found = found_at(points)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, np.arctan(points.astype(float)), rtol=3e-7)
