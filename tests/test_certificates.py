"""The printed certificates of the motor against independent computations."""

import shutil

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

from experiments.axes import linear_motor as motor
from experiments.beyond import sensors, sequential
from experiments.paper import certificates
from experiments.paper.designs import HORIZON, ONE_MOTION, Cell, trajectory_path
from jaxid.io.files import read_table, read_trajectory
from jaxid.loop.record import rows_of
from jaxid.motion.violation import worst_violation
from jaxid.regression.lower_bound import lower_bound


@pytest.fixture(scope="module")
def motion(figures):
    return read_trajectory(trajectory_path(figures, Cell(ONE_MOTION, HORIZON)))


@pytest.fixture(scope="module")
def table(figures):
    rows = read_table(figures / "table4.csv")
    return {(row["design"], row["N"], row["parameter"]): row for row in rows}


def test_one_motion_is_near_the_floor_of_every_parameter_at_once(motion, table):
    """The optimality gaps of M, B, F_c and d̄ are at most 6, 1.5, 2 and 1 %.

    The motion keeps every limit exactly.
    """
    least = lower_bound(motor.system(), motor.limits())
    gap = np.asarray(certificates.worth(motion, least).evaluation.gap)
    assert np.all(gap <= [0.06, 0.015, 0.02, 0.01])
    assert worst_violation(motor.limits(), motor.boundary(), motion) <= 0
    assert motion.jerk.size == 60
    printed = [float(table[ONE_MOTION, "30", name]["gap"]) for name in motor.system().names]
    np.testing.assert_allclose(printed, gap, rtol=1e-4, atol=1e-6)


def test_every_design_is_appraised_and_its_errors_are_ordered_as_they_must_be(table, figures):
    """For exact signals, the minimax error is above the lower bound and below all other errors."""
    designs = sorted({key[:2] for key in table} - {(ONE_MOTION, "30")})
    files = [path.stem.removeprefix("trajectory_") for path in figures.glob("trajectory_*_N*.csv")]
    assert [f"{label.removeprefix('lse_')}_N{n}" for label, n in designs] == sorted(files)
    for row in table.values():
        best, least = float(row["r_minimax"]), float(row["lower_bound"])
        assert least <= best * (1 + 1e-9)
        for other in ("J_lse", "J_weighted_1", "J_weighted_2", "predicted"):
            assert best <= float(row[other])
        assert float(row["gap"]) == pytest.approx(float(row["predicted"]) / least - 1, abs=1e-12)


def test_printed_minimax_errors_are_those_of_another_solver(table, motion):
    """HiGHS on the same rows gives the same errors to 1e-6."""
    system = motor.system()
    rows = rows_of(system, *motion.midpoints(256))
    phi = np.asarray(rows.regressors) / np.asarray(rows.delta)[:, None]
    box = np.asarray(system.half_widths)
    scaled = phi * box
    for k, name in enumerate(system.names):
        solution = linprog(
            -np.eye(4)[k],
            A_ub=np.concatenate([scaled, -scaled]),
            b_ub=np.ones(2 * len(scaled)),
            bounds=(-1.0, 1.0),
            method="highs",
        )
        printed = float(table[ONE_MOTION, "30", name]["r_minimax"])
        assert printed == pytest.approx(-solution.fun * box[k], rel=1e-6)


def test_one_experiment_proves_more_than_the_papers_three(figures):
    for row in read_table(figures / "proved.csv"):
        values = {name: float(x) for name, x in row.items() if name != "parameter" and x}
        assert values["feasible_lower"] <= values["theta_true"] <= values["feasible_upper"]
        assert values["lower"] <= values["feasible_lower"]
        assert values["feasible_upper"] <= values["upper"]
        if "J_paper" in values:
            assert values["half_width"] < values["J_paper"]


def test_a_run_of_the_motion_proves_what_the_table_says(motion, figures):
    proof = certificates.experiment(motion)
    for k, row in enumerate(read_table(figures / "proved.csv")):
        found = [proof.guarantee.estimate.half_widths[k], proof.left.lower[k], proof.left.upper[k]]
        columns = ("half_width", "feasible_lower", "feasible_upper")
        printed = [float(row[name]) for name in columns]
        # on another processor some encoder readings may differ by one count
        np.testing.assert_allclose(jnp.stack(found), printed, atol=0.01 * printed[0])


