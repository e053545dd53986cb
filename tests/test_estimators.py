"""All estimators: their guarantees hold, are above the lower bound and never exceed the box."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from adversaries import worst_case
from hypothesis import given
from hypothesis import strategies as st

from jaxid.loop.record import Record, Rows
from jaxid.model.disturbance_bound import ConstantBound
from jaxid.model.regressors import Constant, Viscous
from jaxid.model.system import System, Term
from jaxid.regression.estimate import Estimate, estimate, least_squares_estimate
from jaxid.regression.estimators import ESTIMATORS, Filtered, LeastSquares, Minimax
from jaxid.regression.filters import filtered, filtered_rows
from jaxid.regression.minimax import minimax
from jaxid.regression.worst_case import (
    Norm,
    affine_worst_case_error,
    bias,
    least_squares,
    worst_case_error,
)

seeds = st.integers(0, 10_000)
PERIOD = 2e-4
SYSTEM = System(
    (
        Term("M", "kg", (0.5, 1.5)),
        Term("B", "N s/m", (-0.1, 0.1), Viscous()),
        Term("d", "N", (-2.0, 4.0), Constant()),
    ),
    ConstantBound(1.0),
)
BOX = SYSTEM.half_widths


def random_rows(rng, n: int = 40) -> Rows:
    columns = tuple(jnp.asarray(rng.normal(size=n)) for _ in range(3))
    delta, measure = rng.uniform(0.1, 1.0, n), rng.uniform(0.5, 1.5, n)
    return Rows(columns, jnp.asarray(delta), jnp.asarray(measure))


def record_of(rows: Rows, theta, disturbance) -> Record:
    input = rows.regressors @ theta + disturbance
    return Record(rows, input, jnp.asarray(disturbance))


@eqx.filter_jit
def errors_of(estimator, rows):
    return affine_worst_case_error(estimator(rows, BOX), rows, BOX)


members = pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=list(ESTIMATORS))


def test_least_squares_is_the_same_as_ever_to_the_last_bit():
    rows = random_rows(np.random.default_rng(0))
    np.testing.assert_array_equal(ESTIMATORS["least_squares"](rows, BOX), least_squares(rows))
    record = record_of(rows, SYSTEM.upper, jnp.zeros(40))

    @jax.jit
    def as_ever(record):
        weights = least_squares(record.rows)
        return weights @ record.input, worst_case_error(weights, record.rows.delta)

    result = least_squares_estimate(record, SYSTEM)
    theta, bound = as_ever(record)
    np.testing.assert_array_equal(result.theta, theta)
    np.testing.assert_array_equal(result.bound, bound)
    general = estimate(record, SYSTEM, least_squares(rows))
    np.testing.assert_allclose(general.theta, result.theta, rtol=1e-12)
    np.testing.assert_allclose(general.bound, result.bound, rtol=1e-12)


@pytest.mark.parametrize("power", [0, 1, 2])
def test_weighted_least_squares_is_numpy_on_scaled_rows(power):
    rng = np.random.default_rng(power)
    rows = random_rows(rng)
    u = rng.normal(size=40)
    trust = np.sqrt(np.asarray(rows.measure) / np.asarray(rows.delta) ** power)
    expected = np.linalg.lstsq(trust[:, None] * np.asarray(rows.regressors), trust * u)[0]
    weights = LeastSquares(power)(rows, BOX)
    np.testing.assert_allclose(weights @ u, expected, rtol=1e-9)
    np.testing.assert_allclose(bias(weights, rows), np.zeros((3, 3)), atol=1e-12)


@members
def test_rows_without_a_measure_have_no_weight(estimator):
    rows = random_rows(np.random.default_rng(1))
    silent = Rows(rows.columns, rows.delta.at[:5].set(0.0), rows.measure.at[:5].set(0.0))
    weights = estimator(silent, BOX)
    assert np.all(np.isfinite(weights))
    np.testing.assert_array_equal(weights[:, :5], 0.0)


def middle(result):
    return (result.lower + result.upper) / 2


def before_the_data(result):
    """Return the largest half-width of the interval for any data."""
    return jnp.minimum(result.bound, (result.prior_upper - result.prior_lower) / 2)


@given(seeds)
def test_minimax_is_never_worse_than_any_other_nor_than_the_prior(seed):
    rows = random_rows(np.random.default_rng(seed))
    errors = {name: errors_of(estimator, rows) for name, estimator in ESTIMATORS.items()}
    floor = minimax(rows, BOX).lower_bound
    for error in (*errors.values(), BOX):
        assert np.all(errors["minimax"] <= error * (1 + 1e-12))
        assert np.all(floor <= error)
    assert np.all(errors["minimax"] < errors["least_squares"])


@members
def test_functionals_have_weights_of_their_own(estimator):
    rows = random_rows(np.random.default_rng(2))
    same = estimator(rows, BOX, Norm(jnp.eye(3)))
    np.testing.assert_allclose(same, estimator(rows, BOX), rtol=1e-12, atol=1e-15)
    functional = Norm(jnp.array([[1.0, -20.0, 0.5]]))
    error = affine_worst_case_error(estimator(rows, BOX, functional), rows, BOX, functional)
    assert minimax(rows, BOX, functional).lower_bound <= error


@members
def test_no_truth_is_outside_and_the_worst_one_is_at_the_end(estimator):
    """No interval misses the true parameters, and the worst case attains the bound.

    This includes biased weights, because the prior box is small.
    """
    rng = np.random.default_rng(3)
    rows = random_rows(rng)
    weights = estimator(rows, BOX)
    remainder = bias(weights, rows)

    @jax.jit
    def missed(theta, disturbance):
        result = estimate(record_of(rows, theta, disturbance), SYSTEM, weights)
        return jnp.abs(result.theta - theta), result.bound, result

    for _ in range(50):
        theta = SYSTEM.centre + BOX * rng.uniform(-1, 1, 3)
        error, bound, result = missed(theta, rows.delta * rng.uniform(-1, 1, 40))
        assert np.all(error <= bound)
        assert np.all((result.lower <= theta) & (theta <= result.upper))
        assert np.all(np.abs(middle(result) - theta) <= result.half_widths * (1 + 1e-12))
        assert np.all(result.half_widths <= before_the_data(result) * (1 + 1e-12))
    for i in range(3):
        theta = SYSTEM.centre - worst_case(remainder[i], BOX)
        error, bound, _ = missed(theta, worst_case(weights[i], rows.delta))
        np.testing.assert_allclose(error[i], bound[i], rtol=1e-9)


def test_minimax_uses_the_box_where_it_is_small():
    rows = random_rows(np.random.default_rng(3))
    assert np.max(np.abs(bias(Minimax()(rows, BOX), rows))) > 0.1


@members
def test_the_guarantee_before_the_data_is_that_of_the_emptiest_data(estimator):
    """With θ at the centre and Δ = 0 the interval has its largest length."""
    rows = random_rows(np.random.default_rng(4))
    record = record_of(rows, SYSTEM.centre, jnp.zeros(40))
    result = estimate(record, SYSTEM, estimator(rows, BOX))
    np.testing.assert_allclose(middle(result), SYSTEM.centre, atol=1e-12)
    np.testing.assert_allclose(result.half_widths, before_the_data(result), rtol=1e-12)
    np.testing.assert_allclose(
        before_the_data(result), np.minimum(errors_of(estimator, rows), BOX), rtol=1e-12
    )


def test_an_estimate_clipped_into_the_box_guarantees_less_than_the_middle_of_its_interval():
    lower, upper, bound = jnp.array([-1.0]), jnp.array([1.0]), jnp.array([3.0])
    truth = upper
    result = Estimate(truth - bound, bound, lower, upper)  # the error is equal to the bound
    assert np.abs(np.clip(result.theta, lower, upper) - truth) == 2.0
    assert np.abs(middle(result) - truth) <= before_the_data(result) == 1.0


@pytest.mark.parametrize("inner", [LeastSquares(), LeastSquares(2), Minimax()])
@pytest.mark.parametrize("bandwidth", [30.0, 1000.0])
def test_the_exact_error_of_filtered_data_is_below_that_of_the_paper(inner, bandwidth):
    """The sum over the unfiltered Δ is smaller than (29), and the worst case attains it."""
    rng = np.random.default_rng(6)
    rows = random_rows(rng)
    record = record_of(rows, SYSTEM.upper, rows.delta * rng.uniform(-1, 1, 40))
    passed = filtered(record, bandwidth, PERIOD)
    weights = Filtered(inner, bandwidth, PERIOD)(rows, BOX)
    through = estimate(record, SYSTEM, weights)
    after = estimate(passed, SYSTEM, inner(passed.rows, BOX))
    np.testing.assert_allclose(through.theta, after.theta, rtol=1e-7)
    assert np.all(through.bound <= after.bound * (1 + 1e-12))
    if isinstance(inner, LeastSquares):
        assert np.all(through.bound < 0.95 * after.bound)
    remainder = bias(weights, rows)
    for i in range(3):
        worst = record_of(
            rows,
            SYSTEM.centre - worst_case(remainder[i], BOX),
            worst_case(weights[i], rows.delta),
        )
        reached = estimate(filtered(worst, bandwidth, PERIOD), SYSTEM, inner(passed.rows, BOX))
        theta = SYSTEM.centre - worst_case(remainder[i], BOX)
        np.testing.assert_allclose(jnp.abs(reached.theta - theta)[i], through.bound[i], rtol=1e-7)


def test_least_squares_after_the_filter_is_the_bound_of_the_paper_and_above_the_exact_one():
    rng = np.random.default_rng(7)
    for _ in range(20):
        rows = random_rows(rng)
        passed = filtered_rows(rows, 300.0, PERIOD)
        paper = worst_case_error(least_squares(passed), passed.delta)
        exact = errors_of(Filtered(LeastSquares(), 300.0, PERIOD), rows)
        assert np.all(exact <= paper)
        assert np.all(exact >= minimax(rows, BOX).lower_bound)


def test_filtered_rows_are_those_of_the_filtered_record():
    rows = random_rows(np.random.default_rng(8))
    record = record_of(rows, SYSTEM.centre, rows.delta)
    for ours, theirs in zip(
        jax.tree.leaves(filtered_rows(rows, 300.0, PERIOD)),
        jax.tree.leaves(filtered(record, 300.0, PERIOD).rows),
        strict=True,
    ):
        np.testing.assert_allclose(ours, theirs, rtol=1e-14)


def test_a_batch_takes_any_estimator_as_a_value():
    rng = np.random.default_rng(9)
    batch = jax.tree.map(lambda *x: jnp.stack(x), *(random_rows(rng) for _ in range(3)))
    for estimator in (ESTIMATORS["weighted_2"], Filtered(Minimax(), 1000.0, PERIOD)):
        together = eqx.filter_jit(eqx.filter_vmap(errors_of, in_axes=(None, 0)))(estimator, batch)
        alone = [errors_of(estimator, jax.tree.map(lambda x, k=k: x[k], batch)) for k in range(3)]
        np.testing.assert_allclose(together, alone, rtol=1e-9)
