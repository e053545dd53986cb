"""The log that is foreseen, against loops of NumPy and against a run."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.design.nominal_log import nominal_log, nominal_log_model
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import run
from jaxid.loop.disturbances import NoDisturbance
from jaxid.loop.sensors import IdealSensor
from jaxid.loop.simulate import Plant

SERVO = motor.servo()
CONTROLLED = SERVO._replace(controller=motor.controller())


@pytest.fixture(scope="module")
def motion(figures):
    return read_trajectory(figures / "trajectory_minimax.csv")


def test_an_axis_that_follows_needs_the_input_of_the_middle_of_the_box(motion):
    """From the knots on by Taylor's formula, tick by tick."""
    log = nominal_log(motor.system(), motion, SERVO)
    knots, theta = motion.knot_states(), np.asarray(motor.system().centre)
    for k in range(0, 3000, 97):
        i, into = divmod(k * SERVO.period, motor.KNOT_PERIOD)
        y, v, a = (float(x[int(i)]) for x in knots)
        j = float(motion.jerk[int(i)])
        t = into + SERVO.period / 2
        assert float(log.position[k]) == pytest.approx(
            y + v * into + a * into**2 / 2 + j * into**3 / 6, abs=1e-12
        )
        speed, acceleration = v + a * t + j * t**2 / 2, a + j * t
        friction = 2 / np.pi * np.arctan(1000 * speed)
        expected = theta @ [acceleration, speed, friction, 1.0]
        assert float(log.input[k]) == pytest.approx(expected, rel=1e-9)


def test_a_controlled_one_leaves_what_a_run_leaves(motion):
    system = motor.system()
    plant = Plant(system, system.centre, NoDisturbance())
    _, signals = run(plant, motor.controller(), IdealSensor(), motion, SERVO.period)
    log = nominal_log(system, motion, CONTROLLED)
    # compiled together with the rest of a log it differs in last bits, which a loop keeps small
    np.testing.assert_allclose(log.position, signals.position, atol=1e-12)
    np.testing.assert_allclose(log.input, signals.input, atol=1e-8)
    assert float(log.resolution) == SERVO.resolution


@pytest.mark.parametrize(
    ("servo", "tolerance"), [(SERVO, 1e-8), (CONTROLLED, 1e-3)], ids=["following", "controlled"]
)
def test_the_states_half_way_are_those_between_the_positions(motion, servo, tolerance):
    """Mean velocity and, from it, acceleration.

    In one tick in which friction turns, the mean of the ends is 2e-4 m/s off the mean velocity. A
    second difference of positions is that of the two states half-way, but for a knot of the jerk
    or a turn of friction in between: 4e-9 and 3e-4 m/s² in 98 % of all ticks. A turn is a step of
    2·F_c/M, 3.8 m/s² in the middle of the box, of which the mean of both states takes half.
    """
    log, states = nominal_log_model(motor.system(), motion, servo)(motion)
    h = servo.period
    np.testing.assert_allclose(
        states.position, (log.position[1:] + log.position[:-1]) / 2, atol=1e-6
    )
    np.testing.assert_allclose(states.velocity, np.diff(log.position) / h, atol=3e-4)
    mean = (states.acceleration[1:] + states.acceleration[:-1]) / 2
    off = np.abs(np.diff(log.position, 2) / h**2 - mean)
    assert np.quantile(off, 0.98) < tolerance
    assert np.max(off) < 0.25 / 0.13
    assert np.max(np.abs(mean)) > 40.0


@pytest.mark.parametrize("servo", [SERVO, CONTROLLED], ids=["following", "controlled"])
def test_its_slope_is_that_of_finite_differences(motion, servo, key):
    closed = nominal_log_model(motor.system(), motion, servo)

    @eqx.filter_jit
    def position(jerk):
        return closed(eqx.tree_at(lambda t: t.jerk, motion, jerk))[0].position[1000]

    direction = jax.random.normal(key, motion.jerk.shape)
    slope = float(jnp.vdot(jax.grad(position)(motion.jerk), direction))
    ends = [float(position(motion.jerk + sign * 0.01 * direction)) for sign in (1, -1)]
    assert (ends[0] - ends[1]) / 0.02 == pytest.approx(slope, rel=1e-5)


def test_a_servo_that_cannot_be_is_refused(motion):
    for wrong, word in (
        (SERVO._replace(period=0.0007), "`period` must divide"),
        (SERVO._replace(period=0.0), "`period` of a servo must be positive"),
        (SERVO._replace(period=float("nan")), "`period` of a servo must be positive"),
        (SERVO._replace(period=0.6), "`period` of a servo must be half"),
        (SERVO._replace(resolution=-1.0), "`resolution`"),
        (SERVO._replace(resolution=float("nan")), "`resolution`"),
        (SERVO._replace(velocity_error=-1.0), "`velocity_error`"),
        (SERVO._replace(velocity_error=float("inf")), "`velocity_error`"),
    ):
        with pytest.raises(ValueError, match=word):
            nominal_log(motor.system(), motion, wrong)
