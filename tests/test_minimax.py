"""The minimax error against HiGHS, exact arithmetic, duality and finite differences."""

from fractions import Fraction

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from experiments.axes import linear_motor as motor
from jaxid.io.files import read_trajectory
from jaxid.loop.record import Rows, rows_of
from jaxid.regression.minimax import minimax
from jaxid.regression.worst_case import Norm

seeds = st.integers(0, 10_000)


def rows_from(phi, delta, measure=None) -> Rows:
    measure = np.ones(len(delta)) if measure is None else np.asarray(measure, float)
    columns = tuple(jnp.asarray(column) for column in np.asarray(phi, float).T)
    return Rows(columns, jnp.asarray(delta), jnp.asarray(measure))


def ordinary(rng, n=40, m=3):
    return rng.normal(size=(n, m)), rng.uniform(0.1, 1.0, n), rng.uniform(0.02, 2.0, m)


def badly_scaled(rng):
    phi, delta, half_widths = ordinary(rng)
    units = 10.0 ** rng.uniform(-6, 6, 3)
    return phi * units * 10.0 ** rng.uniform(-2, 2, (40, 1)), delta, half_widths / units


def nearly_collinear(rng):
    phi, delta, half_widths = ordinary(rng)
    phi[:, 2] = phi[:, 0] * (1 + 1e-7 * rng.normal(size=40))
    return phi, delta, half_widths


def degenerate(rng):
    """Return small integers: repeated rows, zero rows, and many optimal solutions."""
    return rng.integers(-1, 2, (40, 3)).astype(float), np.ones(40), np.ones(3)


def loose_box(rng):
    phi, delta, half_widths = ordinary(rng)
    return phi, delta, 1e4 * half_widths


def tight_box(rng):
    """Return a box so small that no data narrow it."""
    phi, delta, half_widths = ordinary(rng)
    return phi, delta, 1e-4 * half_widths


def fewer_rows_than_parameters(rng):
    """Return rows of which only the first two are not zero."""
    phi, delta, half_widths = ordinary(rng)
    phi[2:] = 0.0
    return phi, delta, half_widths


def many_parameters(rng):
    return ordinary(rng, n=200, m=6)


def smooth(rng):
    """Return rows that are similar to their neighbours, as on a motion."""
    phi = np.polynomial.chebyshev.chebvander(np.linspace(-1, 1, 200), 5)
    return phi, rng.uniform(0.5, 1.0) * np.ones(200), rng.uniform(0.05, 5.0, 6)


PROBLEMS = [
    ordinary,
    badly_scaled,
    nearly_collinear,
    degenerate,
    loose_box,
    fewer_rows_than_parameters,
    many_parameters,
    smooth,
]


