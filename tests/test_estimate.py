"""Least-squares intervals from a record: coverage for 1,000 plants, J_f against J*, refusals."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import uniform_in_box

from experiments.axes import linear_motor as motor
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import run
from jaxid.loop.disturbances import Cogging, Sequence, random_shares
from jaxid.loop.sensors import Encoder, IdealSensor
from jaxid.loop.simulate import Plant, simulate
from jaxid.motion.trajectory import reference
from jaxid.regression.error_of_motion import planned_error
from jaxid.regression.estimate import least_squares_estimate
from jaxid.regression.filtered_least_squares import filtered_least_squares
from jaxid.regression.filters import adjoint, filtered
from jaxid.regression.worst_case import least_squares

PERIOD, W = motor.CONTROL_PERIOD, motor.BANDWIDTH


@pytest.fixture(scope="module")
def nominal(motion):
    return run(motor.plant(), motor.controller(), motor.servo(), motion, repeats=3)[:2]


@pytest.mark.parametrize(("name", "index"), [("M", 0), ("B", 1), ("Fc", 2)])
def test_filtered_bound_is_within_two_per_cent_of_the_planned_one(name, index, figures):
    designed = read_trajectory(figures / f"trajectory_{name}.csv")
    record = run(motor.plant(), motor.controller(), motor.servo(), designed, repeats=3).record
    estimate = filtered_least_squares(record, motor.system(), W, PERIOD)
    ratio = estimate.bound[index] / planned_error(motor.system(), designed)[index]
    assert abs(ratio - 1) < 0.02


def test_bandwidth_reproduces_the_known_cost_of_a_slow_filter(nominal, motion):
    """J_f/J* of M at six bandwidths agrees to 6 % with another design for M, N = 30."""
    star = planned_error(motor.system(), motion)[0]
    known = {30.0: 1.46, 50.0: 1.23, 100.0: 1.08, 300.0: 1.013, 1000.0: 1.007, 5000.0: 1.006}
    for w, expected in known.items():
        ratio = filtered_least_squares(nominal[0], motor.system(), w, PERIOD).bound[0] / star
        assert ratio == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize("kind", ["adversarial", "random", "cogging"])
def test_no_truth_is_outside_for_a_thousand_random_plants(kind, nominal, motion):
    system = motor.system()
    desired = reference(motion, PERIOD, 3000)
    record = jax.tree.map(lambda x: x[:3000], nominal[0])
    weights = least_squares(filtered(record, W, PERIOD).rows)[0]
    adversary = Sequence(jnp.sign(adjoint(weights, W, PERIOD)))
    disturbance = {
        "adversarial": adversary,
        "random": random_shares(jax.random.key(3), 3000),
        "cogging": Cogging(0.06, [1.0, 3.0], [0.1, 0.05]),
    }[kind]

    @eqx.filter_jit
    def share_of_bound(thetas):
        def one(theta):
            plant = Plant(system, theta, disturbance)
            record, _ = simulate(plant, motor.controller(), Encoder(0.5e-6), desired, PERIOD)
            estimate = least_squares_estimate(filtered(record, W, PERIOD), system)
            return jnp.abs(estimate.theta - theta) / estimate.bound

        return jax.lax.map(one, thetas, batch_size=50)

    thetas = uniform_in_box(jax.random.key(7), system.lower, system.upper, 1000)
    shares = share_of_bound(thetas)
    assert jnp.max(shares) <= 1 + 1e-9
    if kind == "adversarial":  # the worst case nearly reaches the bound: it is not merely wide
        assert jnp.max(shares[:, 0]) > 0.9


def test_intervals_stay_inside_the_prior_box(nominal):
    estimate = filtered_least_squares(nominal[0], motor.system(), W, PERIOD)
    assert jnp.all(estimate.lower >= motor.system().lower)
    assert jnp.all(estimate.upper <= motor.system().upper)
    # only the bound of F_c is larger than the half-width of its prior interval
    narrower = estimate.bound < motor.system().half_widths
    np.testing.assert_array_equal(narrower, [True, True, False, True])


def test_single_precision_is_refused(nominal):
    single = jax.tree.map(lambda x: x.astype(jnp.float32), nominal[0])
    with pytest.raises(ValueError, match=r"`record` must be float64, but is float32"):
        filtered_least_squares(single, motor.system(), W, PERIOD)


def test_a_motion_that_tells_nothing_apart_is_refused():
    from jaxid.loop.controllers import OpenLoop
    from jaxid.motion.trajectory import States

    rest = States(jnp.full(500, 0.2), jnp.zeros(500), jnp.zeros(500))
    still = OpenLoop(jnp.full(500, motor.TRUE_PARAMETERS[3]))
    plant = Plant(motor.system(), motor.TRUE_PARAMETERS, Sequence(jnp.zeros(500)))
    record, _ = simulate(plant, still, IdealSensor(), rest, PERIOD)
    with pytest.raises(ValueError, match="cannot identify"):
        filtered_least_squares(record, motor.system(), W, PERIOD)
