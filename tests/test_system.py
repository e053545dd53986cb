import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.axes import linear_motor as motor
from experiments.axes import one_link_arm as arm
from jaxid.design.criteria import LeastSquaresError
from jaxid.design.optimal_motion import optimal_motion
from jaxid.model.disturbance_bound import ConstantBound, NearbyVelocityBound, ScaledBound, SpeedBand
from jaxid.model.interval_arithmetic import Range, exactly
from jaxid.model.regressors import Constant, Viscous
from jaxid.model.system import System, Term, smoothed
from jaxid.motion.acceleration_limit import acceleration_limit
from jaxid.motion.limits import Limits, Via
from jaxid.motion.task import Task

TASK = Task(motor.limits(), motor.boundary(), intervals=60, period=0.01)
BOX = {"position": (-0.01, 0.4), "velocity": (-2.0, 2.0), "input": (-10.0, 10.0)}


def test_both_readings_of_18():
    assert acceleration_limit(motor.system(), **BOX)[1] == pytest.approx(400 / 9, rel=1e-14)
    # the printed reading, by Cauchy-Schwarz: max|f|₂·max|θ_φ|₂
    load = np.hypot(2.0, np.sqrt(2)) * np.linalg.norm([0.5, 0.5, 0.5])
    assert (10.0 - load) / 0.18 == pytest.approx(43.77, abs=0.01)


def test_asymmetric_inputs_give_asymmetric_accelerations():
    low, high = acceleration_limit(arm.system(), (-0.35, 1.75), (-5.0, 6.0), (-4.0, 5.0))
    load = 0.1 * 6 + 0.3 + 1.0 + 0.1
    assert float(low) == pytest.approx((-4.0 + load) / 0.08)
    assert float(high) == pytest.approx((5.0 - load) / 0.08)


def test_an_input_too_weak_for_friction_is_refused():
    with pytest.raises(
        ValueError, match=r"`input` = .* is too small: .* nothing remains for acceleration"
    ):
        acceleration_limit(motor.system(), (-0.01, 0.4), (-2.0, 2.0), (-1.5, 1.5))


def test_delta_is_33():
    speeds = jnp.array([-2.0, -0.1001, -0.1, 0.0, 0.1, 0.1001, 2.0])
    delta = motor.system().disturbance_bound(jnp.zeros(7), speeds)
    np.testing.assert_array_equal(delta, [0.15, 0.15, 0.25, 0.25, 0.25, 0.15, 0.15])


def test_softening_tends_to_the_exact_system():
    y, v = jnp.zeros(400), jnp.linspace(-2.0, 2.0, 400)
    exact, soft = motor.system(), smoothed(motor.system(), jnp.asarray(1e-5))
    np.testing.assert_allclose(
        soft.disturbance_bound(y, v), exact.disturbance_bound(y, v), atol=1e-6
    )
    for a, b in zip(soft.regressor_values(y, v), exact.regressor_values(y, v), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-4)


def test_acceleration_solves_the_regression_form(key):
    system = arm.system()
    y, v, u = jax.random.normal(key, (3,))
    a = system.acceleration(y, v, u, system.centre)
    back = sum(f * t for f, t in zip(system.regressors(y, v, a), system.centre, strict=True))
    assert back == pytest.approx(float(u))


@pytest.mark.parametrize(
    ("interval", "sentence"),
    [
        ((0.2, 0.1), r"`interval` of the term M .*lower end below its upper end.*\[0\.2, 0\.1\]"),
        ((0.0, 0.1), r"inertia M must be above zero"),
        ((float("nan"), 0.1), r"`interval` of the term M .*two finite ends"),
    ],
)
def test_a_bad_box_is_refused(interval, sentence):
    with pytest.raises(ValueError, match=sentence):
        System(
            (Term("M", "kg", interval), Term("B", "N s/m", (0.0, 1.0), Viscous())),
            ConstantBound(1.0),
        )


NAN, INF = float("nan"), float("inf")
STEP = SpeedBand(0.25, 0.15, 0.1)


@pytest.mark.parametrize(
    "bound",
    [ConstantBound(0.2), STEP, SpeedBand(0.25, 0.15, 0.1, 0.03), NearbyVelocityBound(STEP, 0.01)],
)
@pytest.mark.parametrize("factor", [1e-3, 1.0, 7.0])
def test_a_scaled_delta_is_that_multiple_everywhere(bound, factor):
    """Values and ranges are multiplied, also those of a multiple of a multiple."""
    y, v = jnp.linspace(0.0, 1.0, 41), jnp.linspace(-0.3, 0.3, 41)
    ranges = Range(y - 0.1, y), Range(v - 0.02, v + 0.01)
    for found, by in (
        (bound.scaled(factor), factor),
        (bound.scaled(2.0).scaled(factor), 2 * factor),
    ):
        np.testing.assert_allclose(found(y, v), by * bound(y, v), rtol=1e-14)
        for end, own in zip(found.range(*ranges), bound.range(*ranges), strict=True):
            np.testing.assert_allclose(end, by * own, rtol=1e-14)


