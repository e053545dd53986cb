"""The second example axis, from design to intervals: rotary, asymmetric limits, gravity."""

import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import uniform_in_box

from experiments.axes import one_link_arm as arm
from experiments.beyond import arm as one_link_arm
from jaxid.design.criteria import LeastSquaresError
from jaxid.design.optimal_motion import optimal_motion
from jaxid.io.files import read_table, read_trajectory
from jaxid.loop.closed_loop import run
from jaxid.loop.controllers import PDFeedforward
from jaxid.loop.disturbances import Sequence
from jaxid.loop.sensors import IdealSensor
from jaxid.loop.simulate import Plant
from jaxid.motion.task import Task
from jaxid.motion.violation import worst_violation
from jaxid.regression.error_of_motion import planned_error
from jaxid.regression.filtered_least_squares import filtered_least_squares
from jaxid.regression.filters import adjoint, filtered
from jaxid.regression.worst_case import least_squares
from jaxid.search.effort import Effort

W = 500.0


@pytest.mark.usefixtures("quick_compilation")
def test_from_design_to_identified_interval(key):
    system, limits, boundary = arm.system(), arm.limits(), arm.boundary()
    effort = Effort(
        starts=16, generations=0, stages=2, rounds=1, variations=16, parents=4, finalists=1
    )
    task = Task(limits, boundary, 50, arm.KNOT_PERIOD)
    trajectory = optimal_motion(task, LeastSquaresError(system, "G"), key, effort=effort).trajectory
    assert worst_violation(limits, boundary, trajectory) <= 0
    star = planned_error(system, trajectory)
    assert star[3] < system.half_widths[3] / 2

    law = arm.controller()
    record, signals, _ = run(arm.plant(), law, arm.servo(), trajectory)
    error = signals.position[:-1] - signals.reference.position
    assert jnp.max(jnp.abs(error)) < 0.02
    estimate = filtered_least_squares(record, system, W, arm.CONTROL_PERIOD)
    truth = jnp.asarray(arm.TRUE_PARAMETERS)
    assert jnp.all((estimate.lower <= truth) & (truth <= estimate.upper))
    np.testing.assert_allclose(estimate.bound, star, rtol=0.15)

    # worst-case Δ for G, on random arms with another controller
    weights = least_squares(filtered(record, W, arm.CONTROL_PERIOD).rows)[3]
    worst = Sequence(jnp.sign(adjoint(weights, W, arm.CONTROL_PERIOD)))
    pd = PDFeedforward(system, system.centre, 200.0, 4.0)
    for theta in uniform_in_box(jax.random.key(1), system.lower, system.upper, 20):
        plant = Plant(system, theta, worst)
        record = run(plant, pd, arm.servo(), trajectory, sensor=IdealSensor()).record
        estimate = filtered_least_squares(record, system, W, arm.CONTROL_PERIOD)
        assert jnp.all(jnp.abs(estimate.theta - theta) <= estimate.bound * (1 + 1e-9))


def test_units_follow_the_coordinate():
    from jaxid.io.files import trajectory_header

    assert trajectory_header(arm.system().coordinate)[2] == "velocity_rad_s"


def test_what_is_printed_of_it_is_that_of_the_motions_in_the_files(figures, tmp_path):
    """The printed tables agree with those recomputed from the committed motions.

    Every guaranteed interval of the simulated run contains the true parameter.
    """
    for path in figures.glob("arm_*.csv"):
        shutil.copy(path, tmp_path)
    study = one_link_arm.Study(tmp_path, redraw=True)
    one_link_arm.main(study)
    assert (tmp_path / "arm.png").exists()
    again, printed = (read_table(folder / "arm.csv") for folder in (tmp_path, figures))
    assert len(printed) == 6 * 5
    gaps = {}
    for row, other in zip(printed, again, strict=True):
        for column in ("J_lse", "predicted", "lower_bound"):
            assert float(row[column]) == pytest.approx(float(other[column]), rel=1e-4)
        assert float(row["predicted"]) >= float(row["lower_bound"])
        gap = float(row["predicted"]) / float(row["lower_bound"]) - 1
        assert float(row["gap"]) == pytest.approx(gap, abs=1e-12)
        gaps.setdefault(row["design"], []).append(float(row["gap"]))
    best = gaps.pop(one_link_arm.ALL)
    assert max(best) < min(max(others) for others in gaps.values())
    for design in (*gaps, one_link_arm.ALL):
        found = read_trajectory(study.path(design), "rotary")
        assert worst_violation(arm.limits(), arm.boundary(), found) <= 0
    proved = [read_table(folder / "arm_proved.csv") for folder in (figures, tmp_path)]
    for row, other in zip(*proved, strict=True):
        assert float(row["lower"]) <= float(row["theta_true"]) <= float(row["upper"])
        length = float(row["upper"]) - float(row["lower"])
        for end in ("lower", "upper"):
            # on another processor some encoder readings may differ by one count
            assert float(row[end]) == pytest.approx(float(other[end]), abs=0.01 * length)


@pytest.mark.slow
@pytest.mark.usefixtures("quick_compilation")
def test_a_design_of_each_kind_is_searched():
    study = one_link_arm.Study(toy=True)
    assert study.path("G").name == "toy_arm_G.csv"
    for name in ("G", one_link_arm.ALL):
        found, motion = one_link_arm.searched(study, name)
        assert found == name
        assert worst_violation(arm.limits(), arm.boundary(), motion) <= 0
