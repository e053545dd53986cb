"""Functions that grad, jit and vmap can transform, and refusals of those that they cannot."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.design.criteria import FilteredError, LeastSquaresError, PerfectTracking, ThroughLoop
from jaxid.design.predicted_error import PredictedError
from jaxid.loop.closed_loop import ClosedLoop, run
from jaxid.loop.disturbances import NoDisturbance
from jaxid.loop.scenarios import every
from jaxid.loop.sensors import Encoder, IdealSensor
from jaxid.loop.servo import Servo
from jaxid.motion.task import Task
from jaxid.motion.trajectory import uniform
from jaxid.regression.filtered_least_squares import filtered_least_squares
from jaxid.regression.worst_case import infinity

H, T, TICKS = 1e-3, 0.01, 60  # s, s, number of samples: six intervals
MOTION = uniform(jnp.zeros(3), jnp.array([500.0, -300.0, -700.0, 400.0, 600.0, -500.0]), T)
LONGER = uniform(jnp.zeros(3), 60.0 * jnp.array([1.0, -1.0, -1.0, 1.0, 0.5, -0.5]), 0.1)
SYSTEM = motor.system()
NORM = infinity(SYSTEM.half_widths)
TASK = Task(motor.limits(), motor.boundary(), 6, T)


def loop(sensor) -> ClosedLoop:
    return ClosedLoop(motor.controller(), sensor, H, TICKS)


def final_position(sensor):
    """Return a function from jerk, θ and k₁ to the final position of the axis."""

    def of(jerk=MOTION.jerk, theta=jnp.asarray(motor.TRUE_PARAMETERS), k1=200.0):
        plant = eqx.tree_at(lambda p: p.theta, motor.plant(), theta)
        run = eqx.tree_at(lambda x: x.controller.k1, loop(sensor), k1)
        return run(plant, eqx.tree_at(lambda t: t.jerk, MOTION, jerk))[1].position[-1]

    return of


WAYS = {
    "grad": jax.grad,
    "jit of grad": lambda f: jax.jit(jax.grad(f)),
    "grad of jit": lambda f: jax.grad(jax.jit(f)),
    "jacfwd": jax.jacfwd,
    "vmap of grad": lambda f: lambda x: jax.vmap(jax.grad(f))(x[None]),
    "linearize": lambda f: lambda x: jax.linearize(f, x)[0],
}


@pytest.mark.parametrize("way", WAYS)
def test_a_gradient_through_an_encoder_is_refused(way, quick_compilation):
    with pytest.raises(ValueError, match="no derivative: use `IdealSensor`"):
        WAYS[way](final_position(Encoder(1e-6)))(MOTION.jerk)


@pytest.mark.parametrize(
    ("name", "value"), [("theta", jnp.asarray(motor.TRUE_PARAMETERS)), ("k1", jnp.asarray(200.0))]
)
def test_so_is_one_with_respect_to_plant_or_controller(name, value, quick_compilation):
    with pytest.raises(ValueError, match="`Encoder` reads"):
        jax.grad(lambda x: final_position(Encoder(1e-6))(**{name: x}))(value)


def test_what_an_encoder_reads_is_refused_without_a_loop_too():
    with pytest.raises(ValueError, match="use `IdealSensor`"):
        jax.grad(Encoder(0.1).quantise)(0.33)


def test_the_slope_through_an_ideal_sensor_is_that_of_finite_differences():
    value = jax.jit(final_position(IdealSensor()))
    slope = jax.grad(value)(MOTION.jerk)
    for k in (0, 3):
        step = jnp.zeros(6).at[k].set(1e-2)
        difference = (value(MOTION.jerk + step) - value(MOTION.jerk - step)) / 2e-2
        # atol: rounding of 0.01 m, divided by two steps of 0.01 m/s³
        np.testing.assert_allclose(slope[k], difference, rtol=1e-5, atol=1e-14)


def test_what_does_not_lead_through_the_encoder_keeps_its_slope(quick_compilation):
    seen = final_position(Encoder(1e-6))

    def value(x):
        return x**2 + seen() + seen(jax.lax.stop_gradient(x) * MOTION.jerk)

    assert jax.grad(value)(jnp.asarray(1.5)) == 3.0


def test_an_encoder_under_vmap_jit_and_scan_is_the_nearest_multiple(key):
    positions = jax.random.uniform(key, (7, 5), minval=-1.0, maxval=1.0)
    encoder, expected = Encoder(0.03), 0.03 * np.round(np.asarray(positions) / 0.03)
    np.testing.assert_array_equal(encoder.quantise(positions), expected)
    np.testing.assert_array_equal(jax.jit(jax.vmap(encoder.quantise))(positions), expected)
    scanned = jax.lax.scan(lambda _, y: (None, encoder.quantise(y)), None, positions)[1]
    np.testing.assert_array_equal(scanned, expected)
    several = jax.vmap(lambda q: Encoder(q).quantise(positions[0]))(jnp.array([0.03, 0.0]))
    np.testing.assert_array_equal(several, [expected[0], positions[0]])


def test_an_encoder_of_resolution_zero_is_exact_and_its_velocity_a_difference():
    """Readings agree with NumPy differences, and the closed loop has finite signals."""
    encoder, positions = Encoder(0.0), np.array([0.1, 0.12345678901, -0.3])
    memory, read = encoder.initial(jnp.asarray(0.1)), []
    for y in positions:
        measured, memory = encoder.read(memory, jnp.asarray(y), jnp.asarray(7.0), jnp.asarray(H))
        read.append(measured)
    np.testing.assert_array_equal([x.position for x in read], positions)
    differences = np.diff(positions, prepend=0.1) / H
    np.testing.assert_allclose([x.velocity for x in read], differences, rtol=1e-15)
    record, signals = loop(encoder)(motor.plant(), MOTION)
    fine, _ = loop(Encoder(1e-12))(motor.plant(), MOTION)
    assert jnp.all(jnp.isfinite(signals.position))
    # 1e-12 m / 1 ms = 1e-9 m/s, and k₂ is about 40 V s/m
    np.testing.assert_allclose(record.input, fine.input, atol=1e-6)
    with pytest.raises(ValueError, match="`resolution` of an encoder must be at least zero"):
        Encoder(-1e-6)


def error_of_record(record, smoothing):
    return FilteredError(NORM, 200.0, H)(record, smoothing)


def worst_plant():
    plants = every(SYSTEM, jnp.stack([0.9 * SYSTEM.centre, 1.1 * SYSTEM.centre]), [NoDisturbance()])
    return ThroughLoop(loop(IdealSensor()), plants, error_of_record, 2.0, 0.005)


def predicted():
    """Return the sum of predicted errors, which is smooth; its linear programs run outside JAX."""
    targets, servo = SYSTEM.half_widths, Servo(H, 1e-6)
    criterion = PredictedError(SYSTEM, targets, servo, motor.controller(), largest=False)
    return criterion.near(TASK, MOTION)


CRITERIA = {
    "least squares": lambda: LeastSquaresError(SYSTEM, NORM).near(TASK, MOTION),
    "perfect tracking": lambda: PerfectTracking(SYSTEM, error_of_record, 2.0, H, TICKS, repeats=2),
    "worst plant": worst_plant,
    "predicted": predicted,
    "own": lambda: lambda trajectory, smoothing: jnp.log(trajectory.extrema().velocity[1]),
}


@pytest.mark.parametrize("name", CRITERIA)
def test_vmap_of_a_criterion_and_of_its_slope_is_a_loop(name, quick_compilation):
    """Values and gradients for several motions under vmap equal those of a Python loop."""
    criterion, smoothing = CRITERIA[name](), jnp.asarray(1e-3)
    jerks = jnp.stack([share * MOTION.jerk for share in (1.0, 0.9, 0.7)])

    def value(jerk):
        return criterion(eqx.tree_at(lambda t: t.jerk, MOTION, jerk), smoothing)

    one = jax.jit(jax.value_and_grad(value))
    together = jax.jit(jax.vmap(jax.value_and_grad(value)))(jerks)
    apart = [one(jerk) for jerk in jerks]
    for found, expected in zip(together, zip(*apart, strict=True), strict=True):
        expected = np.stack(expected)
        assert np.all(np.isfinite(expected))
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * abs(expected).max())


def test_vmap_of_the_papers_identification_over_bandwidths_is_a_loop():
    record = run(motor.plant(), motor.controller(), Servo(H, 1e-6), LONGER).record
    bandwidths = jnp.array([50.0, 200.0, 800.0])
    one = jax.tree_util.Partial(lambda w: filtered_least_squares(record, SYSTEM, w, H))
    together = jax.vmap(one)(bandwidths)
    slope = jax.vmap(jax.grad(lambda w: one(w).bound[0]))(bandwidths)
    for k, w in enumerate(bandwidths):
        alone = one(float(w))
        for a, b in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
            np.testing.assert_allclose(a[k], b, rtol=1e-9)
        step = 1e-4 * float(w)
        bounds = [one(float(w) + s).bound[0] for s in (step, -step)]
        np.testing.assert_allclose(slope[k], (bounds[0] - bounds[1]) / (2 * step), rtol=1e-4)