def by_highs(phi, delta, half_widths, functional) -> float:
    """Return the optimum of the primal program from HiGHS, in units of the bounds."""
    A = np.vstack([phi * half_widths / delta[:, None], np.eye(half_widths.size)]).T
    solution = linprog(
        np.ones(2 * A.shape[1]),
        A_eq=np.hstack([A, -A]),
        b_eq=half_widths * functional,
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    assert solution.status == 0
    return solution.fun


def worst_case(weights, phi, delta, half_widths, functionals) -> np.ndarray:
    return np.abs(weights) @ delta + np.abs(functionals - weights @ phi) @ half_widths


def assert_right(result, phi, delta, half_widths, functionals):
    """Check error and lower bound against the weights and ν, and against HiGHS."""
    error, floor, weights, dual = (
        np.asarray(x) for x in (result.error, result.lower_bound, result.weights, result.dual)
    )
    exact = worst_case(weights, phi, delta, half_widths, functionals)
    np.testing.assert_allclose(error, exact, rtol=1e-8)
    assert np.all(error >= exact * (1 - 1e-15))
    assert np.all(np.abs(dual) <= half_widths)
    assert np.all(np.abs(phi @ dual.T) <= delta[:, None] * (1 + 1e-15))
    np.testing.assert_allclose(floor, np.sum(functionals * dual, axis=1), rtol=1e-8)
    assert np.all(error >= floor)
    # half-width of the prior box
    assert np.all(error <= np.abs(functionals) @ half_widths * (1 + 1e-13))
    for i, functional in enumerate(functionals):
        expected = by_highs(phi, delta, half_widths, functional)
        np.testing.assert_allclose([error[i], floor[i]], expected, rtol=1e-6)


@pytest.mark.parametrize("problem", PROBLEMS)
@settings(max_examples=8)
@given(seeds)
def test_highs_agrees_and_each_value_proves_the_other(problem, seed):
    rng = np.random.default_rng(seed)
    phi, delta, half_widths = problem(rng)
    m = half_widths.size
    functionals = np.vstack([np.eye(m)[1:], rng.normal(size=(1, m)) / half_widths])
    result = minimax(
        rows_from(phi, delta), jnp.asarray(half_widths), Norm(jnp.asarray(functionals))
    )
    assert_right(result, phi, delta, half_widths, functionals)
    assert np.all(result.error - result.lower_bound <= 1e-8 * result.error)


@pytest.fixture(scope="module")
def motor_problems(figures):
    """Return rows of several motions, padded with rows of measure zero to one number."""
    sampled = eqx.filter_jit(lambda t: rows_of(motor.system(), *t.midpoints(10)))
    problems = {}
    for name in ("M_N30", "B_N30", "Fc_N30", "dbar_N30", "infinity_N30", "B_N40", "Fc_N60"):
        rows = sampled(read_trajectory(figures / f"trajectory_{name}.csv"))
        padding = 1200 - rows.delta.size
        problems[name] = jax.tree.map(lambda x, p=padding: jnp.asarray(np.pad(x, (0, p))), rows)
    return problems


def test_highs_agrees_on_the_motions_of_the_motor(motor_problems):
    box = motor.system().half_widths
    for rows in motor_problems.values():
        result = minimax(rows, box)
        assert np.all(result.error - result.lower_bound < 1e-10 * result.error)
        counts = np.asarray(rows.measure) > 0
        phi, delta = np.asarray(rows.regressors)[counts], np.asarray(rows.delta)[counts]
        kept = eqx.tree_at(lambda r: r.weights, result, result.weights[:, counts])
        assert_right(kept, phi, delta, np.asarray(box), np.eye(4))


def test_a_batch_of_motions_is_what_each_of_them_is(motor_problems):
    box = motor.system().half_widths
    batch = jax.tree.map(lambda *x: jnp.stack(x), *motor_problems.values())
    together = jax.vmap(minimax, (0, None))(batch, box)
    alone = [minimax(rows, box) for rows in motor_problems.values()]
    np.testing.assert_allclose(together.error, [r.error for r in alone], rtol=1e-12)
    np.testing.assert_allclose(together.lower_bound, [r.lower_bound for r in alone], rtol=1e-12)
    assert np.all(together.error >= together.lower_bound)


def test_exact_arithmetic_confirms_both_values():
    """With rational numbers the weights are no worse, and ν no less feasible, than reported.

    This is tested for each parameter and for three combinations.
    """
    rng = np.random.default_rng(5)
    for problem in (ordinary, nearly_collinear, loose_box, tight_box):
        phi, delta, half_widths = problem(rng)
        functionals = np.vstack([np.eye(3), rng.normal(size=(3, 3)) / half_widths])
        norm = Norm(jnp.asarray(functionals))
        result = minimax(rows_from(phi, delta), jnp.asarray(half_widths), norm)
        phi, delta, half_widths = (as_fractions(x) for x in (phi, delta, half_widths))
        for i, (c, g, nu) in enumerate(
            zip(*map(as_fractions, (functionals, result.weights, result.dual)), strict=True)
        ):
            exact = np.abs(g) @ delta + np.abs(c - phi.T @ g) @ half_widths
            assert exact <= Fraction(float(result.error[i]))
            assert np.all(np.abs(phi @ nu) <= delta)
            assert np.all(np.abs(nu) <= half_widths)
            assert c @ nu >= Fraction(float(result.lower_bound[i]))


def as_fractions(values) -> np.ndarray:
    values = np.asarray(values)
    return np.array([Fraction(float(x)) for x in values.ravel()]).reshape(values.shape)


@given(seeds)
def test_the_worst_case_is_attained_and_no_other_exceeds_it(seed):
    rng = np.random.default_rng(seed)
    phi, delta, half_widths = ordinary(rng)
    result = minimax(rows_from(phi, delta), jnp.asarray(half_widths))
    remainders = np.eye(3) - np.asarray(result.weights) @ phi
    shares = rng.uniform(-1, 1, (200, 43))
    for g, remainder, error in zip(
        np.asarray(result.weights), remainders, result.error, strict=True
    ):
        disturbance = delta * np.sign(g)
        offset = -half_widths * np.sign(remainder)  # θ − centre
        u = phi @ offset + disturbance
        np.testing.assert_allclose(g @ u - (remainder + phi.T @ g) @ offset, error, rtol=1e-9)
        errors = (shares[:, :40] * delta) @ g - (shares[:, 40:] * half_widths) @ remainder
        assert np.all(np.abs(errors) <= float(error))


@given(seeds)
def test_no_weights_at_all_are_better_than_the_floor(seed):
    """Weak duality: weights near and far from the optimum, and zero weights, have larger errors."""
    rng = np.random.default_rng(seed)
    phi, delta, half_widths = ordinary(rng)
    result = minimax(rows_from(phi, delta), jnp.asarray(half_widths))
    for size in 10.0 ** rng.uniform(-9, 0, 50):
        other = np.asarray(result.weights) + size * rng.normal(size=(3, 40))
        error = worst_case(other, phi, delta, half_widths, np.eye(3))
        assert np.all(error >= result.lower_bound)
    assert np.all(half_widths >= result.lower_bound)


@given(seeds)
def test_units_do_not_matter_and_more_rows_or_a_smaller_box_never_harm(seed):
    rng = np.random.default_rng(seed)
    phi, delta, half_widths = ordinary(rng)
    error = minimax(rows_from(phi, delta), jnp.asarray(half_widths)).error
    units = 2.0 ** rng.integers(-20, 20, 3)
    changed = minimax(rows_from(phi * units, delta), jnp.asarray(half_widths / units)).error
    np.testing.assert_allclose(changed * units, error, rtol=1e-9)
    fewer = rows_from(phi, delta, np.arange(40) < 30)
    assert np.all(minimax(fewer, jnp.asarray(half_widths)).error >= error * (1 - 1e-9))
    smaller = minimax(rows_from(phi, delta), jnp.asarray(half_widths * [0.5, 1.0, 0.9])).error
    assert np.all(smaller <= error * (1 + 1e-9))


@jax.jit
def both_values(rows, half_widths, functionals):
    result = minimax(rows, half_widths, Norm(functionals))
    return jnp.stack([result.error, result.lower_bound])


slopes_of_both_values = jax.jit(jax.jacrev(both_values, argnums=(0, 1, 2)))


def test_padding_changes_nothing_and_leaves_no_nan():
    phi, delta, half_widths = ordinary(np.random.default_rng(3))
    box, counts = jnp.asarray(half_widths), np.arange(40) < 35
    padded = rows_from(phi * counts[:, None], delta * counts, counts)
    result = minimax(padded, box)
    for i in range(3):
        expected = by_highs(phi[:35], delta[:35], half_widths, np.eye(3)[i])
        np.testing.assert_allclose(result.error[i], expected, rtol=1e-9)
    np.testing.assert_array_equal(result.weights[:, 35:], 0.0)
    # other values in a row of measure zero have no effect either
    loud = minimax(rows_from(phi, delta, counts), box)
    np.testing.assert_allclose(loud.error, result.error, rtol=1e-12)
    slopes = slopes_of_both_values(padded, box, jnp.eye(3))
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(slopes))