@pytest.mark.parametrize("level", [0.0, -0.1, INF, NAN])
@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("level", ConstantBound),
        ("slow", lambda x: SpeedBand(x, 0.2, 0.1)),
        ("fast", lambda x: SpeedBand(0.2, x, 0.1)),
        ("factor", lambda x: ScaledBound(STEP, x)),
    ],
)
def test_a_delta_that_is_not_positive_is_refused(name, made, level):
    with pytest.raises(ValueError, match=f"`{name}` of a .* δ must be positive and finite, but is"):
        made(level)


@pytest.mark.parametrize("speed", [-0.1, INF, NAN])
@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("threshold", lambda x: SpeedBand(0.25, 0.15, x)),
        ("blend", lambda x: SpeedBand(0.25, 0.15, 0.1, x)),
        ("blend", lambda x: STEP.smoothed(jnp.array([0.0, x]))),
        ("reach", lambda x: NearbyVelocityBound(STEP, x)),
    ],
)
def test_a_delta_whose_speeds_would_make_it_too_small_is_refused(name, made, speed):
    """With a threshold of NaN, δ at rest would be the smaller δ of fast motions."""
    with pytest.raises(ValueError, match=f"`{name}` of a .* δ must be at least zero and finite"):
        made(speed)


@pytest.mark.parametrize(
    ("name", "interval", "sentence"),
    [
        ("velocity", (2.0, -2.0), r"`velocity` must have its lower end below"),
        ("velocity", (0.1, 2.0), r"`velocity` must contain zero"),
        ("input", (-10.0, float("inf")), r"`input` must have two finite ends"),
        ("jerk", (-1.0, 0.0), r"`jerk` must contain zero"),
    ],
)
def test_bad_limits_are_refused(name, interval, sentence):
    good = {**BOX, "acceleration": (-44.0, 44.0), "jerk": (-1000.0, 1000.0)}
    with pytest.raises(ValueError, match=sentence):
        Limits(**{**good, name: interval})


def test_a_bad_via_point_is_refused():
    with pytest.raises(ValueError, match="`at` must be a fraction"):
        Via(1.5, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="must not exceed `upper`"):
        Via(0.5, (0.1, 0.0, 0.0), (0.0, 0.0, 0.0))


def test_terms_must_start_with_the_inertia_and_differ_in_name():
    inertia, offset = Term("M", "kg", (1.0, 2.0)), Term("d", "N", (-1.0, 1.0), Constant())
    with pytest.raises(ValueError, match="must begin with the inertia"):
        System((offset, inertia), ConstantBound(1.0))
    with pytest.raises(ValueError, match="distinct names"):
        System((inertia, offset, offset), ConstantBound(1.0))


def test_an_unknown_parameter_is_named(key):
    with pytest.raises(ValueError, match="`target` must be one of M, B, Fc, dbar, but is 'mass'"):
        optimal_motion(TASK, LeastSquaresError(motor.system(), "mass"), key)


def test_single_precision_is_refused(key):
    system = jax.tree.map(lambda x: x.astype(jnp.float32), motor.system())
    with pytest.raises(ValueError, match=r"`criterion` must be float64.*float32"):
        optimal_motion(TASK, LeastSquaresError(system, "M"), key)


@pytest.mark.parametrize("threshold", [-0.1, 0.1])
@pytest.mark.parametrize("share", [-1.5, -0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.5])
@given(st.floats(1e-3, 0.05))
def test_a_cautious_bound_is_the_largest_within_reach(threshold, share, reach):
    """δ agrees with the maximum over a grid of velocities, which includes both thresholds."""
    velocity, bound = threshold + share * reach, SpeedBand(0.25, 0.15, 0.1)
    near = np.append(velocity + np.linspace(-reach, reach, 101), [-0.1, 0.1])
    near = near[np.abs(near - velocity) <= reach]
    expected = np.max(bound(jnp.zeros_like(near), jnp.asarray(near)))
    cautious, still = NearbyVelocityBound(bound, reach), jnp.zeros(())
    assert float(cautious(still, jnp.asarray(velocity))) == expected
    wide = cautious.range(exactly(still), exactly(velocity))
    assert float(wide.upper) == expected
    assert "off by up to" in cautious.describe("V", "m/s")
