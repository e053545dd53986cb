"""What a motion can be expected to guarantee, as something to minimise."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.design import optimal_motion as motion_design
from jaxid.design.guaranteed_criterion import GuaranteedError, expected_error
from jaxid.design.nominal_log import nominal_log
from jaxid.design.nominal_log import nominal_log_model as of_servo
from jaxid.identification.intervals import guaranteed_intervals, narrowed
from jaxid.io.files import read_trajectory
from jaxid.motion.task import Task
from jaxid.motion.violation import worst_violation
from jaxid.search.problem import Problem
from jaxid.search.restoration import interior_motion
from jaxid.search.slp import polish

FOLLOWING = motor.servo()
CONTROLLED = FOLLOWING._replace(controller=motor.controller())
QUICK = motion_design.GuaranteedEffort(starts=3, steps=1)
TASK = Task(motor.limits(), motor.boundary(), 60, motor.KNOT_PERIOD)
FLOOR = jnp.array([0.003375, 0.15842, 0.16690, 0.15])


def made(start, servo, largest=True):
    system = motor.system()
    narrow = narrowed(
        system, guaranteed_intervals(system, [nominal_log(system, start, servo)], 100).estimate
    )
    nominal_log_model = of_servo(system, start, servo)
    return GuaranteedError(system, narrow, nominal_log_model, FLOOR, 2.0, largest, 100)


@pytest.fixture(scope="module")
def start(figures):
    return read_trajectory(figures / "trajectory_infinity_N30.csv")


@pytest.fixture(scope="module")
def objective(start):
    return made(start, FOLLOWING)


def expected(trajectory, servo=FOLLOWING):
    system = motor.system()
    return guaranteed_intervals(
        system, [nominal_log(system, trajectory, servo)]
    ).estimate.half_length


@pytest.mark.parametrize("servo", [FOLLOWING, CONTROLLED], ids=["following", "controlled"])
def test_its_errors_are_those_that_the_log_of_the_motion_would_prove(start, servo):
    """To 0.3 %: its knots are fewer."""
    found = made(start, servo).errors(start, jnp.zeros(()))
    np.testing.assert_allclose(found, expected(start, servo), rtol=3e-3)


def test_without_smoothing_they_are_exactly_those(objective, start):
    """With the same knots; 3.4e-6 is left where several weights are best for the program."""
    system = motor.system()
    proved = guaranteed_intervals(
        system, [nominal_log(system, start, FOLLOWING)], 100
    ).estimate.bound
    np.testing.assert_allclose(objective.errors(start, jnp.zeros(())), proved, rtol=1e-5)


def test_it_is_the_largest_relative_error_or_their_sum(objective, start):
    relative = objective.errors(start, jnp.zeros(())) / FLOOR
    both = objective, made(start, FOLLOWING, largest=False)
    largest, total = (float(jnp.exp(o(start, jnp.zeros(())))) for o in both)
    assert largest == pytest.approx(float(jnp.max(relative)), rel=1e-12)
    assert total == pytest.approx(float(jnp.sum(relative)), rel=1e-12)


@pytest.mark.parametrize(
    ("servo", "largest"), [(FOLLOWING, True), (FOLLOWING, False), (CONTROLLED, True)]
)
def test_its_slope_is_that_of_the_least_error(start, key, servo, largest):
    """By finite differences along random jerks; the weights are optimal anew at each end.

    Measured: 6e-4 of the slope's size, from the widths of the brackets, which it holds fixed.
    """
    smoothing, objective = jnp.asarray(0.001), made(start, servo, largest)

    @eqx.filter_jit
    def value(jerk):
        return objective(eqx.tree_at(lambda t: t.jerk, start, jerk), smoothing)

    slope = jax.grad(value)(start.jerk)
    for direction in jax.random.normal(key, (4, 60)):
        step = 0.003 * direction
        change = float(value(start.jerk + step) - value(start.jerk - step)) / 2
        size = float(jnp.linalg.norm(slope) * jnp.linalg.norm(step))
        assert abs(change - float(slope @ step)) < 0.002 * size


@pytest.mark.parametrize("servo", [FOLLOWING, CONTROLLED], ids=["following", "controlled"])
def test_a_polish_for_it_improves_what_the_log_would_prove(start, servo):
    problem = Problem(made(start, servo), motor.limits(), motor.boundary())
    found = polish(problem, interior_motion(problem, 60, motor.KNOT_PERIOD), start, 10)
    assert problem.violation(found) <= 0
    before, after = (jnp.max(expected(motion, servo) / FLOOR) for motion in (start, found))
    assert float(after) < float(before) - 0.005  # 0.0130 after 120 programs


def test_of_several_starts_the_one_is_kept_that_becomes_the_best(figures, monkeypatch, key):
    """Searches that find what is in the files, instead of searching."""
    files = iter(["dbar", "infinity", "Fc"])

    def found(*arguments, **options):
        return motion_design.Design(
            read_trajectory(figures / f"trajectory_{next(files)}_N30.csv"), 0.0, ()
        )

    monkeypatch.setattr(motion_design, "design_motion", found)
    motion = motion_design.design_guaranteed(
        motor.system(), TASK, FLOOR, key, FOLLOWING, effort=QUICK, report=(said := []).append
    )
    assert len(said) == 4
    own = [
        float(jnp.max(expected(read_trajectory(figures / f"trajectory_{name}_N30.csv")) / FLOOR))
        for name in ("dbar", "infinity", "Fc")
    ]
    assert float(jnp.max(expected(motion) / FLOOR)) < min(own)


def test_a_parameter_without_a_target_does_not_count(start):
    alone = jnp.full(4, jnp.inf).at[1].set(FLOOR[1])
    trusting = FOLLOWING._replace(velocity_error=0.0)
    objective = expected_error(motor.system(), alone, start, trusting, jnp.asarray(2.0))
    value = float(jnp.exp(objective(start, jnp.zeros(()))))
    assert value == pytest.approx(float(expected(start)[1] / FLOOR[1]), rel=3e-3)
    half_way = jnp.asarray(1e-3)
    slope = jax.grad(lambda jerk: objective(eqx.tree_at(lambda t: t.jerk, start, jerk), half_way))
    assert np.all(np.isfinite(slope(start.jerk)))


def test_what_may_be_off_its_velocity_counts_with_the_larger_of_the_bounds(start):
    """No error is smaller with it; where the motion dwells at the threshold of δ, one is larger."""
    speed = jnp.asarray(2.0)
    bare, cautious = (
        expected_error(motor.system(), FLOOR, start, servo, speed).errors(start, jnp.zeros(()))
        for servo in (FOLLOWING._replace(velocity_error=0.0), FOLLOWING)
    )
    assert np.all(cautious >= bare * (1 - 1e-9))
    assert float(cautious[2]) > 1.005 * float(bare[2])


def test_a_design_that_does_not_gain_returns_its_start(figures, start):
    """A motion that has been polished to its end, and one polish of it that has no steps."""
    idle = motion_design.GuaranteedEffort(steps=0)
    padded = eqx.tree_at(
        lambda t: (t.jerk, t.durations),
        start,
        (jnp.append(start.jerk, 0.0), jnp.append(start.durations, 0.0)),
    )
    found = motion_design.design_guaranteed(
        motor.system(), TASK, FLOOR, padded, FOLLOWING, effort=idle
    )
    np.testing.assert_array_equal(found.jerk, start.jerk)


def test_a_start_outside_of_the_limits_is_walked_back(start):
    wild = eqx.tree_at(lambda t: t.jerk, start, 1.2 * start.jerk)
    found = motion_design.design_guaranteed(
        motor.system(), TASK, FLOOR, wild, FOLLOWING, effort=QUICK._replace(smoothings=(1e-3,))
    )
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
        motion_design.design_guaranteed(motor.system(), TASK, FLOOR, wrong(start), FOLLOWING)


def test_no_start_at_all_is_refused(key):
    none = motion_design.GuaranteedEffort(starts=0)
    with pytest.raises(ValueError, match="`starts` of an effort must be 1 or more, but is 0"):
        motion_design.design_guaranteed(motor.system(), TASK, FLOOR, key, FOLLOWING, effort=none)


@pytest.mark.parametrize("targets", [[1.0, 1.0, 1.0], [1.0, -1.0, 1.0, 1.0], [np.inf] * 4])
def test_targets_that_compare_nothing_are_refused(targets, key):
    with pytest.raises(ValueError, match=r"`targets` must be 4 positive numbers"):
        motion_design.design_guaranteed(motor.system(), TASK, targets, key, FOLLOWING)