def test_what_other_sensors_cost_is_what_the_table_says(tmp_path, figures):
    """The table is recomputed for one sensor.

    For all sensors, modulating functions give the smallest errors.
    """
    rows = read_table(figures / "sensors.csv")
    options = sensors.Sensors(tmp_path, figures, toy=True)
    sensors.main(options)
    again = read_table(tmp_path / "toy_sensors.csv")
    assert (tmp_path / "toy_sensors.png").exists()
    keys = ("way", "period_s", "resolution_m", "parameter")
    printed = {tuple(row[k] for k in keys): float(row["predicted"]) for row in rows}
    assert len(printed) == 3 * 5 * 4 * 4
    for row in again:
        ours = float(row["predicted"])
        assert printed[tuple(row[k] for k in keys)] == pytest.approx(ours, rel=1e-4)
    lower_bound = {row["parameter"]: float(row["lower_bound"]) for row in rows}
    for (way, period, resolution, name), value in printed.items():
        assert value >= lower_bound[name]
        assert printed["modulating", period, resolution, name] <= value, way


def test_each_round_knows_more_than_the_one_before(figures):
    """In each round the bounds from all logs together are smaller than in the round before.

    Intervals of earlier rounds are not intersected with the new ones. For B, F_c and d̄ the first
    log alone is within 1 % of the lower bound, so that no later log can improve them by more.
    """
    rounds = {}
    for row in read_table(figures / "sequential.csv"):
        values = {name: float(x) for name, x in row.items() if x and name != "parameter"}
        rounds[values["jerk_m_s3"], row["parameter"], values["round"]] = values
    assert len(rounds) == 2 * 4 * 3
    for (jerk, name, number), now in rounds.items():
        assert now["lower"] <= now["theta_true"] <= now["upper"]
        assert now["feasible_lower"] <= now["theta_true"] <= now["feasible_upper"]
        assert min(now["alone"], now["bound"]) >= now["lower_bound"]
        assert name == "M" or rounds[jerk, name, 1]["alone"] < 1.01 * now["lower_bound"]
        if number == 1:
            continue
        before = rounds[jerk, name, number - 1]
        assert now["bound"] < before["bound"]
        assert width(now) < 0.9995 * width(before)
        assert now["acceleration_m_s2"] > before["acceleration_m_s2"]
        if name == "M":  # also from the log of this round alone
            assert now["alone"] < 0.999 * before["alone"]
        if name == "M" and number == 2:
            # mostly by the acceleration that the smaller box permits, hardly by the longer time
            assert now["alone"] < (0.8 if jerk == 1000 else 0.65) * before["alone"]
            assert now["alone_first_limits"] > 0.95 * before["alone"]


def test_the_table_of_the_rounds_is_that_of_the_motions_in_the_files(figures, tmp_path):
    for path in figures.glob("sequential_*_*.csv"):
        shutil.copy(path, tmp_path)
    sequential.main(sequential.Sequential(tmp_path, redraw=True))
    again, printed = (read_table(folder / "sequential.csv") for folder in (tmp_path, figures))
    assert len(again) == len(printed) == 24
    for row, other in zip(printed, again, strict=True):
        for column in ("alone", "bound", "lower_bound"):
            # on another processor some encoder readings may differ by one count
            assert float(row[column]) == pytest.approx(float(other[column]), rel=1e-3)
        for column in ("lower", "upper", "feasible_lower", "feasible_upper"):
            assert float(row[column]) == pytest.approx(
                float(other[column]), abs=0.02 * float(row["bound"])
            )


def width(row):
    return row["feasible_upper"] - row["feasible_lower"]


@pytest.mark.slow
@pytest.mark.usefixtures("quick_compilation")
def test_the_rounds_run(tmp_path, capsys):
    sequential.main(sequential.Sequential(tmp_path, toy=True))
    rows = read_table(tmp_path / "toy_sequential.csv")
    assert [row["round"] for row in rows] == ["1"] * 4 + ["2"] * 4
    assert all(float(r["lower"]) <= float(r["theta_true"]) <= float(r["upper"]) for r in rows)
    assert "acceleration_m_s2" in capsys.readouterr().out
    assert (tmp_path / "toy_sequential.png").exists()
