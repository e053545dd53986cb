"""The second axis through the whole chain: rotary, asymmetric limits, gravity."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import uniform_in_box

from jaxid import one_link_arm as arm
from jaxid.bound import least_squares
from jaxid.control import ARC, PDFeedforward
from jaxid.design import Effort
from jaxid.disturbance import Sequence
from jaxid.experiment import design_motion, identify, run
from jaxid.filters import adjoint, filtered
from jaxid.limits import worst_excess
from jaxid.objective import planned_error
from jaxid.problem import Task
from jaxid.sensing import Encoder, IdealSensor
from jaxid.simulate import Plant

W = 500.0


@pytest.mark.usefixtures("quick_compilation")
def test_from_design_to_identified_interval(key):
    system, limits, boundary = arm.system(), arm.limits(), arm.boundary()
    effort = Effort(
        starts=16, generations=0, stages=2, rounds=1, variations=16, parents=4, polished=1
    )
    design = design_motion(
        system, Task(limits, boundary, 50, arm.KNOT_PERIOD), "G", key, effort=effort
    )
    trajectory = design.trajectory
    assert worst_excess(limits, boundary, trajectory) <= 0
    star = planned_error(system, trajectory)
    assert star[3] < system.half_widths[3] / 2

    law = ARC(system, k1=60.0, k2=2.0, epsilon=0.3, gamma=jnp.full(5, 1e-3))
    sensor = Encoder(arm.ENCODER_RESOLUTION)
    record, signals = run(arm.plant(), law, sensor, trajectory, arm.CONTROL_PERIOD)
    error = signals.position[:-1] - signals.reference.position
    assert jnp.max(jnp.abs(error)) < 0.02
    estimate = identify(record, system, W, arm.CONTROL_PERIOD)
    truth = jnp.asarray(arm.TRUE_PARAMETERS)
    assert jnp.all((estimate.lower <= truth) & (truth <= estimate.upper))
    np.testing.assert_allclose(estimate.bound, star, rtol=0.15)

    # the worst Δ for G, on random arms and under another law
    weights = least_squares(filtered(record, W, arm.CONTROL_PERIOD).rows)[3]
    worst = Sequence(jnp.sign(adjoint(weights, W, arm.CONTROL_PERIOD)))
    pd = PDFeedforward(system, system.centre, 200.0, 4.0)
    for theta in uniform_in_box(jax.random.key(1), system.lower, system.upper, 20):
        record, _ = run(
            Plant(system, theta, worst), pd, IdealSensor(), trajectory, arm.CONTROL_PERIOD
        )
        estimate = identify(record, system, W, arm.CONTROL_PERIOD)
        assert jnp.all(jnp.abs(estimate.theta - theta) <= estimate.bound * (1 + 1e-9))


def test_units_follow_the_coordinate():
    from jaxid.files import trajectory_header

    assert trajectory_header(arm.system().coordinate)[2] == "velocity_rad_s"
