"""The predicted error of a motion as an objective: values, gradients and designs."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.design import optimal_motion as optimal_motion_file
from jaxid.design.criteria import LeastSquaresError
from jaxid.design.nominal_log import nominal_log, nominal_log_model
from jaxid.design.optimal_motion import optimal_motion
from jaxid.design.predicted_error import PredictedError, PredictedErrorNear
from jaxid.identification.intervals import guaranteed_intervals, narrowed
from jaxid.io.files import read_trajectory
from jaxid.motion.task import Task
from jaxid.motion.violation import worst_violation
from jaxid.regression.error_of_motion import planned_error
from jaxid.search.effort import Effort
from jaxid.search.problem import Design, Problem
from jaxid.search.restoration import interior_motion
from jaxid.search.slp import refined

SERVO = motor.servo()
LAWS = pytest.mark.parametrize("law", [None, motor.controller()], ids=["following", "controlled"])
QUICK = Effort(searches=3, predicted_programs=1)
TASK = Task(motor.limits(), motor.boundary(), 60, motor.KNOT_PERIOD)
FLOOR = jnp.array([0.003375, 0.15842, 0.16690, 0.15])


def made(start, law=None, largest=True):
    system = motor.system()
    narrow = narrowed(
        system, guaranteed_intervals(system, [nominal_log(system, start, SERVO, law)], 100).estimate
    )
    model = nominal_log_model(system, start, SERVO, law)
    return PredictedErrorNear(system, narrow, model, FLOOR, 2.0, largest, 100)


@pytest.fixture(scope="module")
def start(figures):
    return read_trajectory(figures / "trajectory_infinity_N30.csv")


@pytest.fixture(scope="module")
def objective(start):
    return made(start)


def expected(trajectory, law=None):
    system = motor.system()
    return guaranteed_intervals(
        system, [nominal_log(system, trajectory, SERVO, law)]
    ).estimate.half_widths


@LAWS
def test_its_errors_are_those_that_the_log_of_the_motion_would_prove(start, law):
    """The errors agree to 0.3 % with those of the nominal log, which have more knots."""
    found = made(start, law).errors(start, jnp.zeros(()))
    np.testing.assert_allclose(found, expected(start, law), rtol=3e-3)


def test_without_smoothing_they_are_exactly_those(objective, start):
    """With the same knots the errors agree to 3.4e-6, where several weights are optimal."""
    system = motor.system()
    proved = guaranteed_intervals(system, [nominal_log(system, start, SERVO)], 100).estimate.bound
    np.testing.assert_allclose(objective.errors(start, jnp.zeros(())), proved, rtol=1e-5)


def test_it_is_the_largest_relative_error_or_their_sum(objective, start):
    relative = objective.errors(start, jnp.zeros(())) / FLOOR
    both = objective, made(start, largest=False)
    largest, total = (float(jnp.exp(o(start, jnp.zeros(())))) for o in both)
    assert largest == pytest.approx(float(jnp.max(relative)), rel=1e-12)
    assert total == pytest.approx(float(jnp.sum(relative)), rel=1e-12)


@pytest.mark.parametrize(
    ("law", "largest"), [(None, True), (None, False), (motor.controller(), True)]
)
def test_its_slope_is_that_of_the_least_error(start, key, law, largest):
    """The gradient agrees with finite differences, with weights optimised again at each end.

    The measured difference is 6e-4 of the gradient. It comes from the widths of the state ranges,
    which the gradient holds fixed.
    """
    smoothing, objective = jnp.asarray(0.001), made(start, law, largest)

    @eqx.filter_jit
    def value(jerk):
        return objective(eqx.tree_at(lambda t: t.jerk, start, jerk), smoothing)

    slope = jax.grad(value)(start.jerk)
    for direction in jax.random.normal(key, (4, 60)):
        step = 0.003 * direction
        change = float(value(start.jerk + step) - value(start.jerk - step)) / 2
        size = float(jnp.linalg.norm(slope) * jnp.linalg.norm(step))
        assert abs(change - float(slope @ step)) < 0.002 * size


@LAWS
@pytest.mark.parametrize("smoothing", [0.0, 0.003])
def test_in_stages_it_has_the_same_value_and_slope_as_in_one_traced_function(start, law, smoothing):
    """The linear programs may choose other optimal weights, which differ by 3e-6 in the error."""
    objective, at = made(start, law), jnp.asarray(smoothing)
    traced = jax.value_and_grad(lambda j: objective(eqx.tree_at(lambda t: t.jerk, start, j), at))
    value, slope = traced(start.jerk)
    staged = objective.value_and_slope(start, at)
    assert float(staged[0]) == pytest.approx(float(value), abs=1e-5)
    np.testing.assert_allclose(staged[1], slope, rtol=0, atol=1e-3 * float(jnp.max(abs(slope))))


@LAWS
def test_a_polish_for_it_improves_what_the_log_would_prove(start, law):
    problem = Problem(made(start, law), motor.limits(), motor.boundary())
    found = refined(problem, interior_motion(problem, 60, motor.KNOT_PERIOD), start, 10)
    assert problem.violation(found) <= 0
    before, after = (jnp.max(expected(motion, law) / FLOOR) for motion in (start, found))
    assert float(after) < float(before) - 0.005  # 0.0130 after 120 programs


def test_of_several_starts_the_one_is_kept_that_becomes_the_best(figures, monkeypatch, key):
    """The searches are replaced by motions from the committed files."""
    files = iter(["dbar", "infinity", "Fc"])

    def found(*arguments, **options):
        return Design(read_trajectory(figures / f"trajectory_{next(files)}_N30.csv"), 0.0, ())

    monkeypatch.setattr(optimal_motion_file, "multistart", found)
    said = []
    design = designed(FLOOR, key, QUICK, report=lambda *step: said.append(step))
    assert len(said) == 4
    shares = [share for _, share in said]
    assert shares == sorted(shares)
    own = [
        float(jnp.max(expected(read_trajectory(figures / f"trajectory_{name}_N30.csv")) / FLOOR))
        for name in ("dbar", "infinity", "Fc")
    ]
    assert float(jnp.max(expected(design.trajectory) / FLOOR)) < min(own)
    assert len(design.history) == 4
    assert design.value == min(design.history)


def criterion(targets=FLOOR, velocity_error=motor.VELOCITY_ERROR):
    return PredictedError(motor.system(), targets, SERVO, velocity_error=velocity_error)


def designed(targets, start, effort=QUICK, **options):
    return optimal_motion(TASK, criterion(targets), start, effort=effort, **options)


def test_a_parameter_without_a_target_does_not_count(start):
    alone = jnp.full(4, jnp.inf).at[1].set(FLOOR[1])
    objective = criterion(alone, 0.0).near(TASK, start)
    value = float(jnp.exp(objective(start, jnp.zeros(()))))
    assert value == pytest.approx(float(expected(start)[1] / FLOOR[1]), rel=3e-3)
    half_way = jnp.asarray(1e-3)
    slope = jax.grad(lambda jerk: objective(eqx.tree_at(lambda t: t.jerk, start, jerk), half_way))
    assert np.all(np.isfinite(slope(start.jerk)))


def test_what_may_be_off_its_velocity_counts_with_the_larger_of_the_bounds(start):
    """With a velocity error no predicted error is smaller.

    One is larger, because the motion dwells at the threshold of δ.
    """
    bare, cautious = (
        criterion(FLOOR, error).near(TASK, start).errors(start, jnp.zeros(()))
        for error in (0.0, motor.VELOCITY_ERROR)
    )
    assert np.all(cautious >= bare * (1 - 1e-9))
    assert float(cautious[2]) > 1.005 * float(bare[2])


def test_a_design_that_does_not_gain_returns_its_start(start):
    """A refinement with zero programs returns the start, without its padding."""
    padded = eqx.tree_at(
        lambda t: (t.jerk, t.durations),
        start,
        (jnp.append(start.jerk, 0.0), jnp.append(start.durations, 0.0)),
    )
    found = designed(FLOOR, padded, Effort(predicted_programs=0)).trajectory
    np.testing.assert_array_equal(found.jerk, start.jerk)


def test_a_start_outside_of_the_limits_is_walked_back(start):
    wild = eqx.tree_at(lambda t: t.jerk, start, 1.2 * start.jerk)
    found = designed(FLOOR, wild, QUICK._replace(predicted_smoothings=(1e-3,))).trajectory
    assert float(worst_violation(TASK.limits, TASK.boundary, wild)) > 0.1
    assert float(worst_violation(TASK.limits, TASK.boundary, found)) <= 0


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (lambda t: eqx.tree_at(lambda t: t.jerk, t, t.jerk.at[3].add(20.0)), "but misses one by"),
        (lambda t: eqx.tree_at(lambda t: t.start, t, t.start + 0.01), "`start` must begin in"),
        (lambda t: eqx.tree_at(lambda t: t.durations, t, 2 * t.durations), "60 intervals of 0.01"),
        (
            lambda t: eqx.tree_at(
                lambda t: (t.jerk, t.durations), t, (t.jerk[:59], t.durations[:59])
            ),
            "60 intervals of 0.01 s like the task, but has 59",
        ),
    ],
)
def test_a_start_for_another_task_is_refused(start, wrong, sentence):
    with pytest.raises(ValueError, match=sentence):
        designed(FLOOR, wrong(start))


def test_no_search_at_all_is_refused(key):
    with pytest.raises(ValueError, match="`searches` of an effort must be 1 or more, but is 0"):
        designed(FLOOR, key, Effort(searches=0))


def test_any_criterion_improves_a_given_motion_and_never_makes_it_worse(start):
    """`optimal_motion` accepts a criterion and a function of the motion, from the same start."""
    quick = Effort(newton_rounds=1, newton_steps=2, programs=2)
    squares = LeastSquaresError(motor.system(), "B")
    for own in (squares, squares.near(TASK, start)):
        found = optimal_motion(TASK, own, start, effort=quick)
        assert found.value == found.history[-1] <= found.history[0]
        assert float(worst_violation(TASK.limits, TASK.boundary, found.trajectory)) <= 0
    assert found.history[0] == pytest.approx(
        float(jnp.log(planned_error(motor.system(), start)[1])), rel=1e-3
    )


@pytest.mark.parametrize("targets", [[1.0, 1.0, 1.0], [1.0, -1.0, 1.0, 1.0], [np.inf] * 4])
def test_targets_that_compare_nothing_are_refused(targets, key):
    with pytest.raises(ValueError, match=r"`targets` must be 4 positive numbers"):
        designed(targets, key)
