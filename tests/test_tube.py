"""The proved tube: no plant leaves it, and it is not much wider than the plants need."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from adversaries import square_wave

from experiments.axes import linear_motor as motor
from experiments.axes import one_link_arm as arm
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import ClosedLoop, SampledPlants
from jaxid.loop.controllers import ARC
from jaxid.loop.disturbances import AgainstTracking, NoDisturbance, random_shares
from jaxid.loop.scenarios import every, random_parameters, vertices
from jaxid.loop.sensors import Encoder, IdealSensor
from jaxid.loop.tube import Tube, _peak, parameter_cells
from jaxid.model.disturbance_bound import ConstantBound
from jaxid.model.interval_arithmetic import Range, around
from jaxid.motion.acceleration_limit import acceleration_reach
from jaxid.motion.feasibility import interior
from jaxid.motion.limits import Limits
from jaxid.motion.trajectory import uniform
from jaxid.search.problem import Problem

REPEATS = 2


def motor_law(**changes) -> ARC:
    gains = {"k1": 10.0, "k2": 60.0, "epsilon": 1.0, "gamma": jnp.zeros(4)} | changes
    return ARC(motor.system(), **gains)


def tube_of(motion, law, sensor, parts=(8, 4, 4, 4), period=motor.CONTROL_PERIOD, ticks=3000):
    return Tube(law, sensor, parameter_cells(law.system, parts), period, ticks, REPEATS)(motion)


def seen(motion, law, sensor, own, period=motor.CONTROL_PERIOD, ticks=3000):
    """Simulate corners and random points of Ω_θ with six disturbances and four steps per sample."""
    count = REPEATS * ticks
    kinds = [
        NoDisturbance(),
        own,
        AgainstTracking(law.k1),
        random_shares(jax.random.key(0), count),
        square_wave(count, 100),
        square_wave(count, 20),
    ]
    inner = random_parameters(jax.random.key(1), law.system, 16)
    thetas = jnp.concatenate([vertices(law.system), inner])
    loop = ClosedLoop(law, sensor, period, ticks, REPEATS, substeps=4)
    return SampledPlants(loop, every(law.system, thetas, kinds))(motion)


def share(seen: Range, tube: Range) -> float:
    """Return the largest deviation in half-widths of the tube; more than 1 is outside."""
    return float(jnp.max(abs(seen - tube.middle).upper / tube.half_width))


@pytest.fixture(scope="module")
def own():
    return motor.plant().disturbance


@pytest.fixture(scope="module")
def encoder():
    return Encoder(motor.ENCODER_RESOLUTION)


@pytest.fixture(scope="module")
def proved(motion, encoder):
    return tube_of(motion, motor_law(), encoder)


@pytest.fixture(scope="module")
def happened(motion, encoder, own):
    return seen(motion, motor_law(), encoder, own)


def test_no_plant_leaves_the_tube_within_ticks_either(proved, happened):
    """Position, velocity, input and its rate reach 0.91, 0.74, 0.95 and 0.18 of the half-width."""
    y, v, u, rate = (share(a, b) for a, b in zip(happened, proved, strict=True))
    assert max(y, v, u, rate) <= 1
    assert y > 0.85
    assert v > 0.7
    assert u > 0.9


def test_a_coarse_encoder_is_covered_and_fills_most_of_the_tube(motion, own):
    """Counts of 20 µm cause most of the input; 0.88 and 0.62 of the half-widths are reached.

    With half of the term for the encoder, the input would reach 1.36 of its half-width, the input
    rate 1.17.
    """
    coarse = Encoder(2e-5)
    tube, found = tube_of(motion, motor_law(), coarse), seen(motion, motor_law(), coarse, own)
    assert max(share(a, b) for a, b in zip(found, tube, strict=True)) <= 1
    assert share(found.input, tube.input) > 0.8


def test_a_narrower_tube_is_left(proved, happened):
    """If the tube is 10 % narrower, some plant leaves it, in position and in input."""
    for k in (0, 2):
        narrower = proved[k].middle + around(0.9 * proved[k].half_width)
        assert jnp.any(happened[k].upper > narrower.upper) or jnp.any(
            happened[k].lower < narrower.lower
        )


def test_it_holds_for_exact_sensors_and_is_narrower(motion, own, proved):
    tube = tube_of(motion, motor_law(), IdealSensor())
    found = seen(motion, motor_law(), IdealSensor(), own)
    assert max(share(a, b) for a, b in zip(found, tube, strict=True)) <= 1
    assert share(found.input, tube.input) > 0.95
    for exact, quantised in zip(tube, proved, strict=True):
        assert jnp.mean(exact.half_width) < jnp.mean(quantised.half_width)


@pytest.mark.parametrize(
    ("without", "worst"), [("encoder", "input"), ("disturbance", "input"), ("mass", "velocity")]
)
def test_a_tube_that_forgets_something_is_left(motion, own, encoder, without, worst):
    """Plants leave a tube without encoder errors, without δ, or for the lighter half of the box."""
    law, sensor = motor_law(), encoder
    forgetful, exact = law, encoder
    if without == "encoder":
        sensor, exact = Encoder(2e-5), IdealSensor()
    box = parameter_cells(law.system, (8, 4, 4, 4))
    if without == "disturbance":
        forgetful = eqx.tree_at(lambda c: c.system.disturbance_bound, law, replace_fn=_without)
    if without == "mass":
        box = eqx.tree_at(
            lambda c: (c.lower, c.upper),
            box,
            (box.lower[: len(box.lower) // 2], box.upper[: len(box.upper) // 2]),
        )
    tube = Tube(forgetful, exact, box, motor.CONTROL_PERIOD, 3000, REPEATS)(motion)
    found = seen(motion, law, sensor, own)
    assert share(getattr(found, worst), getattr(tube, worst)) > 1


def _without(bound):
    return eqx.tree_at(lambda d: (d.slow, d.fast), bound, (bound.slow / 1e3, bound.fast / 1e3))


def test_adaptation_widens_it_and_is_covered(motion, own, encoder):
    law = motor_law(k1=50.0, gamma=jnp.array(motor.ARC_GAINS["gamma"]) * 100)
    tube = tube_of(motion, law, encoder, (4, 2, 2, 2))
    found = seen(motion, law, encoder, own)
    assert max(share(a, b) for a, b in zip(found, tube, strict=True)) <= 1
    still = tube_of(motion, motor_law(k1=50.0), encoder, (4, 2, 2, 2))
    assert jnp.max(tube.input.upper) > jnp.max(still.input.upper)


def test_it_holds_for_a_rotary_axis_with_gravity():
    system = arm.system()
    law = ARC(system, k1=20.0, k2=6.0, epsilon=1.0, gamma=jnp.zeros(5))
    motion = interior(arm.limits(), arm.boundary(), 50, arm.KNOT_PERIOD)
    sensor, ticks = Encoder(arm.ENCODER_RESOLUTION), 2000
    tube = tube_of(motion, law, sensor, (4, 2, 2, 2, 2), arm.CONTROL_PERIOD, ticks)
    own = arm.plant().disturbance
    found = seen(motion, law, sensor, own, arm.CONTROL_PERIOD, ticks)
    shares = [share(a, b) for a, b in zip(found, tube, strict=True)]
    assert max(shares) <= 1
    assert shares[2] > 0.6


def test_it_holds_for_a_reference_that_begins_at_speed_and_jumps_back(own, encoder):
    """The axis starts at rest although the reference does not, and the motion is repeated."""
    law = motor_law(k1=50.0)
    motion = uniform(jnp.array([0.1, 0.3, 2.0]), jnp.full(20, -50.0), 0.01)
    tube = tube_of(motion, law, encoder, (4, 2, 2, 2), ticks=1000)
    found = seen(motion, law, encoder, own, ticks=1000)
    assert max(share(a, b) for a, b in zip(found, tube, strict=True)) <= 1
    assert share(found.velocity, tube.velocity) > 0.9


def test_smaller_cells_make_a_narrower_tube(motion, encoder, proved):
    coarse = tube_of(motion, motor_law(), encoder, (1, 1, 1, 1))
    for rough, fine in zip(coarse, proved, strict=True):
        assert jnp.all(rough.upper >= fine.upper - 1e-9)
        assert jnp.all(rough.lower <= fine.lower + 1e-9)


@pytest.mark.parametrize("name", ["M", "B", "Fc"])
def test_the_motions_that_are_called_proved_are(figures, name, encoder):
    """Every plant keeps position, velocity and input limits, and the motion all its own limits."""
    box = {"position": (-0.01, 0.4), "velocity": (-2.0, 2.0), "input": (-10.0, 10.0)}
    reach = acceleration_reach(motor.system(), **box)
    limits = Limits(acceleration=reach, jerk=(-1000.0, 1000.0), **box)
    parts = parameter_cells(motor.system(), (8, 4, 4, 4))
    tube = Tube(motor.provable_controller(), encoder, parts, motor.CONTROL_PERIOD, 3000, 3)
    problem = Problem(lambda trajectory, smoothing: 0.0, limits, motor.boundary(), tube)
    assert problem.violation(read_trajectory(figures / f"robust_proved_{name}_N30.csv")) <= 0


def test_gains_too_high_for_the_period_have_no_tube(motion, encoder):
    """With hK/M > 2 the sampled loop is unstable, and the tube is infinite."""
    tube = tube_of(motion, motor_law(k2=2000.0), encoder, (1, 1, 1, 1))
    assert jnp.isposinf(jnp.max(tube.input.upper))
    assert not jnp.any(jnp.isnan(tube.input.upper))


def test_cells_cover_the_box():
    system = arm.system()
    found = parameter_cells(system, (3, 2, 1, 2, 1))
    assert found.lower.shape == (12, 5)
    np.testing.assert_allclose(found.lower.min(axis=0), system.lower)
    np.testing.assert_allclose(found.upper.max(axis=0), system.upper)
    volume = np.prod(np.asarray(found.upper - found.lower), axis=1).sum()
    assert volume == pytest.approx(float(jnp.prod(system.upper - system.lower)))


def test_the_peak_between_two_ticks_is_that_of_the_steepest_admissible_path():
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 1.0, 2001)
    for _ in range(50):
        low, high = np.sort(rng.normal(size=2))
        start = rng.normal()
        end = start + rng.uniform(low, high)
        path = np.minimum(start + high * t, end - low * (1 - t))
        args = map(jnp.asarray, (start, end))
        found = _peak(*args, Range(jnp.asarray(low), jnp.asarray(high)), jnp.asarray(1.0))
        assert float(found) == pytest.approx(path.max(), abs=2e-3 * (high - low))
        assert float(found) >= path.max() - 1e-12


def test_a_wider_bound_makes_a_wider_tube(motion, encoder, proved):
    system = motor.system().with_disturbance_bound(ConstantBound(0.3))
    law = eqx.tree_at(lambda c: c.system, motor_law(), system)
    wider = tube_of(motion, law, encoder)
    assert jnp.max(wider.input.upper) > jnp.max(proved.input.upper)
