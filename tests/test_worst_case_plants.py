"""Worst-case plants from a search: they are in the prior box and worse than random ones."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.loop.closed_loop import ClosedLoop, SampledPlants, plant_violations
from jaxid.loop.disturbances import AgainstTracking, NoDisturbance
from jaxid.loop.scenarios import every, random_scenarios, vertices
from jaxid.loop.sensors import IdealSensor
from jaxid.loop.worst_case_plants import find_worst_case_plants
from jaxid.motion.limits import Boundary, shrunk
from jaxid.motion.trajectory import uniform
from jaxid.motion.violation import worst_violation
from jaxid.search.problem import Problem

H, TICKS = motor.CONTROL_PERIOD, 3000


@pytest.fixture(scope="module")
def loop() -> ClosedLoop:
    return ClosedLoop(motor.provable_controller(), IdealSensor(), H, TICKS)


@pytest.fixture(scope="module")
def searched(loop, motion):
    return find_worst_case_plants(
        loop, motor.system(), motor.limits(), motion, jax.random.key(0), 12
    )


def test_plants_searched_for_keep_the_box_and_the_bound(searched):
    low, high = np.asarray(motor.system().lower), np.asarray(motor.system().upper)
    theta = np.asarray(searched.theta)
    assert np.all((low <= theta) & (theta <= high))
    assert jnp.all(jnp.abs(searched.disturbance.shares) <= 1)


def test_plants_searched_for_are_worse_than_random_ones(loop, motion, searched):
    """Velocity and input are more extreme, at both ends, than those of as many random plants."""
    kinds = [NoDisturbance(), AgainstTracking(10.0)]
    random = random_scenarios(jax.random.key(1), motor.system(), kinds, TICKS, 12)
    found, others = (SampledPlants(loop, plants)(motion) for plants in (searched, random))
    for mine, theirs in ((found.velocity, others.velocity), (found.input, others.input)):
        assert jnp.max(mine.upper) > jnp.max(theirs.upper)
        assert jnp.min(mine.lower) < jnp.min(theirs.lower)
    assert jnp.max(found.input.upper) > 1.1 * jnp.max(others.input.upper)


def test_excesses_are_those_of_the_envelope(loop, motion):
    """The largest excess over all plants agrees with the envelope, for limits moved inwards."""
    limits = shrunk(motor.limits(), jnp.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(limits.position, [0.0105, 0.3795], rtol=1e-12)
    np.testing.assert_allclose(limits.velocity, [-1.6, 1.6], rtol=1e-12)
    np.testing.assert_allclose(limits.input, [-7.0, 7.0], rtol=1e-12)
    plants = every(motor.system(), vertices(motor.system())[::5], [NoDisturbance()])
    found = np.asarray(plant_violations(loop, plants, limits, motion))
    assert found.shape == (4, 4)
    envelope = SampledPlants(loop, plants)(motion)
    half = [0.1845, 1.6, 7.0]
    low, high = [0.0105, -1.6, -7.0], [0.3795, 1.6, 7.0]
    for k in range(3):
        worst = max(
            float(jnp.max(envelope[k].upper) - high[k]), float(low[k] - jnp.min(envelope[k].lower))
        )
        assert found[:, k].max() == pytest.approx(worst / half[k], rel=1e-9)


def test_random_plants_do_not_depend_on_their_number():
    few, many = (
        random_scenarios(jax.random.key(2), motor.system(), [NoDisturbance()], 50, count)
        for count in (3, 6)
    )
    np.testing.assert_array_equal(few.theta, many.theta[:3])
    np.testing.assert_array_equal(
        few.disturbance.parts[1].shares, many.disturbance.parts[1].shares[:3]
    )
    assert len({float(x) for x in many.disturbance.parts[1].shares[:, 0]}) == 6


def test_a_loop_that_diverges_keeps_no_limit(motion):
    """Its signals become NaN, which a maximum over many values ignores on some processors."""
    wild = eqx.tree_at(lambda c: c.epsilon, motor.controller(), jnp.asarray(1e-4))
    loop = ClosedLoop(wild, IdealSensor(), H, TICKS)
    plants = every(motor.system(), vertices(motor.system())[:2], [NoDisturbance()])
    signals = plants.map(lambda plant: loop(plant, motion)[1])
    assert jnp.any(jnp.isnan(signals.position))
    assert jnp.all(plant_violations(loop, plants, motor.limits(), motion) > 0)
    problem = Problem(
        lambda t, s: 0.0, motor.limits(), motor.boundary(), SampledPlants(loop, plants)
    )
    assert problem.violation(motion) == jnp.inf
    assert jnp.all(jnp.isinf(SampledPlants(loop, plants)(motion).position.upper[-10:]))


def test_a_motion_that_is_no_number_keeps_no_limit():
    jerk = jnp.zeros(9000).at[5000].set(jnp.nan)
    motion = uniform(jnp.zeros(3), jerk, 1e-4)
    assert worst_violation(motor.limits(), Boundary((0.0, 0.0, 0.0), ()), motion) == jnp.inf
