"""The `jaxid` command: its files and printed text, and errors as one line without a traceback."""

import hashlib
import json
import shutil

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.paper.designs import TOY
from jaxid._text import at_least
from jaxid.axis import cli
from jaxid.axis import design as axis_search
from jaxid.axis import design_result as axis_design
from jaxid.axis import tradeoff as axis_tradeoff
from jaxid.axis.commands import design as design_command
from jaxid.axis.defaults import EFFORTS
from jaxid.axis.design import evaluated, in_words
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import PROGRAM, read_axis
from jaxid.axis.result import write
from jaxid.axis.saved_designs import designs_in, of_another_axis, read_design
from jaxid.axis.simulate import simulate_axis
from jaxid.axis.texts import example
from jaxid.design.evaluation import evaluate
from jaxid.io.files import read_table, read_trajectory
from jaxid.io.log_file import read_log
from jaxid.io.setpoints import margins, read_setpoints
from jaxid.motion.feasibility import interior
from jaxid.motion.violation import worst_violation
from jaxid.regression.lower_bound import lower_bound
from tests.saved import save_design

FILES = sorted([*DesignResult.names, "manifest.json"])


@pytest.fixture
def toy(monkeypatch):
    monkeypatch.setitem(EFFORTS, "quick", TOY)


def refused(capsys, *arguments):
    """Run the command, require exit code 1 and no traceback, and return the last error line."""
    with pytest.raises(SystemExit) as stopped:
        cli.main(list(map(str, arguments)))
    assert stopped.value.code == 1
    said = capsys.readouterr().err
    assert "Traceback" not in said
    last = said.splitlines()[-1]  # lines before it report progress
    assert last.startswith("jaxid: ")
    return last


def test_an_example_is_written_once(tmp_path, capsys):
    path = tmp_path / "axis.toml"
    cli.main(["init", str(path), "--coordinate", "rotary"])
    assert "jaxid design" in capsys.readouterr().out
    assert read_axis(path).system.coordinate == "rotary"
    own = path.read_text().replace("duration = 1.0", "duration = 2.0")
    path.write_text(own)
    assert f"{path} already exists; use --force to overwrite." in refused(capsys, "init", path)
    assert path.read_text() == own
    cli.main(["init", str(path), "--force"])
    assert read_axis(path).system.coordinate == "linear"


