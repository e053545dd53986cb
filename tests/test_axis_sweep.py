"""The results of a sweep of an axis file against single closed loops."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import runtime
from jaxid.axis import cli
from jaxid.axis import sweep as axis_sweep
from jaxid.axis.design import played
from jaxid.axis.file import read_axis
from jaxid.axis.saved_designs import designs_in
from jaxid.axis.sweep_result import SweepResult
from jaxid.axis.texts import example
from jaxid.io.datasets import read_dataset
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import ClosedLoop
from jaxid.loop.controllers import ARC, Delayed, PDFeedforward, undelayed
from jaxid.loop.disturbances import NoDisturbance
from jaxid.loop.sensors import Encoder
from jaxid.loop.simulate import Plant
from jaxid.motion.trajectory import ticks
from jaxid.regression.estimate import least_squares_estimate
from jaxid.regression.filters import filtered
from tests.processes import finish, start
from tests.saved import save_design

PROGRAM = "import sys; from jaxid.axis.cli import main; main(sys.argv[1:])"


@pytest.fixture
def folder(figures, tmp_path):
    """Return a folder with a design of the arm that starts from home, with a delay of 1."""
    text = example("rotary").replace("# home = 1.0 ", "home = 0.1 ")
    (tmp_path / "arm.toml").write_text(text.replace("delay = 0 ", "delay = 1 "))
    digest = read_axis(tmp_path / "arm.toml").digest
    save_design(tmp_path / "choice" / "all_1s", figures / "arm_all.csv", digest)
    return tmp_path


def test_a_folder_of_designs_is_swept(folder):
    arguments = ["sweep", folder / "arm.toml", folder / "choice", "--plants", "1"]
    arguments += ["--factors", "1", "0.5", "--bandwidths", "20", "200"]
    (said,) = finish(start("-c", PROGRAM, *arguments, JAX_ENABLE_COMPILATION_CACHE="0"))
    assert "10 closed loops (seed 0), of which 0 diverged." in said
    found = read_dataset(folder / "choice" / "sweep.nc")
    assert sorted(path.name for path in (folder / "choice").iterdir()) == sorted(
        [*SweepResult.names, "all_1s", "manifest.json"]
    )
    assert sorted(path.name for path in folder.iterdir()) == ["arm.toml", "choice"]
    saved = designs_in(folder / "choice", "rotary")
    (part,) = json.loads((folder / "choice" / "manifest.json").read_text())["parts"].values()
    assert part["results"] == {"all_1s/design": saved.designs["all_1s/design"].part.digest}
    assert dict(found.sizes) == {
        "design": 1, "horizon": 1, "gains": 2, "scenario": 5, "bandwidth": 2, "parameter": 5,
    }  # fmt: skip
    assert found.kp.attrs["units"] == "N m/rad"
    np.testing.assert_array_equal(found.kp, [8.0, 4.0])
    assert float(found.horizon[0]) == 1.0
    # independent computation: one closed loop, undisturbed, at the centre of the prior box
    axis = read_axis(folder / "arm.toml")
    motion = read_trajectory(folder / "choice" / "all_1s" / "trajectory.csv", "rotary")
    whole, period = played(axis, motion), axis.servo.period
    assert float(whole.duration) > 1.05
    loop = ClosedLoop(Delayed(axis.controller, 1), Encoder(1e-5), period, ticks(whole, period))
    record, signals = loop(Plant(axis.system, axis.system.centre, NoDisturbance()), whole)
    one = found.sel(design="all", gains="× 1", scenario="middle of the box, no Δ").squeeze()
    error = jnp.abs(signals.position[:-1] - signals.reference.position)
    assert float(one.tracking_error) == pytest.approx(float(jnp.max(error)), rel=1e-6)
    expected = least_squares_estimate(filtered(record, 200.0, period), axis.system).bound
    np.testing.assert_allclose(one.bound.sel(bandwidth=200.0), expected, rtol=1e-6)
    # the printed value is the largest of all scenarios, with the best bandwidth
    rows = SweepResult(axis_sweep.Sweep(axis, saved, found)).summary()
    assert len(rows) == 5
    for target, duration, name, w, worst, _ in rows:
        own = found.bound.sel(design=target, horizon=duration, parameter=name, gains="× 1")
        assert worst == float(own.max("scenario").min("bandwidth"))
        assert worst == float(own.sel(bandwidth=w).max("scenario"))
        assert f"{worst:.4g}" in said


def test_gains_are_scaled_whatever_the_law(folder):
    axis = read_axis(folder / "arm.toml")
    twice = axis_sweep.scaled(Delayed(axis.controller, 3), 2.0)
    assert (twice.periods, float(undelayed(twice).kp), float(undelayed(twice).kd)) == (3, 16.0, 1.0)
    arc = ARC(axis.system, 10.0, 2.0, 0.1, jnp.zeros(5))
    half = axis_sweep.scaled(arc, 0.5)
    assert (float(half.k1), float(half.k2), float(half.epsilon)) == (5.0, 1.0, 0.1)
    assert isinstance(undelayed(axis.controller), PDFeedforward)


def test_what_cannot_be_swept_is_said(folder, capsys, monkeypatch):
    monkeypatch.setattr(
        runtime, "connect", lambda devices: None
    )  # these devices are in use already
    path = folder / "arm.toml"

    def said(*arguments):
        with pytest.raises(SystemExit) as stopped:
            cli.main(["sweep", str(path), *map(str, arguments)])
        assert stopped.value.code == 1
        return capsys.readouterr().err.splitlines()[-1]

    assert "has no design; write one with `jaxid design`" in said(folder)
    assert "--plants must be 0 or more, but is -1" in said(folder / "choice", "--plants", -1)
    assert "--factors must be distinct numbers above zero" in said(
        folder / "choice", "--factors", 1, 1
    )
    with monkeypatch.context() as second:  # the second of two processes
        second.setattr(axis_sweep.jax, "process_index", lambda: 1)
        second.setattr(axis_sweep.blocks, "compute", lambda *arguments: None)
        cli.main(["sweep", str(path), str(folder / "choice")])
    assert not (folder / "choice" / "sweep.nc").exists()
    text = path.read_text()
    path.write_text(text[: text.index("[controller]")] + text[text.index("[log]") :])
    assert "has no table [controller]" in said(folder / "choice")
    (folder / "choice" / "sweep.nc").write_text("mine")
    assert "already exist" in said(folder / "choice")
    (folder / "choice" / "all_1s" / "design.json").write_text("{}")
    assert "design.json was changed after jaxid design wrote it" in said(folder / "choice")
    (folder / "choice" / "all_1s" / "manifest.json").unlink()
    assert "all_1s must be a result of jaxid design, but has no manifest" in said(folder / "choice")
