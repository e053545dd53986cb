"""Closed loops: objectives through the loop, their gradients, and the motion of the axis."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.design.criteria import FilteredError, PerfectTracking, ThroughLoop
from jaxid.loop.closed_loop import ClosedLoop, SampledPlants, closed_loop, run
from jaxid.loop.controllers import PDFeedforward
from jaxid.loop.disturbances import AgainstTracking, NoDisturbance
from jaxid.loop.experiment import _run
from jaxid.loop.scenarios import Scenarios, every, random_parameters, vertices
from jaxid.loop.sensors import IdealSensor
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant
from jaxid.motion.feasibility import interior
from jaxid.motion.motion_space import motion_space
from jaxid.motion.trajectory import uniform
from jaxid.motion.violation import axis_violations
from jaxid.regression.error_of_motion import planned_error
from jaxid.regression.filtered_least_squares import filtered_least_squares
from jaxid.regression.worst_case import Norm
from jaxid.search.problem import Problem

H, T, TICKS = motor.CONTROL_PERIOD, motor.KNOT_PERIOD, 3000
SPEED, BLEND = 2.0, 0.005


def one_plant() -> Scenarios:
    theta = jnp.asarray(motor.TRUE_PARAMETERS)[None]
    return every(motor.system(), theta, [motor.plant().disturbance])


def ideal_loop(gain=1.0, repeats=1) -> ClosedLoop:
    controller = motor.controller()
    controller = eqx.tree_at(lambda c: c.gamma, controller, gain * controller.gamma)
    return ClosedLoop(controller, IdealSensor(), H, TICKS, repeats)


@eqx.filter_jit
def evaluated(objective, motion, smoothing=0.0):
    return objective(motion, jnp.asarray(smoothing))


@eqx.filter_jit
def apart(objective, motion, smoothing=0.0):
    return objective.each(motion, jnp.asarray(smoothing))


def error_of(index, bandwidth=300.0) -> FilteredError:
    # the index may be a traced array
    return FilteredError(Norm(jnp.eye(4)[index][None]), bandwidth, H)


@pytest.fixture(scope="module")
def space():
    return motion_space(motor.limits(), motor.boundary(), 60, T)


@pytest.fixture(scope="module")
def middle(space):
    inside = interior(motor.limits(), motor.boundary(), 60, T)
    return space.coordinates(inside.jerk)


def test_slopes_through_the_loop_are_those_of_finite_differences(space, middle):
    """Gradients of log J_f of M, B, F_c and d̄ agree with central differences to 1e-6 of |∇|.

    They are tested at 100 random motions, within the limits and far beyond; the best of four steps
    counts (at most 2e-8 was measured). Γ is that of the study, or 30,000 times that, for which the
    projection is active.
    """
    rng = np.random.default_rng(0)
    scenarios = one_plant()

    @jax.jit
    def value(h, z, direction, gain, index):
        objective = ThroughLoop(ideal_loop(gain), scenarios, error_of(index), SPEED, BLEND)
        return objective(space.trajectory(z + h * direction), jnp.asarray(0.001))

    slope = jax.jit(jax.grad(lambda z, gain, index: value(0.0, z, 0 * z, gain, index)))

    @jax.jit
    def projected(z, gain):
        _, signals = scenarios.map(lambda plant: ideal_loop(gain)(plant, space.trajectory(z)))
        ends = zip(signals.controller, motor.system().lower, motor.system().upper, strict=True)
        return jnp.any(jnp.stack([(hat == low) | (hat == high) for hat, low, high in ends]))

    active = 0
    for k in range(100):
        z = middle + 10 ** rng.uniform(-1.0, 0.3) * jnp.asarray(rng.normal(size=middle.size))
        direction = rng.normal(size=middle.size)
        direction = jnp.asarray(direction / np.linalg.norm(direction))
        gain, index = jnp.asarray((1.0, 3e4)[k % 2]), jnp.asarray(k // 2 % 4)
        gradient = slope(z, gain, index)
        errors = [
            abs(
                (value(h, z, direction, gain, index) - value(-h, z, direction, gain, index))
                / (2 * h)
                - gradient @ direction
            )
            for h in 10.0 ** np.arange(-7.0, -3.0)
        ]
        assert min(errors) <= 1e-6 * jnp.linalg.norm(gradient)
        active += bool(projected(z, gain))
    assert active >= 30


def test_slopes_of_the_limits_of_the_axis_are_those_of_finite_differences(space, middle):
    """Gradients of the penalties on position, velocity, input and input rate of two plants."""
    limits = eqx.tree_at(lambda x: x.input_rate, motor.limits(), jnp.array([-1000.0, 1000.0]))
    scenarios = every(
        motor.system(),
        vertices(motor.system())[jnp.array([3, 12])],
        [motor.plant().disturbance],
    )
    axis = SampledPlants(ideal_loop(), scenarios)
    problem = Problem(lambda trajectory, smoothing: 0.0, limits, motor.boundary(), axis)
    offset, direction = jax.random.normal(jax.random.key(1), (2, middle.size))

    @jax.jit
    def value(h):
        motion = space.trajectory(middle + 3.0 * offset + h * direction)
        excesses = problem.violations(motion)
        return jnp.stack([jnp.sum(jnp.maximum(c, 0.0) ** 2) for c in excesses])[-4:]

    assert jnp.all(value(0.0) > 0)
    slopes = jax.jit(jax.jacfwd(value))(0.0)
    ladder = [
        np.abs((value(h) - value(-h)) / (2 * h) - slopes) for h in 10.0 ** np.arange(-7.0, -3.0)
    ]
    assert np.all(np.min(ladder, axis=0) <= 1e-6 * (1e-9 + np.abs(slopes)))


@pytest.mark.parametrize("smoothing", [0.0, 0.001])
def test_no_nan_at_any_kink(smoothing):
    """Objective and penalties are finite, with finite gradients, at all kinks.

    They are at rest, where all regressors have kinks, and at the threshold speed of δ.
    """
    jerk = np.zeros(60)
    # rest for 0.2 s, then 0.05 m/s after 10 ms and 0.1 m/s after 20 ms
    jerk[[20, 21]] = 500.0, -500.0
    jerk[[40, 41]] = -500.0, 500.0
    motion = uniform(jnp.zeros(3), jnp.asarray(jerk), T)
    corners, kinds = vertices(motor.system())[:2], [NoDisturbance(), AgainstTracking(200.0)]
    scenarios = every(motor.system(), corners, kinds)
    objective = ThroughLoop(ideal_loop(), scenarios, error_of(0), SPEED, BLEND)
    problem = Problem(
        objective, motor.limits(), motor.boundary(), SampledPlants(ideal_loop(), scenarios)
    )

    def value(jerk):
        moved = eqx.tree_at(lambda t: t.jerk, motion, jerk)
        multipliers = jax.tree.map(jnp.ones_like, problem.violations(moved))
        return problem.lagrangian(moved, multipliers, jnp.asarray(1.0), jnp.asarray(smoothing))

    found, gradient = jax.jit(jax.value_and_grad(value))(motion.jerk)
    assert jnp.isfinite(found)
    assert jnp.all(jnp.isfinite(gradient))


def test_no_nan_where_the_axis_never_moves():
    """At rest P is singular and J undefined. An objective that does not need P has a gradient."""

    def value(jerk):
        motion = uniform(jnp.zeros(3), jerk, T)
        criterion = lambda record, _: jnp.mean(record.input**2)  # noqa: E731
        objective = ThroughLoop(ideal_loop(), one_plant(), criterion, SPEED, BLEND)
        return objective(motion, jnp.zeros(()))

    assert jnp.all(jnp.isfinite(jax.jit(jax.grad(value))(jnp.zeros(60))))


def test_the_objective_is_the_bound_that_identification_reports(motion):
    loop, scenarios = ideal_loop(repeats=2), one_plant()
    record, _ = loop(motor.plant(), motion)
    estimate = filtered_least_squares(record, motor.system(), 300.0, H)
    for index in range(4):  # one compilation: the index of the parameter is data
        objective = ThroughLoop(loop, scenarios, error_of(index), SPEED, BLEND)
        value = evaluated(objective, motion)
        assert float(jnp.exp(value)) == pytest.approx(float(estimate.bound[index]), rel=1e-12)
        rounded = evaluated(objective, motion, 1e-4)
        assert float(rounded - value) == pytest.approx(0.0, abs=0.01)


def test_worst_and_mean_over_scenarios(motion):
    several = every(motor.system(), vertices(motor.system())[::5], [motor.plant().disturbance])
    worst, mean = (
        ThroughLoop(ideal_loop(), several, error_of(0, 30.0), SPEED, BLEND, worst)
        for worst in (True, False)
    )
    exact = apart(worst, motion)
    assert float(evaluated(worst, motion)) == pytest.approx(float(jnp.max(exact)), rel=1e-12)
    assert float(evaluated(mean, motion)) == pytest.approx(float(jnp.mean(exact)))
    for smoothing in (1e-2, 1e-4):
        rounded = float(evaluated(worst, motion, smoothing))
        exact = float(jnp.max(apart(worst, motion, smoothing)))
        assert exact * (1 + 1e-12) <= rounded <= exact + smoothing / 2 * np.log(4)  # exact < 0


def test_any_function_of_the_record_is_an_objective(motion):
    """The objective is the mean of u², as for the copper loss. Value and gradient are checked."""
    objective = ThroughLoop(
        ideal_loop(), one_plant(), lambda record, _: jnp.mean(record.input**2), SPEED, BLEND
    )

    @jax.jit
    def value(h):
        return objective(
            eqx.tree_at(lambda t: t.jerk, motion, (1 + h) * motion.jerk), jnp.zeros(())
        )

    record, _ = ideal_loop()(motor.plant(), motion)
    assert float(value(0.0)) == pytest.approx(float(np.mean(np.square(record.input))))
    slope = float(jax.jit(jax.grad(value))(0.0))
    assert float(value(1e-5) - value(-1e-5)) / 2e-5 == pytest.approx(slope, rel=1e-6)


def test_perfect_tracking_without_a_filter_is_the_planned_error(motion):
    """With a bandwidth of 1e6 rad/s the error equals J* up to the coarser quadrature."""
    star = planned_error(motor.system(), motion)
    for index in range(3):
        objective = PerfectTracking(motor.system(), error_of(index, 1e6), SPEED, H, TICKS, 2)
        found = float(jnp.exp(evaluated(objective, motion)))
        assert found == pytest.approx(float(star[index]), rel=2e-3)
    slow = PerfectTracking(motor.system(), error_of(0, 30.0), SPEED, H, TICKS, 2)
    through = ThroughLoop(ideal_loop(repeats=2), one_plant(), error_of(0, 30.0), SPEED, BLEND)
    values = [float(jnp.exp(evaluated(f, motion))) for f in (slow, through)]
    assert values[0] == pytest.approx(values[1], rel=0.01)
    assert values[0] > 1.2 * star[0]


def test_the_envelope_is_what_the_plants_do_one_by_one(motion):
    system = motor.system()
    thetas = random_parameters(jax.random.key(3), system, 3)
    kinds = [AgainstTracking(200.0), NoDisturbance()]
    loop = ClosedLoop(motor.controller(), IdealSensor(), H, TICKS, 2, substeps=2)
    found = SampledPlants(loop, every(system, thetas, kinds))(motion)
    runs = []
    for theta in thetas:
        for disturbance in kinds:
            signals = loop(Plant(system, theta, disturbance), motion)[1]
            rate = np.diff(np.append(0.0, signals.input)) / H
            columns = (signals.position[1:], signals.velocity[1:], signals.input, rate)
            runs.append([np.reshape(x, (2, TICKS, -1)) for x in columns])
    for k, values in enumerate(found):
        each = np.stack([run[k] for run in runs])
        np.testing.assert_allclose(values.lower, each.min(axis=(0, 1, 3)), atol=1e-6)
        np.testing.assert_allclose(values.upper, each.max(axis=(0, 1, 3)), atol=1e-6)


def test_excess_of_the_axis_counts_every_side(motion):
    found = SampledPlants(ideal_loop(), one_plant())(motion)
    limits = motor.limits()
    position, velocity, input, rate = axis_violations(limits, found)
    assert jnp.max(velocity) > 0  # the motion touches this limit, so that the axis exceeds it
    assert jnp.max(velocity) == pytest.approx(float(jnp.max(jnp.abs(found.velocity.upper)) / 2 - 1))
    assert jnp.max(position) < 0
    assert jnp.max(input) < 0
    assert jnp.max(rate) < 0
    loose = eqx.tree_at(lambda x: x.input_rate, limits, None)
    assert len(axis_violations(loose, found)) == 3


def test_random_parameters_do_not_depend_on_their_number(key):
    few, many = (random_parameters(key, motor.system(), count) for count in (3, 8))
    np.testing.assert_array_equal(few, many[:3])
    box = np.asarray(motor.system().lower), np.asarray(motor.system().upper)
    assert np.all((box[0] <= np.asarray(many)) & (np.asarray(many) <= box[1]))


@pytest.mark.parametrize(("repeats", "substeps", "delay"), [(1, 1, 0), (2, 2, 1)])
def test_a_run_is_the_loop_with_its_log(motion, repeats, substeps, delay):
    """`run` is one program, the loop and the log are several."""
    servo = Servo(H, resolution=1e-6, delay=delay)
    controller = PDFeedforward(motor.system(), motor.system().centre, kp=2000.0, kd=20.0)
    kinds = {"sensor": IdealSensor(), "repeats": repeats, "substeps": substeps}
    found = run(motor.plant(), controller, servo, motion, **kinds)
    record, signals = closed_loop(controller, servo, motion, **kinds)(motor.plant(), motion)
    for name, values in signals._asdict().items():
        pair = getattr(found.signals, name), values
        for a, b in zip(*map(jax.tree.leaves, pair), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12, err_msg=name)
    np.testing.assert_allclose(found.record.rows.regressors, record.rows.regressors, atol=1e-9)
    np.testing.assert_array_equal(found.record.rows.measure, record.rows.measure)
    for values in jax.tree.map(lambda x: x.reshape(repeats, -1), found.signals.reference):
        np.testing.assert_array_equal(values, np.broadcast_to(values[:1], values.shape))
    log = servo.log(found.signals)
    assert eqx.tree_equal(found.log, log)
    rest = found.record.rows.regressors @ motor.plant().theta + found.record.disturbance
    np.testing.assert_allclose(rest, found.record.input, atol=1e-12 * np.abs(rest).max())


def test_a_run_of_another_period_or_resolution_needs_no_compilation(motion):
    controller = PDFeedforward(motor.system(), motor.system().centre, kp=2000.0, kd=20.0)
    run(motor.plant(), controller, Servo(H, resolution=1e-6), motion)
    before = _run._cache_size()
    run(motor.plant(), controller, Servo(H, resolution=2e-6, jitter=H / 100), motion)
    assert _run._cache_size() == before


def test_a_run_in_single_precision_is_refused(motion):
    half = eqx.tree_at(lambda m: m.jerk, motion, motion.jerk.astype(jnp.float32))
    controller = PDFeedforward(motor.system(), motor.system().centre, kp=2000.0, kd=20.0)
    with pytest.raises(ValueError, match="Argument `trajectory` must be float64"):
        run(motor.plant(), controller, Servo(H), half)
