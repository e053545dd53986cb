"""The feasible parameter set: it contains the true θ, is inside all estimates, and refutes δ."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from adversaries import exact_rows
from scipy.optimize import linprog

from experiments.axes import linear_motor as motor
from jaxid.identification.falsification import LEAST, MOST, smallest_factor
from jaxid.identification.feasible_parameter_set import feasible_set, projection
from jaxid.identification.interior_point import LeastDeviations
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.identification.regression_rows import RegressionRows, guaranteed_estimate, hats
from jaxid.identification.state_bounds import state_bounds
from jaxid.identification.unidentifiable import unidentifiable_directions
from jaxid.loop.closed_loop import run
from jaxid.loop.disturbances import NoDisturbance
from jaxid.loop.log import InconsistentLogError
from jaxid.loop.record import Record, Rows
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant
from jaxid.regression.estimate import estimate
from jaxid.regression.estimators import ESTIMATORS

H, Q = motor.CONTROL_PERIOD, motor.ENCODER_RESOLUTION
SYSTEM = motor.system()


@jax.jit
def data_set(key):
    """Return the true parameters, random rows of different scale, and all estimates from them."""
    keys = jax.random.split(key, 4)
    columns = jax.random.normal(keys[0], (4, 20)) / SYSTEM.half_widths[:, None]
    # two parameters are hardly excited
    columns = columns * jnp.array([1.0, 1.0, 0.2, 0.02])[:, None]
    delta = jnp.exp(jax.random.normal(keys[1], (20,)))
    theta = SYSTEM.lower + jax.random.uniform(keys[2], (4,)) * (SYSTEM.upper - SYSTEM.lower)
    disturbance = delta * jax.random.uniform(keys[3], (20,), minval=-1.0)
    rows = Rows(tuple(columns), delta, jnp.ones(20))
    record = Record(rows, theta @ columns + disturbance, disturbance)
    return (
        theta,
        record,
        [
            estimate(record, SYSTEM, estimator(rows, SYSTEM.half_widths))
            for estimator in ESTIMATORS.values()
        ],
    )


def ends(record):
    """Yield min θ_i and −max θ_i with |u − Φθ| ≤ δ in the box, by HiGHS."""
    phi, u = np.asarray(record.rows.regressors), np.asarray(record.input)
    delta = np.asarray(record.rows.delta)
    box = np.stack([SYSTEM.lower, SYSTEM.upper], axis=1)
    for c in (*np.eye(4), *-np.eye(4)):
        solution = linprog(
            c,
            A_ub=np.concatenate([phi, -phi]),
            b_ub=np.concatenate([delta + u, delta - u]),
            bounds=box,
            method="highs",
        )
        yield solution.fun


@pytest.mark.parametrize("part", range(4))
def test_it_holds_the_truth_and_no_estimator_knows_more(part):
    """For 1,000 random data sets the ends agree with linear programs from the definition.

    The set contains the true parameters and lies inside the intervals of all estimators.
    """
    size = np.asarray(SYSTEM.half_widths)
    for k, one in enumerate(jax.random.split(jax.random.key(part), 250)):
        theta, record, estimates = data_set(one)
        logged = exact_rows(SYSTEM, record)
        found = feasible_set(logged, estimates)
        assert np.all(found.lower <= theta)
        assert np.all(theta <= found.upper)
        for other in estimates:
            assert np.all(found.lower >= other.lower)
            assert np.all(found.upper <= other.upper)
        if k % 10 == 0:
            alone = feasible_set(logged)
            lower, upper = np.split(np.array(list(ends(record))), 2)
            np.testing.assert_allclose(alone.lower / size, lower / size, atol=1e-6)
            np.testing.assert_allclose(alone.upper / size, -upper / size, atol=1e-6)
            for other in estimates:
                assert np.all(alone.upper <= other.upper + 1e-6 * size)


def test_data_that_contradict_delta_are_found_out(key):
    """The smallest factor of δ agrees with a linear program from its definition."""
    _, record, _ = data_set(key)
    wrong = eqx.tree_at(lambda r: r.input, record, record.input.at[3].add(300.0))
    with pytest.raises(
        InconsistentLogError, match=r"No parameter vector of the prior box explains the data"
    ) as refused:
        feasible_set(exact_rows(SYSTEM, wrong))
    # the box depends on δ here, so that the message must not state a larger δ
    assert not re.search(r"\d", str(refused.value))
    factor = smallest_factor(lambda s: exact_rows(SYSTEM, times(wrong, s)))
    phi, u = np.asarray(record.rows.regressors), np.asarray(wrong.input)
    delta = np.asarray(record.rows.delta)[:, None]
    solution = linprog(
        [0.0, 0.0, 0.0, 0.0, 1.0],
        A_ub=np.block([[phi, -delta], [-phi, -delta]]),
        b_ub=np.concatenate([u, -u]),
        bounds=[*np.stack([SYSTEM.lower, SYSTEM.upper], axis=1), (0, None)],
        method="highs",
    )
    # a proved lower bound: not above the exact factor, and at most 0.11 % below it
    assert solution.fun / 1.0011 <= factor <= solution.fun * (1 + 1e-7)
    feasible_set(exact_rows(SYSTEM, times(wrong, 1.0021 * factor)))
    with pytest.raises(ValueError, match="No parameter vector of the prior box"):
        feasible_set(exact_rows(SYSTEM, times(wrong, 0.998 * factor)))
    # with a δ that is just large enough the data are consistent
    enough = times(wrong, 1.0001 * solution.fun)
    feasible_set(exact_rows(SYSTEM, enough))
    assert smallest_factor(lambda s: exact_rows(SYSTEM, times(enough, s))) <= 1.0
    # the search begins at 1; a factor far below it is found as well
    plenty = times(wrong, 3.0 * solution.fun)
    found = smallest_factor(lambda s: exact_rows(SYSTEM, times(plenty, s)))
    assert 1 / 1.0011 <= 3 * found <= 1 + 1e-7
    broken = eqx.tree_at(lambda r: r.input, record, record.input.at[3].add(1e6))
    assert smallest_factor(lambda s: exact_rows(SYSTEM, times(broken, s))) == MOST


def test_a_factor_beside_errors_that_it_does_not_multiply_is_no_larger_than_proved(key):
    """The factor multiplies only a part of the bound of each row.

    It agrees with a linear program.
    """
    delta, added = np.linspace(0.5, 1.5, 20), np.linspace(15.0, 5.0, 20)
    for one in jax.random.split(key, 5):
        _, record, _ = data_set(one)
        wrong = eqx.tree_at(lambda r: r.input, record, record.input.at[3].add(100.0))
        phi, u = np.asarray(record.rows.regressors), np.asarray(wrong.input)

        def rows(s, wrong=wrong):
            widened = eqx.tree_at(lambda r: r.rows.delta, wrong, s * delta + added)
            return RegressionRows(SYSTEM, widened, s * jnp.asarray(delta), {})

        solution = linprog(
            [0.0, 0.0, 0.0, 0.0, 1.0],
            A_ub=np.block([[phi, -delta[:, None]], [-phi, -delta[:, None]]]),
            b_ub=np.concatenate([added + u, added - u]),
            bounds=[*np.stack([SYSTEM.lower, SYSTEM.upper], axis=1), (0, None)],
            method="highs",
        )
        factor = smallest_factor(rows)
        assert LEAST < factor < MOST
        assert solution.fun / 1.0011 <= factor <= solution.fun * (1 + 1e-7)


def times(record, factor):
    return eqx.tree_at(lambda r: r.rows.delta, record, factor * record.rows.delta)


def test_what_the_data_cannot_tell_apart_is_named():
    """At constant acceleration inertia and offset are one force; at rest damping has no effect."""
    n = 20
    speed = jnp.zeros(n).at[0].set(1.0)
    columns = (jnp.full(n, 2.0), 0.0 * speed, speed, jnp.ones(n))
    record = Record(Rows(columns, jnp.full(n, 0.05), jnp.ones(n)), jnp.full(n, 0.3), None)
    found = unidentifiable_directions(exact_rows(SYSTEM, record))
    assert set(found) == {"M", "B"}
    size = SYSTEM.half_widths
    for name, combination in found.items():
        index = SYSTEM.index(name)
        np.testing.assert_allclose(combination[index], size[index])
        assert np.all(np.abs(combination) <= size)
        assert np.all(np.abs(record.rows.regressors @ combination) <= 0.05 * (1 + 1e-9))
    left = feasible_set(exact_rows(SYSTEM, record))
    np.testing.assert_allclose((left.upper - left.lower)[1], 2 * size[1], rtol=1e-12)
    assert np.all((left.upper - left.lower)[2:] < 1.2 * size[2:])
    assert np.count_nonzero(found["B"]) == 1
    np.testing.assert_allclose(found["M"], [0.05, 0.0, 0.0, -0.05], atol=1e-12)


@pytest.fixture(scope="module")
def experiment(motion):
    """Return a log, and the largest |Δ|/δ that acted in it."""
    record, _, log = run(motor.plant(), motor.controller(), Servo(H, Q), motion)
    share = float(jnp.max(jnp.abs(record.disturbance) / record.rows.delta))
    return log, share


def test_a_log_leaves_less_than_any_estimate_of_it(experiment):
    log, share = experiment
    found = guaranteed_intervals(SYSTEM, [log])
    rows = found.rows.record.rows
    others = [
        guaranteed_estimate(found.rows, estimator(rows, SYSTEM.half_widths))
        for estimator in ESTIMATORS.values()
    ]
    left = feasible_set(found.rows, [found.estimate, *others], knots=75)
    truth = np.asarray(motor.TRUE_PARAMETERS)
    assert np.all(left.lower <= truth)
    assert np.all(truth <= left.upper)
    for other in (found.estimate, *others):
        assert np.all(left.lower >= other.lower)
        assert np.all(left.upper <= other.upper)
    share_left = (left.upper - left.lower) / 2 / found.estimate.half_widths
    assert np.mean(share_left) < 0.9
    corners = projection(found.rows, "M", "B", knots=75)
    alone = feasible_set(found.rows, knots=75)
    np.testing.assert_allclose(corners.max(axis=0), alone.upper[:2], rtol=1e-3)
    np.testing.assert_allclose(corners.min(axis=0), alone.lower[:2], rtol=1e-3)

    def louder_rows(factor):
        system = SYSTEM.with_scaled_disturbance(factor)
        return hats(system, log, state_bounds(system, log))

    # the disturbance of the simulated plant is no larger than this share of δ
    assert smallest_factor(louder_rows, knots=75) <= share


def test_an_input_that_hides_a_force_is_falsified(motion):
    plant = Plant(SYSTEM, SYSTEM.centre, NoDisturbance())
    log = run(plant, motor.controller(), Servo(H, Q), motion).log
    time = jnp.arange(log.input.size) * H
    pulled = eqx.tree_at(lambda x: x.input, log, log.input + 1.5 * jnp.sin(80.0 * time))
    with pytest.raises(ValueError, match=r"no parameter vector of the prior box|inconsistent"):
        feasible_set(hats(SYSTEM, pulled, state_bounds(SYSTEM, pulled)), knots=75)


def test_a_solver_that_gives_up_leaves_the_box(experiment, monkeypatch):
    """If the linear program is not solved, the result is the prior box and no inconsistency."""
    log, _ = experiment
    rows = hats(SYSTEM, log, state_bounds(SYSTEM, log))
    monkeypatch.setattr(LeastDeviations, "minimum", lambda *arguments, **options: None)
    left = feasible_set(rows, knots=75)
    np.testing.assert_array_equal(left.lower, SYSTEM.lower)
    np.testing.assert_array_equal(left.upper, SYSTEM.upper)


def test_rows_that_count_nothing_leave_the_box(experiment):
    log, _ = experiment
    rows = hats(SYSTEM, log, state_bounds(SYSTEM, log))
    nothing = eqx.tree_at(lambda r: r.record.rows.measure, rows, 0 * rows.record.rows.measure)
    left = feasible_set(nothing, knots=75)
    np.testing.assert_array_equal(left.lower, SYSTEM.lower)
    np.testing.assert_array_equal(left.upper, SYSTEM.upper)
