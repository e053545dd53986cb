"""The prior box and δ proposed from a jog: by the printed rule, and wide enough for the axis."""

import re

import jax.numpy as jnp
import numpy as np
import pytest

import jaxid as jd
from experiments.axes import linear_motor as motor
from jaxid.axis import cli
from jaxid.axis.file import read_axis
from jaxid.axis.prior import propose
from jaxid.axis.texts import example
from jaxid.identification.least_squares import fit_least_squares
from jaxid.io.recorded import Recorded
from jaxid.loop.closed_loop import run
from jaxid.loop.log import Log
from jaxid.motion.trajectory import uniform

PERIOD = motor.CONTROL_PERIOD
TRUTH = np.array(motor.TRUE_PARAMETERS)


@pytest.fixture(scope="module")
def jog():
    """Return the log of a motion there and back at constant speeds."""
    jerk = jnp.array([60.0, -60.0, 0.0, -60.0, 60.0, -60.0, 60.0, 0.0, 60.0, -60.0])
    motion = uniform(jnp.zeros(3), jerk, 0.06)
    return run(motor.plant(), motor.controller(), motor.servo(), motion).log


def test_a_fit_is_that_of_the_means_by_hand(jog):
    found = fit_least_squares(motor.system(), [jog])
    y, u = np.asarray(jog.position), np.asarray(jog.input)
    v = (y[2:] - y[:-2]) / (2 * PERIOD)
    friction = 2 / np.pi * np.arctan(1000.0 * v)
    columns = [np.diff(y, 2) / PERIOD**2, v, friction, np.ones_like(v), (u[1:] + u[:-1]) / 2]
    count = len(v) // 5
    *phi, rest = (c[: 5 * count].reshape(count, 5).mean(axis=1) for c in columns)
    theta = np.linalg.lstsq(np.stack(phi, axis=1), rest, rcond=None)[0]
    np.testing.assert_allclose(found.theta, theta, rtol=1e-8)
    np.testing.assert_allclose(found.residual, rest - np.stack(phi, axis=1) @ theta, atol=1e-8)
    # largest shift of the estimate: by a residual with the signs of the weights
    weights = np.linalg.pinv(np.stack(phi, axis=1))
    worst = np.max(np.abs(found.residual)) * np.sum(np.abs(weights), axis=1)
    np.testing.assert_allclose(found.shift, worst, rtol=1e-8)
    # two halves of the log as two logs: the mean across the cut is lost, and time still increases
    halves = [
        Log(jog.input[a:b], jog.position[a : b + 1], PERIOD, jog.resolution)
        for a, b in ((0, 1500), (1500, 3000))
    ]
    apart = fit_least_squares(motor.system(), halves)
    np.testing.assert_allclose(apart.theta, found.theta, rtol=0.02)
    assert np.all(np.diff(apart.time) > 0)


def test_a_log_that_does_not_tell_parameters_apart_is_not_fitted():
    n, speed = 1500, 0.5
    position = jnp.asarray(0.1 + speed * PERIOD * np.arange(n + 1))
    log = Log(jnp.full(n, 0.4), position, PERIOD, 0.0)
    with pytest.raises(ValueError, match=r"does not identify .*B and Fc and dbar separately"):
        fit_least_squares(motor.system(), [log])
    with pytest.raises(ValueError, match="more than 20 consecutive samples"):
        fit_least_squares(motor.system(), [Log(jnp.zeros(10), jnp.zeros(11), PERIOD, 0.0)])


def test_short_pieces_of_a_long_log_are_fitted_too(jog):
    """With many short segments, a mean has no more samples than a segment has."""
    pieces = [
        Log(jog.input[a : a + 150], jog.position[a : a + 151], PERIOD, jog.resolution)
        for a in range(0, 3000, 150)
    ]
    # 300 samples per mean of the whole log
    apart = fit_least_squares(motor.system(), pieces, means=10)
    assert apart.residual.size == 20 * (149 // 15)
    np.testing.assert_allclose(apart.theta[0], TRUTH[0], rtol=0.05)


def test_what_is_no_inertia_and_no_friction_is_not_proposed(tmp_path, jog):
    """Negative inertia and negative friction are refused.

    The causes here are an input of the wrong sign, and an axis that drives itself.
    """
    (tmp_path / "axis.toml").write_text(example("linear"))
    axis = read_axis(tmp_path / "axis.toml")
    y, u = np.asarray(jog.position), np.asarray(jog.input)
    with pytest.raises(
        ValueError, match=r"give M = -0\.\d+ V s²/m, but an inertia must be positive"
    ):
        propose(axis, Recorded(None, y[:-1], -u))
    driven = u - 20.0 * np.diff(y) / PERIOD
    with pytest.raises(
        ValueError, match=r"interval of B ends at -10\.\d+ V s/m, but a friction must be"
    ):
        propose(axis, Recorded(None, y[:-1], driven))


def test_a_proposal_holds_the_motor_and_its_disturbance(tmp_path, jog, capsys):
    (tmp_path / "axis.toml").write_text(example("linear"))
    axis = read_axis(tmp_path / "axis.toml")
    recorded = Recorded(None, np.asarray(jog.position)[:-1], np.asarray(jog.input))
    found = propose(axis, recorded)
    assert np.all((found.lower <= TRUTH) & (found.upper >= TRUTH))
    assert found.lower[0] > 0
    assert np.all(found.lower[1:3] >= 0)
    # cogging and low-speed friction: at most 0.25 V, not all of which occurs in the log
    assert 0.03 < found.delta < 0.35
    rows = np.stack([PERIOD * np.arange(3000), jog.input, jog.position[:-1]], axis=1)
    header = "time_s,input,position_m"
    np.savetxt(tmp_path / "jog.csv", rows, "%.17g", ",", header=header, comments="")
    cli.main(["prior", str(tmp_path / "axis.toml"), str(tmp_path / "jog.csv")])
    said = capsys.readouterr().out
    # the printed values are no smaller than the computed ones, and agree to four digits
    level = float(re.search(r"level = (\S+) V", said)[1])
    assert found.delta <= level <= found.delta * 1.001
    for name, low, high in zip(axis.system.names, found.lower, found.upper, strict=True):
        printed = re.search(rf"^ *{name} .* (\S+) +(\S+)$", said, re.M)
        at_least, at_most = map(float, printed.groups())
        assert at_least <= low <= at_least + 0.001 * abs(low)
        assert at_most - 0.001 * abs(high) <= high <= at_most
    assert "a heuristic, not a guarantee" in said


def test_an_encoder_that_is_too_coarse_for_a_fit_is_named(tmp_path):
    jerk = jnp.array([60.0, -60.0, 0.0, -60.0, 60.0, -60.0, 60.0, 0.0, 60.0, -60.0])
    motion = uniform(jnp.zeros(3), jerk, 0.06)
    coarse = jd.Servo(PERIOD, 5e-5)
    log = run(motor.plant(), motor.controller(), coarse, motion, sensor=motor.servo().sensor).log
    text = example("linear").replace("resolution = 0.5e-6", "resolution = 5e-5")
    (tmp_path / "axis.toml").write_text(text)
    recorded = Recorded(None, np.asarray(log.position[:-1]), np.asarray(log.input))
    with pytest.raises(ValueError, match=r"encoder is too coarse for a fit .*M = \S+ ± \S+ V s²/m"):
        propose(read_axis(tmp_path / "axis.toml"), recorded)