@pytest.mark.usefixtures("quick_compilation", "toy")
def test_a_design_is_written_for_a_servo(tmp_path, capsys):
    """The numbers in all files of a design of a rotary axis are those that the library computes."""
    path, out = tmp_path / "arm.toml", tmp_path / "arm"
    cli.main(["init", str(path), "--coordinate", "rotary"])
    text = path.read_text().replace("# home = 1.0 ", "home = 1.0 ").replace("# settle", "settle")
    path.write_text(text.replace("# [wanted]", "[wanted]").replace("# J = 0.002", "G = 0.07"))
    cli.main(["design", str(path), "--out", str(out), "--effort", "quick", "--target", "wanted"])
    said = capsys.readouterr().out
    assert sorted(p.name for p in out.iterdir()) == FILES
    axis = read_axis(path)
    system, limits = axis.system, axis.task.limits
    motion = read_trajectory(out / "trajectory.csv", "rotary")
    assert worst_violation(limits, axis.task.boundary, motion) <= 0
    left = margins(read_setpoints(out / "setpoints.mat", "rotary"), limits)
    assert min(left.values()) >= -1e-9
    written = json.loads((out / "design.json").read_text())
    assert written["margins"] == left
    assert written["target"] == "wanted"
    assert written["parameters"]["G"]["wanted"] == 0.07
    assert written["axis_sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    # the set-points begin at home, rest for 0.1 s at the start, and then follow the motion
    points, begins = read_setpoints(out / "setpoints.csv", "rotary"), written["begins_s"]
    before, at = points.time < begins - 1e-9, points.time - begins
    assert points.position[0] == 1.0
    np.testing.assert_allclose(points.position[before & (at >= -0.1)], 0.0, atol=1e-12)
    desired = motion.states(jnp.asarray(at[~before])).position
    np.testing.assert_allclose(points.position[~before], desired, atol=1e-12)
    assert points.time[-1] == pytest.approx(written["ends_s"])
    worth = evaluate(system, motion, axis.servo, lower_bound(system, limits))
    for k, name in enumerate(system.names):
        own = written["parameters"][name]
        assert f"{own['predicted']:.4g}" in said
        # an error grows at most in proportion to δ and does not exceed the half-width of the box
        half, twice = own["predicted_with_delta_times"].values()
        box = float(system.half_widths[k])
        assert own["predicted"] / 2 * 0.99 <= half <= own["predicted"] <= twice <= box
        assert twice <= 2.01 * own["predicted"]
        found = [own["least_squares"], own["predicted"], own["lower_bound"]]
        expected = [worth.least_squares[k], worth.predicted[k], worth.lower_bound[k]]
        np.testing.assert_allclose(found, expected, rtol=1e-6)
    again = refused(capsys, "design", path, "--out", out, "--effort", "quick")
    assert "design.png already exist" in again


def hardly_designed(axis, target, seed, effort, report):
    """Return a design without a search, which another test covers."""
    task = axis.task
    motion = interior(task.limits, task.boundary, task.intervals, task.period)
    least = lower_bound(axis.system, task.limits)
    return evaluated(axis, target, in_words(seed, effort), motion, least)


def test_several_designs_are_compared(tmp_path, capsys, monkeypatch):
    """Two durations and two targets give four designs and one table.

    A second run uses the saved designs again.
    """
    monkeypatch.setattr(axis_tradeoff, "design_axis", hardly_designed)
    path, out = tmp_path / "axis.toml", tmp_path / "choice"
    cli.main(["init", str(path)])
    asked = ["design", str(path), "--out", str(out), "--effort", "quick", "--durations", "0.5"]
    asked += ["0.6", "--target", "M", "all"]
    cli.main(asked)
    said = capsys.readouterr().out
    table = read_table(out / "tradeoff.csv")
    designs = {(row["target"], float(row["duration_s"])) for row in table}
    assert designs == {("M", 0.5), ("M", 0.6), ("all", 0.5), ("all", 0.6)}
    axis = read_axis(path)
    least = lower_bound(axis.system, axis.task.limits)
    for target, duration in designs:
        folder = out / f"{target}_{duration:g}s"
        assert sorted(p.name for p in folder.iterdir()) == FILES
        motion = read_trajectory(folder / "trajectory.csv")
        assert float(motion.duration) == pytest.approx(duration)
        worth = evaluate(axis.system, motion, axis.servo, least)
        own = [r for r in table if (r["target"], float(r["duration_s"])) == (target, duration)]
        found = [float(row["predicted"]) for row in own]
        np.testing.assert_allclose(found, worth.predicted, rtol=1e-6)
    for row in table:
        assert f"{float(row['predicted']):.4g}" in said
    assert (out / "tradeoff.png").exists()
    before = (out / "tradeoff.csv").read_text()
    (out / "tradeoff.csv").unlink()
    (out / "tradeoff.png").unlink()
    monkeypatch.setattr(axis_tradeoff, "design_axis", None)  # must not be called again
    cli.main(asked)
    assert (out / "tradeoff.csv").read_text() == before
    (out / "tradeoff.csv").unlink()
    (out / "tradeoff.png").unlink()
    motion = out / "M_0.5s" / "trajectory.csv"
    kept = motion.read_text()
    shutil.copy(out / "M_0.6s" / "trajectory.csv", motion)
    assert "M_0.5s has a design that was made with another axis file" in refused(capsys, *asked)
    rows = kept.splitlines()
    faster = ",".join([*rows[1].split(",")[:-1], "9999.0"])
    motion.write_text("\n".join([rows[0], faster, *rows[2:]]) + "\n")
    assert "M_0.5s has a design that was made with another axis file" in refused(capsys, *asked)
    motion.write_text(kept)
    path.write_text(path.read_text() + "# another axis\n")
    assert "M_0.5s has a design that was made with another axis file" in refused(capsys, *asked)
    # with --force all designs are made again, for the present axis file
    saved = designs_in(out, "linear").designs.values()
    assert len(of_another_axis(saved, read_axis(path))) == 4
    (out / "all_0.5s" / "trajectory.csv").write_text("damaged")
    (out / "all_0.6s" / "design.json").write_text("{")
    monkeypatch.setattr(axis_tradeoff, "design_axis", hardly_designed)
    cli.main([*asked, "--force"])
    saved = designs_in(out, "linear").designs
    assert of_another_axis(saved.values(), read_axis(path)) == ()
    assert (out / "tradeoff.csv").read_text() == before
    # the manifest of the table names these designs
    manifest = json.loads((out / "manifest.json").read_text())["parts"]["tradeoff"]
    assert manifest["results"] == {where: one.part.digest for where, one in saved.items()}
    assert set(manifest["results"]) == {
        f"{target}_{duration:g}s/design" for target, duration in designs
    }


def test_a_design_that_was_not_written_to_its_end_is_none(tmp_path, monkeypatch):
    """An interrupted write leaves no folder, so that files of two designs are never mixed.

    A complete design names the delay among its assumptions and is read back unchanged.
    """
    path, out = tmp_path / "axis.toml", tmp_path / "out"
    path.write_text(example("linear").replace("delay = 0 ", "delay = 2 "))
    axis = read_axis(path)
    found = hardly_designed(axis, "all", 0, EFFORTS["quick"], None)

    def interrupted(*arguments):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(axis_design, "page", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write(out, DesignResult(found))
    assert list(tmp_path.iterdir()) == [path]
    part = write(out, DesignResult(found))
    written = json.loads((out / "design.json").read_text())
    assert any("acts 2 sample periods after" in sentence for sentence in written["assumptions"])
    # the manifest names program and axis file; the files are read back unchanged
    assert part.program == PROGRAM
    assert part.sources == {"axis": hashlib.sha256(path.read_bytes()).hexdigest()}
    saved = read_design(out, "linear")
    assert saved.part == part
    assert saved.summary == DesignResult(found).summary()
    np.testing.assert_array_equal(saved.motion.jerk, found.motion.jerk)


def test_what_cannot_be_designed_is_said_in_a_sentence(tmp_path, capsys):
    path, out = tmp_path / "axis.toml", tmp_path / "out"
    assert "there is no file axis.toml in " in refused(capsys, "design", path, "--out", out)
    cli.main(["init", str(path)])
    wrong = refused(capsys, "design", path, "--out", out, "--target", "mass")
    assert "--target must be all, wanted or one of M, B, Fc, dbar, but is 'mass'" in wrong
    path.write_text(path.read_text().replace("duration = 0.6 ", "duration = 0.3 "))
    assert "`motion.duration`: no motion of 0.3 s (30 intervals" in refused(
        capsys, "design", path, "--out", out
    )
    path.write_text(path.read_text().replace("kind = ", "knd = ", 1))
    assert f"File {path}: " in refused(capsys, "design", path, "--out", out)
    assert not out.exists()


def test_an_interruption_leaves_nothing(tmp_path, capsys, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    path, out = tmp_path / "axis.toml", tmp_path / "out"
    cli.main(["init", str(path)])
    monkeypatch.setattr(design_command, "design_axis", interrupted)
    with pytest.raises(SystemExit) as stopped:
        cli.main(["design", str(path), "--out", str(out)])
    assert stopped.value.code == 130
    assert not out.exists()


def test_an_interruption_of_a_search_leaves_its_best_motion(tmp_path, capsys, monkeypatch, figures):
    """The search is replaced by one that shows two motions and is interrupted."""
    path, out = tmp_path / "axis.toml", tmp_path / "out"
    cli.main(["init", str(path)])
    task = read_axis(path).task
    worse = interior(task.limits, task.boundary, task.intervals, task.period)
    better = read_trajectory(figures / "trajectory_minimax.csv")

    def search(*arguments, show, **options):
        show(better)
        show(worse)
        raise KeyboardInterrupt

    monkeypatch.setattr(axis_search, "optimal_motion", search)
    with pytest.raises(SystemExit) as stopped:
        cli.main(["design", str(path), "--out", str(out)])
    assert stopped.value.code == 130
    assert "was not finished" in capsys.readouterr().out
    np.testing.assert_array_equal(read_trajectory(out / "trajectory.csv").jerk, better.jerk)
    assert json.loads((out / "design.json").read_text())["search"].endswith("interrupted")


def test_help_shows_what_there_is(capsys):
    for arguments, words in ((["--help"], ("init", "design")), (["design", "--help"], ("slide",))):
        with pytest.raises(SystemExit) as stopped:
            cli.main(arguments)
        assert stopped.value.code == 0
        said = capsys.readouterr().out
        assert all(word in said for word in words)


@pytest.mark.usefixtures("quick_compilation")
def test_a_designed_motion_is_simulated(tmp_path, capsys, figures):
    """Files and printed text agree with `simulate_axis`, for a rotary axis with a delay of 2."""
    path, out = tmp_path / "arm.toml", tmp_path / "arm"
    cli.main(["init", str(path), "--coordinate", "rotary"])
    path.write_text(path.read_text().replace("delay = 0 ", "delay = 2 "))
    path.write_text(path.read_text().replace("# home = 1.0 ", "home = 0.3 "))
    save_design(out, figures / "arm_all.csv", "before")
    cli.main(["simulate", str(path), str(out), "--plants", "8", "--logs", "2"])
    said = capsys.readouterr().out
    assert f"Warning: {path} has changed since the design in {out} was made." in said
    found = json.loads((out / "simulation.json").read_text())
    assert (out / "simulation.png").exists()
    assert found["logs_missing_the_truth"] == 0
    assert "acts 2 sample periods after its command" in said
    axis, motion = read_axis(path), read_trajectory(out / "trajectory.csv", "rotary")
    again = simulate_axis(axis, motion, 8, 2)
    for name, one in found["limits"].items():
        low, high = np.asarray(getattr(axis.task.limits, name)).tolist()
        assert one["smallest_margin"] == -float(again.excess[name].max()) * (high - low) / 2
        assert at_least(one["smallest_margin"]) in said  # rounded towards the limit
    # the log of one of the plants can be identified, and holds what the servo recorded
    recorded = read_log(out / "simulated_log.csv", axis.columns)
    np.testing.assert_allclose(recorded.position, again.log.position, atol=1e-9)
    assert list(found["log_theta"].values()) == again.theta.tolist()
    # independent computation: the extremes of the drawn positions
    assert float(again.played.duration) > float(motion.duration)  # the played motion begins at home
    np.testing.assert_allclose(again.drawn.position[:, 0], 0.3)
    y, (low, high) = again.drawn.position[:, 1:], axis.task.limits.position
    beyond = np.maximum(np.max(y, axis=1) - high, low - np.min(y, axis=1)) / ((high - low) / 2)
    np.testing.assert_allclose(again.excess["position"], beyond, rtol=1e-9)
    assert set(found["half_widths"]) == set(axis.system.names)
    assert "already exist" in refused(capsys, "simulate", path, out)
    parts = json.loads((out / "manifest.json").read_text())["parts"]
    digests = {
        name: hashlib.sha256((out / name).read_bytes()).hexdigest()
        for name in ("simulation.json", "simulation.png", "simulated_log.csv")
    }
    assert parts["simulate"]["files"] == digests
    assert parts["simulate"]["sources"] == {"axis": axis.digest}
    assert parts["simulate"]["results"] == {"design": read_design(out, "rotary").part.digest}
    path.write_text(path.read_text().replace("[controller]", "[controler]"))
    assert "controler" in refused(capsys, "simulate", path, out, "--force")


def test_a_design_that_was_changed_is_not_simulated(tmp_path, capsys, figures):
    path, out = tmp_path / "arm.toml", tmp_path / "arm"
    cli.main(["init", str(path), "--coordinate", "rotary"])
    save_design(out, figures / "arm_all.csv", read_axis(path).digest)
    simulate = "simulate", path, out
    text = (out / "trajectory.csv").read_text()
    (out / "trajectory.csv").write_text(text.replace("0.0", "0.1", 1))
    said = refused(capsys, *simulate)
    assert (
        f"File {out / 'trajectory.csv'} was changed after jaxid design wrote it: restore it" in said
    )
    (out / "trajectory.csv").write_text(text)
    (out / "manifest.json").rename(tmp_path / "manifest.json")
    assert f"{out} must be a result of jaxid design, but has no manifest" in refused(
        capsys, *simulate
    )
    # a manifest of another version of the program, whose files are unchanged
    parts = json.loads((tmp_path / "manifest.json").read_text())
    (out / "design.json").write_text("{}")
    digest = hashlib.sha256(b"{}").hexdigest()
    parts["parts"]["design"] |= {"program": "jaxid 0.0.1"}
    parts["parts"]["design"]["files"]["design.json"] = digest
    (out / "manifest.json").write_text(json.dumps(parts))
    assert "was written by jaxid 0.0.1, whose design.json has another format" in refused(
        capsys, *simulate
    )


def test_numbers_and_places_that_cannot_be_are_told(tmp_path, capsys):
    path, out = tmp_path / "axis.toml", tmp_path / "out"
    path.write_text(example("linear"))
    seed = str(2**64)
    assert "--seed must be from 0" in refused(capsys, "design", path, "--out", out, "--seed", seed)
    said = refused(capsys, "simulate", path, out, "--plants", "0")
    assert "--plants must be 1 or more" in said
    assert "cannot be used: Is a directory" in refused(capsys, "design", tmp_path, "--out", out)


@pytest.mark.parametrize(
    "own",
    [
        "jd.Custom(lambda y, v: 1.0)",
        "jd.Custom(lambda y, v: v[:1])",
        "jd.Custom(lambda y, v: None)",
    ],
)
def test_functions_of_the_wrong_shape_are_refused(tmp_path, capsys, own):
    """By the check of the file, or before that by the types that tests check at run time."""
    code = f"""
import jaxid as jd
terms = (jd.Term("M", "V s²/m", (0.08, 0.18)), jd.Term("B", "V s/m", (0.0, 0.5), {own}))
axis = jd.System(terms, jd.ConstantBound(0.2), "V")
"""
    (tmp_path / "own.py").write_text(code)
    text = example("linear")
    start, end = text.index("# One table per unknown"), text.index("[limits]")
    control, log = text.index("# Optional: the controller"), text.index("# Columns of a recorded")
    kept = (text[:start] + text[end:control] + text[log:]).replace(
        "coordinate =", 'python = "own:axis"\ncoordinate =', 1
    )
    (tmp_path / "axis.toml").write_text(kept)
    arguments = tmp_path / "axis.toml", "--out", tmp_path / "out", "--run-python"
    said = refused(capsys, "design", *arguments)
    assert "`python`: " in said
    assert len(said.splitlines()) == 1


def test_a_sentence_of_the_library_about_files_is_kept(tmp_path, capsys, monkeypatch):
    """What must be put back by hand is told, which has no file name of the system's own."""

    def lost(*arguments, **named):
        raise FileNotFoundError("The folder is in .out.old: move it back by hand.")

    (tmp_path / "axis.toml").write_text(example("linear"))
    monkeypatch.setattr(design_command, "require_writable", lost)
    said = refused(capsys, "design", tmp_path / "axis.toml", "--out", tmp_path / "out")
    assert said.strip() == "jaxid: The folder is in .out.old: move it back by hand."
