import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from adversaries import worst_case
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from experiments.axes import linear_motor as motor
from jaxid.loop.record import Rows, rows_of
from jaxid.regression.worst_case import (
    Norm,
    individual,
    infinity,
    information,
    least_squares,
    require_informative,
    smooth_least_squares_error,
    worst_case_error,
)

seeds = st.integers(0, 10_000)


def random_rows(seed: int, n: int = 30, m: int = 3) -> Rows:
    rng = np.random.default_rng(seed)
    columns = tuple(jnp.asarray(rng.normal(size=n)) for _ in range(m))
    delta, measure = rng.uniform(0.1, 1.0, n), rng.uniform(0.5, 1.5, n)
    return Rows(columns, jnp.asarray(delta), jnp.asarray(measure))


@given(seeds)
def test_weights_are_unbiased_and_match_numpy(seed):
    rows = random_rows(seed)
    phi, h = np.asarray(rows.regressors), np.asarray(rows.measure)
    P = phi.T @ (h[:, None] * phi)
    np.testing.assert_allclose(information(rows), P, rtol=1e-12)
    weights = np.asarray(least_squares(rows))
    np.testing.assert_allclose(weights @ phi, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(weights, np.linalg.solve(P, phi.T * h), rtol=1e-9, atol=1e-12)


@given(seeds)
def test_theorem_2_the_adversary_attains_the_bound_and_no_other_sign_does(seed):
    rows = random_rows(seed)
    weights = least_squares(rows)
    bound = worst_case_error(weights, rows.delta)
    for i, g in enumerate(weights):
        worst = worst_case(g, rows.delta)
        assert jnp.all(jnp.abs(worst) <= rows.delta)
        attained = float(g @ worst)
        assert abs(attained - bound[i]) <= 1e-12 * bound[i]
        assert attained > bound[i] * (1 - 1e-9)  # a bound smaller by 1e-9 would be exceeded
        flipped = attained - 2 * np.asarray(g * worst)
        assert np.all(flipped < attained)


@given(seeds)
def test_no_disturbance_exceeds_the_bound(seed):
    rows = random_rows(seed)
    weights = least_squares(rows)
    bound = worst_case_error(weights, rows.delta)
    shares = np.random.default_rng(seed).uniform(-1, 1, (200, 30))
    errors = np.abs((shares * np.asarray(rows.delta)) @ np.asarray(weights).T)
    assert np.all(errors <= np.asarray(bound) * (1 + 1e-12))


@given(seeds)
def test_theorem_2_in_the_infinity_norm_is_the_largest_row(seed):
    rows = random_rows(seed)
    scale = jnp.array([1.0, 2.0, 0.5])
    whole = worst_case_error(least_squares(rows), rows.delta)
    scaled = worst_case_error(least_squares(rows, infinity(scale)), rows.delta)
    np.testing.assert_allclose(scaled, whole / scale, rtol=1e-10)
    for i in range(3):
        single = worst_case_error(least_squares(rows, individual(i, 3)), rows.delta)
        np.testing.assert_allclose(single, whole[i : i + 1], rtol=1e-10)


@given(seeds)
def test_any_functional_of_the_parameters_has_its_exact_worst_case(seed):
    rows = random_rows(seed)
    c = jnp.asarray(np.random.default_rng(seed).normal(size=(1, 3)))
    weights = least_squares(rows, Norm(c))
    np.testing.assert_allclose(weights[0], (c @ least_squares(rows))[0], rtol=1e-9, atol=1e-12)


@given(seeds)
def test_theorem_1_every_vertex_of_the_feasible_sets_lies_in_the_starred_set(seed):
    """The vertices of Θ_Δy for random Δ are in the zonotope Θ_y*, by a linear program."""
    rng = np.random.default_rng(seed)
    rows = random_rows(seed, n=8, m=2)
    phi, delta = np.asarray(rows.regressors), np.asarray(rows.delta)
    theta = rng.normal(size=2)
    weights = np.asarray(least_squares(rows))
    bound = np.abs(weights) @ delta
    u = phi @ theta + rng.choice([-1.0, 1.0], 8) * delta
    found = 0
    for pair in itertools.combinations(range(8), 2):
        for signs in itertools.product((-1, 1), repeat=2):
            A = phi[list(pair)]
            if abs(np.linalg.det(A)) < 1e-9:
                continue
            vertex = np.linalg.solve(A, u[list(pair)] + np.array(signs) * delta[list(pair)])
            if np.all(np.abs(phi @ vertex - u) <= delta * (1 + 1e-9)):
                found += 1
                assert np.all(np.abs(vertex - theta) <= 2 * bound * (1 + 1e-9))
                assert in_starred_set(vertex - theta, weights, delta)
    assert found > 0  # the set contains θ, so it is not empty


def in_starred_set(offset: np.ndarray, weights: np.ndarray, delta: np.ndarray) -> bool:
    """Return whether offset = 2 G ε for some |ε| ≤ δ."""
    bounds = [(-d * (1 + 1e-9), d * (1 + 1e-9)) for d in delta]
    result = linprog(np.zeros(delta.size), A_eq=2 * weights, b_eq=offset, bounds=bounds)
    return result.status == 0


@given(seeds, st.floats(1e-4, 0.1))
def test_rounded_errors_are_never_below_the_exact_ones(seed, smoothing):
    rows = random_rows(seed)
    exact = worst_case_error(least_squares(rows), rows.delta)
    rounded = smooth_least_squares_error(rows, jnp.asarray(smoothing))
    assert jnp.all(rounded >= exact * (1 - 1e-12))
    assert jnp.all(rounded <= exact * (1 + 20 * smoothing))


def test_the_rounded_error_has_no_kink_where_a_weight_crosses_zero():
    """In a straight-line fit, the weight of the middle point in the slope changes its sign.

    Second differences of a smooth function decrease with the square of the step.
    """

    def error(middle):
        abscissa = jnp.linspace(-1.0, 1.0, 5).at[2].set(middle)
        rows = Rows((jnp.ones(5), abscissa), jnp.ones(5), jnp.ones(5))
        return smooth_least_squares_error(rows, jnp.asarray(0.1))[1]

    bends = [abs(error(h) - 2 * error(0.0) + error(-h)) for h in (1e-2, 1e-3)]
    assert bends[1] < 0.02 * bends[0]


def test_a_row_without_weight_leaves_no_nan_in_the_gradient():
    rows = random_rows(0)
    silent = Rows(rows.columns, rows.delta, rows.measure.at[:5].set(0.0))

    def error(scale):
        scaled = Rows(tuple(scale * c for c in silent.columns), silent.delta, silent.measure)
        return jnp.sum(smooth_least_squares_error(scaled, jnp.zeros(())))

    assert np.isfinite(jax.grad(error)(1.0))


def test_a_singular_motion_names_what_it_cannot_tell_apart():
    system = motor.system()
    v = jnp.ones(20)
    from jaxid.motion.trajectory import States

    rows = rows_of(system, States(jnp.zeros(20), v, jnp.linspace(-1.0, 1.0, 20)), jnp.ones(20))
    with pytest.raises(ValueError, match=r"cannot identify M, B, Fc, dbar") as error:
        require_informative(rows, system.names, system.half_widths)
    assert "·Fc" in str(error.value) or "·B" in str(error.value)
    assert "·M" not in str(error.value)


def test_a_norm_needs_something_to_measure():
    with pytest.raises(ValueError, match="no zero row"):
        Norm(jnp.zeros((1, 3)))
