"""Sweeps: the result of one item, and the data set in which it is saved."""

import subprocess

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from processes import finish, free_port, start

from experiments.axes import linear_motor as motor
from jaxid.io.datasets import read_dataset, write_dataset
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import run
from jaxid.loop.controllers import Controller, PDFeedforward
from jaxid.loop.disturbances import AgainstTracking, RandomForce
from jaxid.loop.scenarios import mixed
from jaxid.loop.simulate import Plant
from jaxid.regression.filtered_least_squares import filtered_least_squares
from jaxid.runtime import connect
from jaxid.sweep.dataset import Labels, labelled
from jaxid.sweep.grid import Swept, grid, item

LIGHT = (0.08, 0.0, 0.0, -0.5)
BANDWIDTHS = (100.0, 1000.0)


def slurm(job: int, task: int) -> dict[str, object]:
    """Return the environment variables that `srun -n 2` sets for one of its tasks."""
    told = {"JOB_ID": job, "STEP_NODELIST": "localhost", "STEP_NUM_TASKS": 2, "NTASKS": 2}
    told |= {"STEP_NUM_NODES": 1, "PROCID": task, "LOCALID": task}
    return {f"SLURM_{name}": value for name, value in told.items()}


@pytest.mark.slow
def test_two_tasks_of_slurm_compute_the_same_bits_as_one_process(tmp_path):
    def sweep(name: str, variables: dict[str, object]) -> subprocess.Popen[str]:
        options = ("--toy", "--devices", 1, "--out", tmp_path / name)
        variables |= {"JAX_DISABLE_MOST_OPTIMIZATIONS": 1}
        return start("-m", "experiments.beyond.sweep", *options, **variables)

    job = free_port(61_440, 65_536) - 61_440  # JAX derives the port from the job number
    alone, *tasks = sweep("one", {}), *(sweep("two", slurm(job, task)) for task in range(2))
    told = ["θ is outside θ̂ ± J_f in 0 of" in printed for printed in finish(alone, *tasks)]
    assert told == [True, True, False]
    one, two = (read_dataset(tmp_path / name / "sweep.nc") for name in ("one", "two"))
    assert one.attrs["fingerprint"] == two.attrs["fingerprint"]
    assert set(one.variables) == set(two.variables)
    for name, variable in one.variables.items():
        assert variable.values.tobytes() == two[name].values.tobytes(), name
    maps = {f"sweep_{name}.png" for name in ("bound", "error", "tracking")}
    for folder in tmp_path.iterdir():
        assert {path.name for path in folder.iterdir()} == maps | {"sweep.nc"}
        assert all(path.stat().st_size < 200_000 for path in folder.iterdir())


@pytest.fixture(scope="module")
def small(figures):
    """Return a grid of two motions, two controllers and two scenarios.

    The motions differ in length, and the loop with the second controller is unstable.
    """
    chosen = motor.controller()
    stiff = eqx.tree_at(lambda arc: arc.epsilon, chosen, jnp.asarray(1e-4))
    return grid(
        motor.system(),
        motor.servo().sensor,
        Swept(
            [read_trajectory(figures / f"trajectory_M_N{n}.csv") for n in (30, 40)],
            [chosen, stiff],
            mixed(
                motor.system(),
                jnp.array([motor.TRUE_PARAMETERS, LIGHT]),
                (motor.plant().disturbance, AgainstTracking()),
                jnp.eye(2),
            ),
            BANDWIDTHS,
        ),
        motor.CONTROL_PERIOD,
    )


@jax.jit
def evaluate(swept):
    return jax.vmap(item, (None, 0))(swept, jnp.arange(swept.count))


@pytest.fixture(scope="module")
def items(small):
    """Return the results of all items."""
    jax.config.update("jax_disable_most_optimizations", True)
    found = evaluate(small)
    jax.config.update("jax_disable_most_optimizations", False)
    return {name: np.asarray(values) for name, values in found.items()}


@pytest.mark.parametrize("scene", [0, 1])
def test_an_item_is_what_run_and_identify_give_padded_or_not(
    items, motion, scene, quick_compilation
):
    """The item has the shorter motion, which is padded to the length of the longer one."""
    disturbance = (motor.plant().disturbance, AgainstTracking(motor.ARC_GAINS["k1"]))[scene]
    theta = jnp.asarray((motor.TRUE_PARAMETERS, LIGHT)[scene])
    plant = Plant(motor.system(), theta, disturbance)
    record, signals, _ = run(plant, motor.controller(), motor.servo(), motion)
    found = {name: values[scene] for name, values in items.items()}
    for k, w in enumerate(BANDWIDTHS):
        estimate = filtered_least_squares(record, motor.system(), w, motor.CONTROL_PERIOD)
        np.testing.assert_allclose(found["bound"][k], estimate.bound, rtol=1e-7)
        error = np.abs(estimate.theta - theta)
        np.testing.assert_allclose(found["error"][k], error, atol=1e-7 * estimate.bound.max())
    error = signals.position[:-1] - signals.reference.position
    for name, expected in {
        "tracking_error": jnp.abs(error).max(),
        "lowest_position": signals.position.min(),
        "highest_velocity": signals.velocity.max(),
        "lowest_input": signals.input.min(),
        "highest_input": signals.input.max(),
    }.items():
        np.testing.assert_allclose(found[name], expected, rtol=1e-6, err_msg=name)


