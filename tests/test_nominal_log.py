"""The predicted nominal log against computations in NumPy and against a simulated run."""

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
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant

SERVO = motor.servo()


@pytest.fixture(scope="module")
def motion(figures):
    return read_trajectory(figures / "trajectory_minimax.csv")


def test_an_axis_that_follows_needs_the_input_of_the_middle_of_the_box(motion):
    """Position and input at some samples agree with a Taylor expansion from the knot before."""
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
    signals = run(plant, motor.controller(), SERVO, motion, sensor=IdealSensor()).signals
    log = nominal_log(system, motion, SERVO, motor.controller())
    # the two compilations differ in the last bits, and the loop keeps the difference small
    np.testing.assert_allclose(log.position, signals.position, atol=1e-12)
    np.testing.assert_allclose(log.input, signals.input, atol=1e-8)
    assert float(log.resolution) == SERVO.resolution


@pytest.mark.parametrize(
    ("controller", "tolerance"),
    [(None, 1e-8), (motor.controller(), 1e-3)],
    ids=["following", "controlled"],
)
def test_the_states_half_way_are_those_between_the_positions(motion, controller, tolerance):
    """States in the middle of a sample agree with differences of the positions.

    The velocity agrees with the mean velocity to 2e-4 m/s, which occurs where friction changes its
    sign. A second difference of positions is the mean acceleration of two samples, to 4e-9 (or 3e-4
    with the controller) m/s² in 98 % of all samples. The others have a jump of the jerk or a sign
    change of friction, a step of 2·F_c/M = 3.8 m/s² at the centre of the box, of which half appears
    in the mean.
    """
    log, states = nominal_log_model(motor.system(), motion, SERVO, controller)(motion)
    h = SERVO.period
    np.testing.assert_allclose(
        states.position, (log.position[1:] + log.position[:-1]) / 2, atol=1e-6
    )
    np.testing.assert_allclose(states.velocity, np.diff(log.position) / h, atol=3e-4)
    mean = (states.acceleration[1:] + states.acceleration[:-1]) / 2
    off = np.abs(np.diff(log.position, 2) / h**2 - mean)
    assert np.quantile(off, 0.98) < tolerance
    assert np.max(off) < 0.25 / 0.13
    assert np.max(np.abs(mean)) > 40.0


@pytest.mark.parametrize("controller", [None, motor.controller()], ids=["following", "controlled"])
def test_its_slope_is_that_of_finite_differences(motion, controller, key):
    closed = nominal_log_model(motor.system(), motion, SERVO, controller)

    @eqx.filter_jit
    def position(jerk):
        return closed(eqx.tree_at(lambda t: t.jerk, motion, jerk))[0].position[1000]

    direction = jax.random.normal(key, motion.jerk.shape)
    slope = float(jnp.vdot(jax.grad(position)(motion.jerk), direction))
    ends = [float(position(motion.jerk + sign * 0.01 * direction)) for sign in (1, -1)]
    assert (ends[0] - ends[1]) / 0.02 == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"period": 0.0}, "`period` of a servo must be positive"),
        ({"period": float("nan")}, "`period` of a servo must be positive"),
        ({"resolution": -1.0}, "`resolution` of a servo must be at least zero"),
        ({"resolution": float("nan")}, "`resolution` of a servo must be at least zero"),
        ({"delay": -1}, "`delay` of a servo must be at least zero"),
        ({"jitter": -1e-6}, "`jitter` of a servo must be at least zero"),
        ({"jitter": 1.1e-4}, "`jitter` of a servo must be 0.1 of its period at most"),
    ],
)
def test_a_servo_that_cannot_be_is_refused_when_it_is_made(wrong, sentence):
    with pytest.raises(ValueError, match=sentence):
        Servo(**({"period": 0.001} | wrong))


@pytest.mark.parametrize(
    ("period", "sentence"),
    [(0.0007, "`period` = 0.0007 s must divide"), (0.6, "`period` of a servo must be half")],
)
def test_a_period_that_no_log_of_the_motion_has_is_refused(motion, period, sentence):
    with pytest.raises(ValueError, match=sentence):
        nominal_log(motor.system(), motion, Servo(period))


def test_a_log_is_what_the_servo_reads_of_a_run(motion):
    """Positions are rounded to the nearest count, or exact without a resolution."""
    servo, exact = Servo(SERVO.period, 1e-5, delay=1, jitter=1e-5), Servo(SERVO.period, delay=1)
    plant = Plant(motor.system(), motor.TRUE_PARAMETERS, NoDisturbance())
    _, signals, log = run(plant, motor.controller(), servo, motion, substeps=2)
    np.testing.assert_array_equal(log.input, signals.input)
    read = np.asarray(signals.position)[::2]
    assert np.max(np.abs(log.position - read)) <= 0.5e-5 * (1 + 1e-9)
    counts = np.asarray(log.position) / 1e-5
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert (float(log.resolution), float(log.jitter)) == (1e-5, 1e-5)
    np.testing.assert_array_equal(exact.log(signals).position, read)
    # a command acts one sample period later; until then the first input acts
    assert float(signals.input[0]) == float(signals.input[1])
