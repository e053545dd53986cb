"""The command: what it writes and says, and what it refuses without a traceback."""

import json
import shutil

import numpy as np
import pytest

from experiments.linear_motor.designs import TOY, with_starts
from jaxid import cli
from jaxid.appraisal import appraise
from jaxid.axis_design import FILES
from jaxid.axis_file import read_axis
from jaxid.axis_simulate import simulate_axis
from jaxid.files import read_trajectory
from jaxid.floor import floor
from jaxid.limits import worst_excess
from jaxid.setpoints import margins, read_setpoints


@pytest.fixture
def toy(monkeypatch):
    monkeypatch.setitem(cli.EFFORTS, "quick", with_starts(TOY))


def refused(capsys, *arguments):
    """What is said, in one line, of something that is wrong."""
    with pytest.raises(SystemExit) as stopped:
        cli.main(list(map(str, arguments)))
    assert stopped.value.code == 1
    said = capsys.readouterr().err
    assert "Traceback" not in said
    last = said.splitlines()[-1]  # progress comes before
    assert last.startswith("jaxid: ")
    return last


def test_an_example_is_written_once(tmp_path, capsys):
    path = tmp_path / "axis.toml"
    cli.main(["init", str(path), "--coordinate", "rotary"])
    assert "jaxid design" in capsys.readouterr().out
    assert read_axis(path).system.coordinate == "rotary"
    own = path.read_text().replace("duration = 1.0", "duration = 2.0")
    path.write_text(own)
    assert f"{path} would be replaced: allow it with --force" in refused(capsys, "init", path)
    assert path.read_text() == own
    cli.main(["init", str(path), "--force"])
    assert read_axis(path).system.coordinate == "linear"


@pytest.mark.usefixtures("quick_compilation", "toy")
def test_a_design_is_written_for_a_servo(tmp_path, capsys):
    """From the file of a rotary axis to files whose numbers are those of the library."""
    path, out = tmp_path / "arm.toml", tmp_path / "arm"
    cli.main(["init", str(path), "--coordinate", "rotary"])
    cli.main(["design", str(path), "--out", str(out), "--effort", "quick", "--target", "G"])
    said = capsys.readouterr().out
    assert sorted(FILES) == sorted(p.name for p in out.iterdir())
    axis = read_axis(path)
    system, limits = axis.system, axis.task.limits
    motion = read_trajectory(out / "trajectory.csv", "rotary")
    assert worst_excess(limits, axis.task.boundary, motion) <= 0
    left = margins(read_setpoints(out / "setpoints.mat", "rotary"), limits)
    assert min(left.values()) >= -1e-9
    written = json.loads((out / "design.json").read_text())
    assert written["margins"] == left
    assert written["target"] == "G"
    worth = appraise(system, motion, axis.servo, floor(system, limits))
    for k, name in enumerate(system.names):
        own = written["parameters"][name]
        assert f"{own['guaranteed']:.4g}" in said
        found = [own["J"], own["guaranteed"], own["floor"]]
        expected = [worth.error[k], worth.guaranteed[k], worth.floor[k]]
        np.testing.assert_allclose(found, expected, rtol=1e-6)
    again = refused(capsys, "design", path, "--out", out, "--effort", "quick")
    assert "design.png would be replaced" in again


def test_what_cannot_be_designed_is_said_in_a_sentence(tmp_path, capsys):
    path, out = tmp_path / "axis.toml", tmp_path / "out"
    assert "No such file" in refused(capsys, "design", path, "--out", out)
    cli.main(["init", str(path)])
    wrong = refused(capsys, "design", path, "--out", out, "--target", "mass")
    assert "must be one of ['M', 'B', 'Fc', 'dbar'], but is 'mass'" in wrong
    path.write_text(path.read_text().replace("duration = 0.6 ", "duration = 0.3 "))
    assert "no motion of 30 intervals" in refused(capsys, "design", path, "--out", out)
    path.write_text(path.read_text().replace("kind = ", "knd = ", 1))
    assert f"File {path}: " in refused(capsys, "design", path, "--out", out)
    assert not out.exists()


def test_an_interruption_leaves_nothing(tmp_path, capsys, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    path, out = tmp_path / "axis.toml", tmp_path / "out"
    cli.main(["init", str(path)])
    monkeypatch.setattr(cli, "design_axis", interrupted)
    with pytest.raises(SystemExit) as stopped:
        cli.main(["design", str(path), "--out", str(out)])
    assert stopped.value.code == 130
    assert not out.exists()


def test_help_shows_what_there_is(capsys):
    for arguments, words in ((["--help"], ("init", "design")), (["design", "--help"], ("slide",))):
        with pytest.raises(SystemExit) as stopped:
            cli.main(arguments)
        assert stopped.value.code == 0
        said = capsys.readouterr().out
        assert all(word in said for word in words)


@pytest.mark.usefixtures("quick_compilation")
def test_a_designed_motion_is_simulated(tmp_path, capsys, figures):
    """The rotary example, whose commands act two periods late; nothing is said that is not so."""
    path, out = tmp_path / "arm.toml", tmp_path / "arm"
    cli.main(["init", str(path), "--coordinate", "rotary"])
    path.write_text(path.read_text().replace("delay = 0 ", "delay = 2 "))
    out.mkdir()
    shutil.copy(figures / "arm_all.csv", out / "trajectory.csv")
    cli.main(["simulate", str(path), str(out), "--plants", "8", "--logs", "2"])
    said = capsys.readouterr().out
    found = json.loads((out / "simulation.json").read_text())
    assert (out / "simulation.png").exists()
    assert found["logs_with_a_truth_outside"] == 0
    assert "acts as commanded, 2 periods later" in said
    axis, motion = read_axis(path), read_trajectory(out / "trajectory.csv", "rotary")
    again = simulate_axis(axis, motion, 8, 2)
    for name, one in found["limits"].items():
        assert one["least_margin"] == -float(again.excess[name].max())
        assert f"{one['least_margin']:.4g}" in said
    # second truth: the extremes of what was drawn
    y, (low, high) = again.drawn.position[:, 1:], axis.task.limits.position
    beyond = np.maximum(np.max(y, axis=1) - high, low - np.min(y, axis=1)) / ((high - low) / 2)
    np.testing.assert_allclose(again.excess["position"], beyond, rtol=1e-9)
    assert set(found["half_length"]) == set(axis.system.names)
    assert "would be replaced" in refused(capsys, "simulate", path, out)
    path.write_text(path.read_text().replace("[controller]", "[controler]"))
    assert "controler" in refused(capsys, "simulate", path, out, "--force")