def test_a_loop_that_diverges_has_no_bound(small, items):
    _, gains, _ = np.unravel_index(np.arange(small.count), small.shape)
    for name in ("bound", "error", "tracking_error", "highest_input"):
        assert np.all(np.isfinite(items[name][gains == 0])), name
        assert np.all(items[name][gains == 1] == np.inf), name
    assert np.all(items["lowest_velocity"][gains == 1] == -np.inf)
    assert not items["outside"][gains == 0].any()
    assert items["outside"][gains == 1].all()


def test_random_forces_are_of_the_seed_and_the_item(small, items, quick_compilation):
    """Random disturbances differ between two equal scenarios and between seeds."""
    theta = jnp.array([motor.TRUE_PARAMETERS, motor.TRUE_PARAMETERS])
    two = mixed(motor.system(), theta, [RandomForce()], jnp.ones((2, 1)))
    alike = eqx.tree_at(lambda g: g.scenarios, small, two)
    first, again, other = (
        evaluate(eqx.tree_at(lambda g: g.seed, alike, jnp.asarray(seed)))["error"][:2].tolist()
        for seed in (0, 0, 1)
    )
    assert first == again
    assert first[0] != first[1]
    assert first[0] != other[0]
    assert first[1] != other[1]


def test_a_data_set_comes_back_with_its_names_and_units(small, items, tmp_path):
    path = tmp_path / "sweep.nc"
    names = ("chosen", "stiff"), ("true", "light"), {"own": ("share of its own", (1.0, 0.0))}
    labels = Labels([("M", 30), ("M", 40)], (20, 30, 40), *names)
    dataset = labelled(small, labels, items, {"command": "none", "seed": 0})
    write_dataset(path, dataset)
    before = path.read_bytes()
    write_dataset(path, dataset)
    assert path.read_bytes() == before
    again = read_dataset(path)
    xr.testing.assert_identical(again.drop_vars("outside"), dataset.drop_vars("outside"))
    assert again.bound.dims == ("design", "horizon", "gains", "scenario", "bandwidth", "parameter")
    assert again.attrs["seed"] == 0
    assert "jaxlib" in again.attrs["versions"]
    units = {"tracking_error": "m", "highest_velocity": "m/s", "lowest_input": "V"}
    units |= {"bandwidth": "rad/s", "k1": "1/s", "k2": "V s/m", "outside": "1"}
    assert {name: again[name].attrs["units"] for name in units} == units
    assert again.own.values.tolist() == [1.0, 0.0]
    assert again.unit.values.tolist() == ["V s²/m", "V s/m", "V", "V"]
    cell = {"horizon": 40, "gains": "chosen", "scenario": "light", "bandwidth": 1000.0}
    assert again.bound.sel(cell).sel(design="M", parameter="B") == items["bound"][5, 1, 1]
    # N = 20 was not simulated and has no result; a diverged loop has one
    assert again.bound.sel(horizon=20).isnull().all()
    assert again.outside.sel(horizon=20).isnull().all()
    assert (again.outside.sel(horizon=40, gains="stiff") == 1).all()


def test_options_that_make_no_sense_are_refused(small, figures):
    with pytest.raises(ValueError, match="`devices` must be at least 1, but is 0"):
        connect(0)
    with pytest.raises(ValueError, match="given together"):
        connect(1, coordinator="127.0.0.1:1")
    with pytest.raises(ValueError, match="`motions` must have at least one entry"):
        grid(small.system, small.sensor, Swept([], [], small.scenarios, []), 1.0)
    controllers = [motor.controller(), PDFeedforward(small.system, small.system.centre, 1.0, 1.0)]
    motion = read_trajectory(figures / "trajectory_M_N30.csv")
    with pytest.raises(ValueError, match=r"must be of one class .* there are 2 kinds"):
        grid(
            small.system,
            small.sensor,
            Swept([motion], controllers, small.scenarios, BANDWIDTHS),
            motor.CONTROL_PERIOD,
        )


class Bang(Controller):
    """A controller of a user: on or off, by the sign of the position error."""

    level: jax.Array

    def initial(self):
        return ()

    def step(self, state, reference, measured, period):
        return -self.level * jnp.sign(measured.position - reference.position), ()


def test_a_controller_of_ones_own_is_swept(small, figures, quick_compilation):
    """One disturbance opposes the tracking. The data set has no gains of this controller."""
    swept = grid(
        small.system,
        small.sensor,
        Swept(
            [read_trajectory(figures / "trajectory_M_N30.csv")],
            [Bang(jnp.asarray(5.0)), Bang(jnp.asarray(8.0))],
            small.scenarios,
            BANDWIDTHS,
        ),
        motor.CONTROL_PERIOD,
    )
    values = {name: np.asarray(x) for name, x in evaluate(swept).items()}
    names = ("5 V", "8 V"), ("true", "light")
    found = labelled(swept, Labels([("M", 30)], (30,), *names), values, {})
    highest = found.highest_input.sel(design="M", horizon=30)
    np.testing.assert_array_equal(highest.sel(gains="5 V"), 5.0)
    np.testing.assert_array_equal(highest.sel(gains="8 V"), 8.0)
    assert "k1" not in found.coords
