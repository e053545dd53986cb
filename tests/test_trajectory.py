import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from jaxid.motion.trajectory import JerkTrajectory, padded, reference, ticks, trimmed, uniform

values = st.floats(-1000, 1000, allow_nan=False).map(lambda x: 0.0 if abs(x) < 1e-3 else x)
jerks = arrays(float, 7, elements=values)
starts = arrays(float, 3, elements=st.floats(-2, 2))
T = 0.01


states = eqx.filter_jit(JerkTrajectory.states)
extrema = eqx.filter_jit(JerkTrajectory.extrema)


@eqx.filter_jit
def slopes_of(trajectory: JerkTrajectory, times: jax.Array) -> jax.Array:
    return jax.vmap(jax.jacfwd(lambda t: jnp.stack(trajectory.states(t[None]))[:, 0]))(times)


def integrate(start: np.ndarray, jerk: np.ndarray, period: float) -> np.ndarray:
    """Return the knot states, integrated one interval after the other."""
    found = [start]
    for j in jerk:
        y, v, a = found[-1]
        found.append(
            np.array(
                [
                    y + v * period + a * period**2 / 2 + j * period**3 / 6,
                    v + a * period + j * period**2 / 2,
                    a + j * period,
                ]
            )
        )
    return np.array(found)


@given(starts, jerks)
def test_knot_states_match_a_loop(start, jerk):
    knots = uniform(jnp.asarray(start), jnp.asarray(jerk), T).knot_states()
    np.testing.assert_allclose(np.stack(knots, axis=1), integrate(start, jerk, T), atol=1e-11)


@given(starts, jerks)
def test_states_are_those_of_the_knots_and_differentiate_into_one_another(start, jerk):
    trajectory = uniform(jnp.asarray(start), jnp.asarray(jerk), T)
    times = trajectory.knot_times()
    for at, knot in zip(states(trajectory, times), trajectory.knot_states(), strict=True):
        np.testing.assert_allclose(at, knot, atol=1e-9)
    middle = (times[:-1] + times[1:]) / 2
    slopes, at = slopes_of(trajectory, middle), states(trajectory, middle)
    np.testing.assert_allclose(slopes[:, 0], at.velocity, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(slopes[:, 1], at.acceleration, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(slopes[:, 2], jerk, rtol=1e-9, atol=1e-9)


@given(starts, jerks)
def test_extrema_bound_a_dense_sampling_and_are_attained(start, jerk):
    trajectory = uniform(jnp.asarray(start), jnp.asarray(jerk), T)
    dense = states(trajectory, jnp.linspace(0.0, 7 * T, 7 * 2000 + 1))
    for x, (lowest, highest) in zip(dense, extrema(trajectory), strict=False):
        span = max(1e-9, float(highest - lowest))
        assert lowest <= x.min() + 1e-12 * span
        assert x.max() - 1e-12 * span <= highest
        # an extremum is at most half a sampling step away from a sample
        assert x.min() - lowest <= 1e-5 * span + 1e-8
        assert highest - x.max() <= 1e-5 * span + 1e-8


@given(starts, jerks)
def test_padding_changes_nothing(start, jerk):
    trajectory = uniform(jnp.asarray(start), jnp.asarray(jerk), T)
    longer = padded(trajectory, 12)
    times = jnp.linspace(0.0, 7 * T, 50)
    for a, b in zip(states(trajectory, times), states(longer, times), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-15)
    # padding has zero jerk, so that the range of the jerk may be wider
    for a, b in zip(extrema(trajectory)[:3], extrema(longer)[:3], strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(trimmed(longer).jerk, trajectory.jerk)
    assert longer.midpoints(3)[1][21:].max() == 0


def test_midpoints_integrate_polynomials_of_the_motion():
    trajectory = uniform(jnp.zeros(3), jnp.array([100.0, -200.0, 100.0]), T)
    states, weights = trajectory.midpoints(4000)
    end = trajectory.knot_states()
    np.testing.assert_allclose(jnp.sum(weights), 3 * T, rtol=1e-12)
    np.testing.assert_allclose(jnp.sum(states.velocity * weights), end.position[-1], rtol=1e-7)
    np.testing.assert_allclose(
        jnp.sum(states.acceleration * weights), end.velocity[-1], rtol=1e-7, atol=1e-12
    )


def test_reference_repeats_back_to_back(motion):
    once, thrice = reference(motion, 2e-4, 3000), reference(motion, 2e-4, 3000, 3)
    assert ticks(motion, 2e-4) == 3000
    with pytest.raises(ValueError, match=r"must divide the duration of the motion, 0\.6 s"):
        ticks(motion, 0.7e-4)
    assert once.position.shape == (3000,)
    np.testing.assert_array_equal(thrice.velocity, np.tile(once.velocity, 3))


def test_durations_may_differ():
    split = JerkTrajectory(
        jnp.zeros(3), jnp.array([50.0, 50.0, -20.0]), jnp.array([0.004, 0.006, 0.01])
    )
    whole = uniform(jnp.zeros(3), jnp.array([50.0, -20.0]), T)
    times = jnp.linspace(0.0, 0.02, 33)
    for a, b in zip(split.states(times), whole.states(times), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-15)