@pytest.mark.parametrize("problem", [ordinary, loose_box, fewer_rows_than_parameters])
def test_the_gradient_is_that_of_finite_differences(problem):
    """The gradient in all arguments agrees with central differences along random directions.

    The best of three steps counts. Between changes of the active rows the error is smooth.
    """
    rng = np.random.default_rng(11)
    phi, delta, half_widths = problem(rng)
    functionals = rng.normal(size=(3, 3)) / half_widths
    point = (rows_from(phi, delta), jnp.asarray(half_widths), jnp.asarray(functionals))
    slopes = jax.tree.leaves(slopes_of_both_values(*point))
    for _ in range(5):
        way = jax.tree.map(lambda x: x * rng.normal(size=x.shape), point)
        expected = sum(
            np.tensordot(slope, step, step.ndim)
            for slope, step in zip(slopes, jax.tree.leaves(way), strict=True)
        )
        misses = []
        for size in (1e-4, 1e-5, 1e-6):
            ahead, behind = (
                np.asarray(both_values(*jax.tree.map(lambda x, w, h=h: x + h * w, point, way)))
                for h in (size, -size)
            )
            misses.append(np.abs((ahead - behind) / (2 * size) - expected))
        assert np.all(np.min(misses, axis=0) <= 1e-5 * np.abs(expected))


def test_the_gradient_survives_a_batch():
    phi, delta, half_widths = ordinary(np.random.default_rng(4))
    rows, box = rows_from(phi, delta), jnp.asarray(half_widths)

    def least(scale):
        return minimax(eqx.tree_at(lambda r: r.delta, rows, scale * rows.delta), box).error[1]

    scales = jnp.array([0.5, 1.0, 2.0])
    together = jax.jit(jax.vmap(jax.grad(least)))(scales)
    for scale, slope in zip(scales, together, strict=True):
        weights = minimax(eqx.tree_at(lambda r: r.delta, rows, scale * rows.delta), box).weights
        np.testing.assert_allclose(slope, np.abs(weights[1]) @ delta, rtol=1e-12)


def test_rows_that_cannot_be_bounded_are_refused():
    phi, delta, half_widths = ordinary(np.random.default_rng(0))
    box = jnp.asarray(half_widths)
    delta[7] = 0.0
    with pytest.raises(ValueError, match=r"`rows` must have a finite δ .* but delta\[7\] is 0"):
        minimax(rows_from(phi, delta), box)
    with pytest.raises(ValueError, match="`half_widths` of the prior box must be finite"):
        minimax(rows_from(phi[8:], delta[8:]), box.at[0].set(0.0))
    single = jax.tree.map(lambda x: x.astype(jnp.float32), rows_from(phi, delta))
    with pytest.raises(ValueError, match="`rows` must be float64"):
        minimax(single, box)


def test_what_is_not_a_number_proves_nothing():
    """Traced values cannot be checked, so a row with NaN must not give a guarantee."""
    phi, delta, half_widths = ordinary(np.random.default_rng(0))
    phi[3, 1] = np.nan
    error, floor = both_values(rows_from(phi, delta), jnp.asarray(half_widths), jnp.eye(3))
    assert not np.any(error < half_widths)
    assert not np.any(floor > 0)
