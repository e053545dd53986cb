"""Residuals and their bounds: in a consistent log no residual exceeds its bound."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.identification.regression_rows import hats
from jaxid.identification.residuals import residuals
from jaxid.identification.state_bounds import state_bounds
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import run
from jaxid.loop.disturbances import AgainstTracking, NoDisturbance
from jaxid.loop.log import Log
from jaxid.loop.simulate import Plant

SYSTEM = motor.system()
SERVO = motor.servo()


@pytest.fixture(scope="module")
def motion(figures):
    return read_trajectory(figures / "trajectory_infinity_N30.csv")


def log_of(motion, theta, disturbance):
    return run(Plant(SYSTEM, theta, disturbance), motor.controller(), SERVO, motion).log


@pytest.mark.parametrize(
    "disturbance", [NoDisturbance(), AgainstTracking(10.0), AgainstTracking(-10.0)]
)
def test_no_residual_of_a_consistent_log_exceeds_its_bound(motion, key, disturbance):
    shares = jax.random.uniform(key, (4,))
    theta = SYSTEM.lower + shares * (SYSTEM.upper - SYSTEM.lower)
    logs = [log_of(motion, theta, disturbance), log_of(motion, theta, NoDisturbance())]
    found = residuals(SYSTEM, logs)
    assert np.max(np.abs(found.ratio)) <= 1
    # the θ of the residuals is in the prior box
    assert np.all((found.theta >= SYSTEM.lower) & (found.theta <= SYSTEM.upper))
    assert found.time.size == found.residual.size > 100
    assert np.all(np.diff(found.time) > 0)


def test_the_bound_is_that_of_the_weights_of_a_mean(motion):
    """Residual and bound agree with dense weights of one mean, and their worst-case error."""
    log = log_of(motion, SYSTEM.centre, AgainstTracking(10.0))
    found = residuals(SYSTEM, [log])
    rows = hats(SYSTEM, log, state_bounds(SYSTEM, log))
    w, step = found.half_width, max(found.half_width // 2, log.samples // 2000, 1)
    for k in (0, 17, found.bound.size - 1):
        weights = np.zeros(rows.record.rows.delta.size)
        for j in range(-w, w + 1):
            if abs(j) < w:
                weights[w - 1 + k * step + j] = (w - abs(j)) / w**2
        assert weights.sum() == pytest.approx(1.0)
        g = jnp.asarray(weights)[None]
        expected = g @ rows.record.rows.delta + rows.shared(g)
        assert found.bound[k] == pytest.approx(float(expected[0]), rel=1e-12)
        residual = weights @ (rows.record.input - rows.record.rows.regressors @ found.theta)
        assert found.residual[k] == pytest.approx(float(residual), abs=1e-9)


def test_a_force_above_delta_is_seen_where_it_acts(motion):
    log = log_of(motion, SYSTEM.centre, NoDisturbance())
    n = log.input.size
    pushed = log.input.at[2 * n // 3 :].add(0.9)
    wrong = Log(pushed, log.position, log.period, log.resolution)
    found = residuals(SYSTEM, [wrong], factor=6.0)
    beyond = np.abs(found.ratio) > 1
    assert beyond.any()
    assert found.residual[beyond & (found.time > 0.4)].max() > 0.3
