"""What a motion can be expected to guarantee, as something to minimise."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import linear_motor as motor
from jaxid.admissible import inside
from jaxid.files import read_trajectory
from jaxid.guarantee import foreseen, identify_log, narrowed
from jaxid.guaranteed_error import GuaranteedError
from jaxid.polish import polish
from jaxid.problem import Problem

H, Q, TICKS = motor.CONTROL_PERIOD, motor.ENCODER_RESOLUTION, 3000
FLOOR = jnp.array([0.003375, 0.15842, 0.16690, 0.15])


@pytest.fixture(scope="module")
def start(figures):
    return read_trajectory(figures / "trajectory_infinity_N30.csv")


@pytest.fixture(scope="module")
def objective(start):
    system = motor.system()
    narrow = narrowed(system, identify_log(system, foreseen(system, start, H, Q), 100).estimate)
    return GuaranteedError(system, narrow, FLOOR, 2.0, H, Q, TICKS, 100)


def expected(trajectory):
    system = motor.system()
    return identify_log(system, foreseen(system, trajectory, H, Q)).estimate.half_length


def test_its_errors_are_those_that_the_log_of_the_motion_would_prove(objective, start):
    """To 0.3 %: its knots are fewer."""
    found = objective.errors(start, jnp.zeros(()))
    np.testing.assert_allclose(found, expected(start), rtol=3e-3)


def test_without_smoothing_they_are_exactly_those(objective, start):
    """With the same knots; 3.4e-6 is left where several weights are best for the program."""
    system = motor.system()
    proved = identify_log(system, foreseen(system, start, H, Q), 100).estimate.bound
    np.testing.assert_allclose(objective.errors(start, jnp.zeros(())), proved, rtol=1e-5)


def test_its_slope_is_that_of_the_least_error(objective, start, key):
    """By finite differences along random jerks; the weights are optimal anew at each end.

    Measured: 6e-4 of the slope's size, from the widths of the brackets, which it holds fixed.
    """
    smoothing = jnp.asarray(0.001)

    @eqx.filter_jit
    def value(jerk):
        return objective(eqx.tree_at(lambda t: t.jerk, start, jerk), smoothing)

    slope = jax.grad(value)(start.jerk)
    for direction in jax.random.normal(key, (4, 60)):
        step = 0.003 * direction
        change = float(value(start.jerk + step) - value(start.jerk - step)) / 2
        size = float(jnp.linalg.norm(slope) * jnp.linalg.norm(step))
        assert abs(change - float(slope @ step)) < 0.002 * size


def test_a_polish_for_it_improves_what_the_log_would_prove(objective, start):
    problem = Problem(objective, motor.limits(), motor.boundary())
    found = polish(problem, inside(problem, 60, motor.KNOT_PERIOD), start, 10)
    assert problem.violation(found) <= 0
    before, after = (jnp.max(expected(motion) / FLOOR) for motion in (start, found))
    assert float(after) < float(before) - 0.005  # 0.0130 after 120 programs
