"""The example axes: printed results, limits, and true disturbances within δ."""

import shutil
from pathlib import Path

import jax.numpy as jnp
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments._support.examples import Example
from experiments.axes import cart, pendulum
from jaxid.identification.falsification import smallest_disturbance_factor
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.io.files import read_table, read_trajectory
from jaxid.loop.closed_loop import run
from jaxid.loop.disturbances import Moment
from jaxid.motion.violation import worst_violation
from jaxid.search.problem import Problem

pytestmark = pytest.mark.usefixtures("quick_compilation")


def redrawn(program, name: str, figures: Path, folder: Path) -> tuple[list, list]:
    """Return the committed table and the table recomputed from the committed motions."""
    for path in figures.glob(f"{name}_*.csv"):
        shutil.copy(path, folder)
    program.main(Example(folder, redraw=True))
    assert (folder / f"{name}.png").exists()
    printed, again = (read_table(place / f"{name}.csv") for place in (figures, folder))
    return printed, again


def agree(printed: list, again: list, columns: tuple[str, ...]) -> None:
    for row, other in zip(printed, again, strict=True):
        for column in columns:
            assert float(row[column]) == pytest.approx(float(other[column]), rel=1e-4)
        length = float(row["upper"]) - float(row["lower"])
        for end in ("lower", "upper"):
            # on another processor some encoder readings may differ by one count
            assert float(row[end]) == pytest.approx(float(other[end]), abs=0.01 * length)
        assert float(row["lower"]) <= float(row["theta_true"]) <= float(row["upper"])
        gap = float(row["predicted"]) / float(row["lower_bound"]) - 1
        assert 0 <= gap == pytest.approx(float(row["gap"]), abs=1e-12)


def columns_of(rows: list, column: str, **chosen: str) -> list[float]:
    return [float(r[column]) for r in rows if all(r[k] == v for k, v in chosen.items())]


def test_what_is_printed_of_the_pendulum_is_that_of_the_motions_in_the_files(figures, tmp_path):
    printed, again = redrawn(pendulum, "pendulum", figures, tmp_path)
    assert len(printed) == 3 * 4
    agree(printed, again, ("J_lse", "predicted", "lower_bound", "heat"))
    task = pendulum.task()
    for name in (pendulum.ALL, pendulum.ERROR, pendulum.COOL):
        motion = read_trajectory(figures / f"pendulum_{name}.csv", "rotary")
        assert worst_violation(task.limits, task.boundary, motion) <= 0


def test_a_price_on_heat_buys_a_cool_motor_with_a_little_error(figures):
    rows = read_table(figures / "pendulum.csv")
    error, heat = (
        [columns_of(rows, column, motion=name, parameter="J")[0] for name in ("J", "cool")]
        for column in ("J_lse", "heat")
    )
    assert error[0] < error[1] < 1.2 * error[0]
    assert heat[1] < 1 < heat[0]
    # the motion for all parameters has the smallest maximum optimality gap
    worst = {name: max(columns_of(rows, "gap", motion=name)) for name in ("all", "J", "cool")}
    assert min(worst, key=worst.get) == "all"
    # each motion is the better one by its own objective
    paths = [figures / f"pendulum_{name}.csv" for name in ("J", "cool")]
    motions = [read_trajectory(path, "rotary") for path in paths]
    for price, k in ((0.0, 0), (pendulum.PRICE, 1)):
        problem = Problem.of(pendulum.task(), pendulum.objective(price))
        values = [float(problem.value(motion)) for motion in motions]
        assert values[k] < values[1 - k]


def test_known_cogging_makes_delta_and_all_intervals_smaller(figures, tmp_path):
    printed, again = redrawn(cart, "cart", figures, tmp_path)
    assert len(printed) == 2 * (3 + 5)
    agree(printed, again, ("J_lse", "predicted", "lower_bound", "delta_N"))
    task = cart.task()
    for name in cart.DELTA:
        motion = read_trajectory(figures / f"cart_{name}.csv")
        assert worst_violation(task.limits, task.boundary, motion) <= 0
    assert cart.DELTA[cart.KNOWN] < cart.DELTA[cart.IN_DELTA] / 4
    readings = {
        (motion, model): [r for r in printed if (r["motion_for"], r["model"]) == (motion, model)]
        for motion in cart.DELTA
        for model in cart.DELTA
    }
    for motion in cart.DELTA:
        before, after = (readings[motion, model][: cart.SHARED] for model in cart.DELTA)
        for row, other in zip(before, after, strict=True):
            assert row["parameter"] == other["parameter"]
            assert float(other["predicted"]) < 0.3 * float(row["predicted"])
            lengths = [float(r["upper"]) - float(r["lower"]) for r in (row, other)]
            assert lengths[1] < lengths[0] / 2
    # each δ explains the logs; without cogging in the model, the smaller δ does not
    for row, other in zip(printed, again, strict=True):
        assert float(row["smallest_delta_N"]) < float(row["delta_N"])
        if row["model"] == cart.IN_DELTA:
            assert float(row["smallest_delta_N"]) > cart.REST
        # the search for the smallest δ ends at a relative difference of 0.1 %
        same = pytest.approx(float(other["smallest_delta_N"]), rel=0.01)
        assert float(row["smallest_delta_N"]) == same


def test_cogging_that_is_left_out_is_contradicted(figures):
    motion = read_trajectory(figures / f"cart_{cart.IN_DELTA}.csv")
    log = run(cart.plant(), cart.controller(), cart.SERVO, motion).log
    left_out = cart.in_delta(cart.REST)
    assert smallest_disturbance_factor(left_out, [log], cart.KNOTS) > 2
    with pytest.raises(ValueError, match="inconsistent around sample"):
        guaranteed_intervals(left_out, [log])


@given(position=st.floats(-10.0, 10.0), velocity=st.floats(-10.0, 10.0))
def test_the_true_disturbances_are_within_delta(position, velocity):
    """|Δ| ≤ δ at every position and velocity, before the plant clips Δ."""
    y, v = jnp.asarray(position), jnp.asarray(velocity)
    moment = Moment(jnp.zeros((), int), *jnp.zeros((3,)))
    for plant in (pendulum.plant(), cart.plant()):
        delta = plant.system.disturbance_bound(y, v)
        assert jnp.abs(plant.disturbance(moment, y, v, delta)) <= delta
    # cogging that one model contains is part of Δ in the other one
    forces = plant.system.regressor_values(y, v)[cart.SHARED - 1 :]
    cogging = sum(f * t for f, t in zip(forces, cart.TRUE_PARAMETERS[cart.SHARED :], strict=True))
    total = cogging + plant.disturbance(moment, y, v, delta)
    assert jnp.abs(total) <= cart.in_delta().disturbance_bound(y, v)


def test_motions_are_searched_for_once_and_read_from_then_on(tmp_path, motion):
    found = Example(tmp_path, toy=True).motions("axis", {"one": lambda: motion}, "linear")
    assert [path.name for path in tmp_path.iterdir()] == ["toy_axis_one.csv"]
    again = Example(tmp_path, redraw=True, toy=True)
    same = again.motions("axis", {"one": pytest.fail}, "linear")
    assert jnp.array_equal(same["one"].jerk, found["one"].jerk)
