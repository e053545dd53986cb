"""The simulation against a NumPy loop and SciPy, and the exact regression identity."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from experiments._support.measured_records import differenced_record, printed_record
from experiments._support.pulses import pulses
from experiments.axes import linear_motor as motor
from experiments.axes import one_link_arm as arm
from jaxid.loop.controllers import ARC, OpenLoop
from jaxid.loop.disturbances import Cogging, Moment, NoDisturbance, random_shares
from jaxid.loop.sensors import Encoder, IdealSensor
from jaxid.loop.simulate import Plant, simulate
from jaxid.motion.feasibility import interior
from jaxid.motion.trajectory import States, reference, ticks
from jaxid.regression.estimate import least_squares_estimate
from jaxid.regression.filters import filtered

AXES = {"motor": motor, "arm": arm}


def arm_controller() -> ARC:
    return ARC(arm.system(), k1=60.0, k2=2.0, epsilon=0.3, gamma=jnp.full(5, 1e-3))


def desired_of(axis, period):
    intervals = 60 if axis is motor else 50
    trajectory = interior(axis.limits(), axis.boundary(), intervals, axis.KNOT_PERIOD)
    return reference(trajectory, period, ticks(trajectory, period))


@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize("halved", [False, True])
def test_identity_holds_for_every_filter(name, halved):
    """u_f = φ_fᵀθ + Δ_f to 1e-12 of max|u_f|, where u_f is filtered from the commanded input."""
    axis = AXES[name]
    period = axis.CONTROL_PERIOD / (2 if halved else 1)
    controller = motor.controller() if axis is motor else arm_controller()
    plant = axis.plant()
    encoder = Encoder(axis.ENCODER_RESOLUTION)
    record, signals = simulate(plant, controller, encoder, desired_of(axis, period), period)
    np.testing.assert_array_equal(record.input, signals.input)
    assert jnp.all(jnp.abs(record.disturbance) <= record.rows.delta)
    for bandwidth in (30.0, 300.0, 1000.0, 5000.0):
        passed = filtered(record, bandwidth, period)
        residual = passed.rows.regressors @ plant.theta + passed.disturbance - passed.input
        assert jnp.max(jnp.abs(residual)) <= 1e-12 * jnp.max(jnp.abs(passed.input))
        assert jnp.all(jnp.abs(passed.disturbance) <= passed.rows.delta * (1 + 1e-12))


def test_closed_loop_matches_a_numpy_loop(motion):
    """ARC, encoder and plant are written again without JAX, for 1,000 samples."""
    period, count = motor.CONTROL_PERIOD, 1000
    desired = jax.tree.map(lambda x: x[:count], reference(motion, period, 3000))
    encoder = Encoder(motor.ENCODER_RESOLUTION)
    record, signals = simulate(motor.plant(), motor.controller(), encoder, desired, period)
    position, velocity, inputs = numpy_loop(desired, period)
    np.testing.assert_allclose(signals.position, position, atol=1e-12)
    np.testing.assert_allclose(signals.velocity, velocity, atol=1e-10)
    np.testing.assert_allclose(record.input, inputs, atol=1e-8)


@pytest.mark.parametrize("name", AXES)
@pytest.mark.usefixtures("quick_compilation")
def test_the_plant_moves_as_an_independent_integrator_says(name):
    """For the same inputs, an adaptive eighth-order method of SciPy gives the same states.

    Four Ralston steps per sample differ from it by 7e-9 m and 4e-7 m/s for the motor, and by 2e-8
    rad and 6e-7 rad/s for the arm.
    """
    axis, count = AXES[name], 120
    period, controller = axis.CONTROL_PERIOD, motor.controller() if name == "motor" else None
    desired = jax.tree.map(lambda x: x[:count], desired_of(axis, period))
    plant = axis.plant()
    _, signals = simulate(
        plant, controller or arm_controller(), IdealSensor(), desired, period, substeps=4
    )
    moment = Moment(*(jnp.zeros(()) for _ in Moment._fields))

    @jax.jit
    def rate(state, u):
        y, v = state
        delta = plant.system.disturbance_bound(y, v)
        unknown = plant.disturbance(moment, y, v, delta)
        return jnp.stack([v, plant.system.acceleration(y, v, u - unknown, plant.theta)])

    state = np.array([float(desired.position[0]), 0.0])
    reached = []
    for u in np.asarray(signals.input):
        solved = solve_ivp(
            lambda _, x, u=u: rate(x, u), (0.0, period), state, "DOP853", rtol=1e-11, atol=1e-13
        )
        state = solved.y[:, -1]
        reached.append(state)
    positions, velocities = np.array(reached).T
    np.testing.assert_allclose(np.asarray(signals.position)[4::4], positions, atol=4e-8)
    np.testing.assert_allclose(np.asarray(signals.velocity)[4::4], velocities, atol=1e-6)


def numpy_loop(desired, h):
    theta = np.array(motor.TRUE_PARAMETERS)
    low, high = np.array([0.08, 0, 0, -0.5]), np.array([0.18, 0.5, 0.5, 0.5])
    gains = motor.ARC_GAINS
    gamma = np.array(gains["gamma"])
    hat = (low + high) / 2
    friction = lambda v: 2 / np.pi * np.arctan(1000.0 * v)  # noqa: E731
    delta = lambda v: 0.25 if abs(v) <= 0.1 else 0.15  # noqa: E731

    def acceleration(y, v, u):
        slow = 0.12 * np.exp(-((v / 0.03) ** 2)) * v / np.sqrt(v**2 + 0.003**2)
        angle = 2 * np.pi * y / 0.06
        disturbance = slow + 0.05 * np.sin(angle) + 0.02 * np.sin(3 * angle)
        return (u - theta[1] * v - theta[2] * friction(v) - theta[3] - disturbance) / theta[0]

    y, v = float(desired.position[0]), 0.0
    seen = 0.5e-6 * np.round(y / 0.5e-6)
    positions, velocities, inputs = [y], [v], []
    for y_d, v_d, a_d in np.stack(desired, axis=1):
        count = 0.5e-6 * np.round(y / 0.5e-6)
        v_m, seen = (count - seen) / h, count
        e, e_rate = count - y_d, v_m - v_d
        p = e_rate + gains["k1"] * e
        phi = np.array([a_d - gains["k1"] * e_rate, v_m, friction(v_m), 1.0])
        mismatch = np.abs(phi) @ (high - low) + delta(v_m)
        u = phi @ hat - gains["k2"] * p - mismatch**2 * p / (4 * gains["epsilon"])
        hat = np.clip(hat - h * gamma * phi * p, low, high)
        a1 = acceleration(y, v, u)
        v2 = v + 2 / 3 * h * a1
        a2 = acceleration(y + 2 / 3 * h * v, v2, u)
        y += h * (v / 4 + 3 / 4 * v2)
        v += h * (a1 / 4 + 3 / 4 * a2)
        positions.append(y)
        velocities.append(v)
        inputs.append(u)
    return np.array(positions), np.array(velocities), np.array(inputs)


def test_one_step_per_tick_is_as_good_as_ten(motion):
    desired = reference(motion, motor.CONTROL_PERIOD, 3000)
    runs = [
        simulate(motor.plant(), motor.controller(), IdealSensor(), desired, 2e-4, substeps)[1]
        for substeps in (1, 10)
    ]
    assert jnp.max(jnp.abs(runs[0].position - runs[1].position[::10])) < 1e-6
    np.testing.assert_allclose(runs[0].time, runs[1].time[::10], rtol=1e-12)
    assert jnp.max(jnp.abs(runs[0].input - runs[1].input)) < 0.05


def test_the_motors_disturbance_is_never_clipped(motion):
    """The disturbance of the study stays within ±δ before the plant clips it."""
    speeds, places = jnp.meshgrid(jnp.linspace(-2.1, 2.1, 801), jnp.linspace(-0.01, 0.4, 401))
    disturbance, system = motor.plant().disturbance, motor.system()
    zero = jnp.zeros(())
    moment = Moment(jnp.zeros((), int), zero, zero, zero)
    bound = system.disturbance_bound(places.ravel(), speeds.ravel())
    values = jax.vmap(lambda y, v, d: disturbance(moment, y, v, d))(
        places.ravel(), speeds.ravel(), bound
    )
    assert jnp.all(jnp.abs(values) <= bound)
    assert jnp.max(jnp.abs(values) / bound) > 0.5  # it is not negligible


def test_the_plant_keeps_an_exaggerated_disturbance_within_its_bound(motion):
    plant = Plant(motor.system(), motor.TRUE_PARAMETERS, Cogging(0.06, [1.0], [5.0]))
    desired = reference(motion, motor.CONTROL_PERIOD, 3000)
    record, _ = simulate(plant, motor.controller(), IdealSensor(), desired, motor.CONTROL_PERIOD)
    assert jnp.all(jnp.abs(record.disturbance) <= record.rows.delta)


def test_open_loop_repeats_the_prescribed_input():
    input = pulses(0.3, 0.15, 0.05, 1.0, 2e-4)
    rest = States(jnp.full(5000, 0.2), jnp.zeros(5000), jnp.zeros(5000))
    record, signals = simulate(motor.plant(), OpenLoop(input), IdealSensor(), rest, 2e-4)
    np.testing.assert_array_equal(record.input, input)
    assert signals.position[0] == 0.2
    assert set(np.unique(input)) == {-0.3, 0.0, 0.3}
    assert np.sum(input == 0.3) == 3 * 750
    assert np.sum(input == -0.3) == 2 * 750


def test_results_are_those_of_the_item_not_of_the_batch(motion, key):
    desired = reference(motion, motor.CONTROL_PERIOD, 3000)
    thetas = jnp.stack([motor.system().lower, motor.system().upper, motor.system().centre])

    def final(theta):
        plant = Plant(motor.system(), theta, random_shares(key, 3000))
        return simulate(plant, motor.controller(), IdealSensor(), desired, 2e-4)[1].position[-1]

    batch = jax.vmap(final)(thetas)
    np.testing.assert_allclose(batch, jnp.stack([final(t) for t in thetas]), rtol=1e-9, atol=1e-12)


def test_a_differenced_log_has_the_true_mean_velocity(motion):
    desired = reference(motion, motor.CONTROL_PERIOD, 3000)
    plant = Plant(motor.system(), motor.TRUE_PARAMETERS, NoDisturbance())
    record, signals = simulate(plant, motor.controller(), IdealSensor(), desired, 2e-4)
    log = differenced_record(motor.system(), record.input, signals.position, 2e-4)
    np.testing.assert_allclose(log.rows.columns[1], record.rows.columns[1], atol=1e-9)
    assert log.disturbance is None


def test_28_as_printed_is_biased_by_half_a_tick_of_the_filter(motion):
    """With (28) as printed, M̂ is about w·period/2 too small and outside (29).

    Here Δ = 0 and the positions are exact.
    """
    desired = reference(motion, motor.CONTROL_PERIOD, 3000)
    plant = Plant(motor.system(), motor.TRUE_PARAMETERS, NoDisturbance())
    record, signals = simulate(plant, motor.controller(), IdealSensor(), desired, 2e-4)
    system = motor.system()
    printed = printed_record(system, record.input, signals.position, 1000.0, 2e-4)
    estimate = least_squares_estimate(printed, system)
    assert float(estimate.theta[0]) / motor.TRUE_PARAMETERS[0] - 1 == pytest.approx(-0.09, abs=0.02)
    assert abs(estimate.theta[0] - motor.TRUE_PARAMETERS[0]) > 2 * estimate.bound[0]
    log = differenced_record(system, record.input, signals.position, 2e-4)
    consistent = least_squares_estimate(filtered(log, 1000.0, 2e-4), system)
    assert abs(consistent.theta[0] - motor.TRUE_PARAMETERS[0]) < 0.2 * consistent.bound[0]
