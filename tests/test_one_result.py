"""Results of the command are whole, even if a run is killed or two runs write at once."""

import inspect
import json
import os
import re
import sys

import jax.numpy as jnp
import msgspec
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.axis import cli, summaries
from jaxid.axis.commands import design as design_command
from jaxid.axis.commands import identify as identify_command
from jaxid.axis.design import AxisDesign
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import read_axis
from jaxid.axis.identify import IdentifyResult, identify_axis
from jaxid.axis.saved_designs import read_design
from jaxid.axis.texts import example
from jaxid.axis.tradeoff import Tradeoff
from jaxid.axis.tradeoff_result import TradeoffResult
from jaxid.design.evaluation import Evaluation
from jaxid.io.files import json_bytes, read_table, read_trajectory
from jaxid.io.manifest import manifest_in
from jaxid.io.setpoints import read_setpoints
from jaxid.motion.feasibility import interior

DURATIONS = (0.6, 0.5)  # s: old and new motion
# calls that change a folder
CALLS = ("replace", "rename", "link", "mkdir", "unlink", "rmdir", "fsync")


@pytest.fixture(scope="module")
def designs(tmp_path_factory):
    """Return the axis file and two motions by duration, with invented predicted errors."""
    path = tmp_path_factory.mktemp("axis") / "axis.toml"
    path.write_text(example("linear"))
    axis, found = read_axis(path), {}
    for duration in DURATIONS:
        task = (longer := axis.lasting(duration)).task
        motion = interior(task.limits, task.boundary, task.intervals, task.period)
        worth = Evaluation(*(k * jnp.arange(1.0, 5.0) for k in (3.0, 2.0, 0.5)), ())
        found[duration] = AxisDesign(longer, "all", "none", motion, worth, np.ones((2, 4)))
    return path, found


@pytest.fixture(scope="module")
def made(designs):
    """Return the files of both designs, made once."""
    return {duration: DesignResult(one).files() for duration, one in designs[1].items()}


@pytest.fixture
def designed(designs, made, monkeypatch, tmp_path):
    """Return a function that runs `jaxid design --force` without a search, and its folder."""
    path, found = designs
    monkeypatch.setattr(design_command, "design_axis", lambda axis, *_: found[_duration(axis)])
    monkeypatch.setattr(DesignResult, "files", lambda one: made[_duration(one.axis)])
    monkeypatch.setattr(DesignResult, "text", lambda one: "")
    out = tmp_path / "slide"

    def run(duration):
        asked = ["design", str(path), "--out", str(out), "--durations", str(duration), "--force"]
        cli.main(asked)

    return run, out


def _duration(axis):
    return round(axis.task.intervals * axis.task.period, 12)


class Killed(BaseException):
    """An exception that no clean-up code of the program catches."""


def kill_at(monkeypatch, moment):
    """Let every change of the file system after the given number of changes raise `Killed`."""
    count = 0
    for name in CALLS:

        def changed(*arguments, _call=getattr(os, name), **named):
            nonlocal count
            count += 1
            if count > moment:
                raise Killed
            return _call(*arguments, **named)

        monkeypatch.setattr(os, name, changed)


def test_a_replaced_design_is_the_old_or_the_new_one(designed, monkeypatch):
    """After a kill at any moment, motion, set-points and numbers belong to one design."""
    run, out = designed
    left = []
    for moment in range(100):
        run(DURATIONS[0])
        try:
            with monkeypatch.context() as patched:
                kill_at(patched, moment)
                run(DURATIONS[1])
            break
        except Killed:
            pass
        duration = round(float(read_trajectory(out / "trajectory.csv").duration), 12)
        points, numbers = out / "setpoints.csv", json.loads((out / "design.json").read_text())
        assert read_setpoints(points).time[-1] == duration, f"a mixture after {moment} changes"
        assert numbers["ends_s"] == pytest.approx(duration)
        assert read_design(out, "linear").summary.ends_s == numbers["ends_s"]
        left.append(duration)
    else:
        pytest.fail("the run never came to its end")
    assert left == sorted(left, reverse=True)
    assert set(left) == set(DURATIONS)
    assert read_setpoints(out / "setpoints.csv").time[-1] == DURATIONS[1]
    assert os.listdir(out.parent) == ["slide"]


@pytest.mark.usefixtures("quick_compilation")
def test_a_new_design_takes_what_was_simulated_of_the_old_one_with_it(designs, designed):
    (path, _), (run, out) = designs, designed
    run(DURATIONS[0])
    (out / "notes.txt").write_text("mine")
    cli.main(["simulate", str(path), str(out), "--plants", "1", "--logs", "1"])
    assert (out / "simulation.json").exists()
    run(DURATIONS[0])  # the same motion again: the simulation stays valid
    assert set(manifest_in(out).parts) == {"design", "simulate"}
    run(DURATIONS[1])
    assert set(manifest_in(out).parts) == {"design"}
    assert not (out / "simulation.json").exists()
    assert (out / "notes.txt").read_text() == "mine"


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """Return a folder with a short log of the motor at rest, and `identify_axis` with a cache."""
    folder = tmp_path_factory.mktemp("log")
    (folder / "axis.toml").write_text(example("linear"))
    time = motor.CONTROL_PERIOD * np.arange(200)
    rows = np.stack([time, 0.0 * time, 0.1 + 0.0 * time], axis=1)
    header = "time_s,input,position_m"
    np.savetxt(folder / "log.csv", rows, "%.17g", ",", header=header, comments="")
    found = []

    def once(*arguments):
        if not found:
            found.append(identify_axis(*arguments))
        return found[0]

    return folder, once


@pytest.mark.usefixtures("quick_compilation")
def test_of_two_logs_for_one_folder_one_is_kept_and_told(identified, monkeypatch, tmp_path, capsys):
    """A second run starts while the first reads its log, and ends before it.

    The first is refused.
    """
    folder, once = identified
    arguments = ["identify", str(folder / "axis.toml"), str(folder / "log.csv")]
    arguments += ["--out", str(tmp_path / "run")]

    def second(*given):
        with monkeypatch.context() as patched:
            patched.setattr(identify_command, "identify_axis", once)
            cli.main(arguments)
        return once(*given)

    monkeypatch.setattr(identify_command, "identify_axis", second)
    with pytest.raises(SystemExit) as stopped:
        cli.main(arguments)
    assert stopped.value.code == 1
    said = capsys.readouterr()
    assert re.search(r"run/result.json, .* already exist; .*another run finished first", said.err)
    # both results are printed, because they may have taken long
    assert said.out.count("hold provided that:") == 2
    assert said.out.count("Wrote to") == 1
    monkeypatch.setattr(identify_command, "identify_axis", once)
    cli.main([*arguments, "--force"])


def test_a_manifest_says_what_was_typed_and_read(identified, monkeypatch, tmp_path):
    folder, once = identified
    monkeypatch.setattr(identify_command, "identify_axis", once)
    words = ["identify", str(folder / "axis.toml"), str(folder / "log.csv")]
    words += ["--out", str(tmp_path / "first run")]
    monkeypatch.setattr(sys, "argv", ["/usr/local/bin/jaxid", *words])
    cli.main()
    (part,) = manifest_in(tmp_path / "first run").parts.values()
    typed = [*words[:-1], f"'{words[-1]}'"]
    assert part.command == " ".join(["jaxid", *typed])
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.jpg").write_text("mine")
    with pytest.raises(SystemExit):
        cli.main([*words[:-1], str(tmp_path / "photos")])
    assert os.listdir(tmp_path / "photos") == ["one.jpg"]
    cli.main([*words[:-1], str(tmp_path / "photos"), "--force"])
    there = sorted([*IdentifyResult.names, "manifest.json", "one.jpg"])
    assert sorted(os.listdir(tmp_path / "photos")) == there


def test_the_files_are_what_their_structures_say(designs, identified, tmp_path):
    """The keys of each file are the fields of its structure, and each field has a description."""
    _, found = designs
    folder, once = identified
    design = DesignResult(found[0.6])
    axis = read_axis(folder / "axis.toml")
    result = IdentifyResult(once(axis, None), "")
    for one, name in ((design, "design.json"), (result, "result.json")):
        data, summary = one.files()[name], one.summary()
        again = msgspec.json.decode(data, type=type(summary))
        assert json_bytes(again) == data
        assert list(json.loads(data)) == list(summary.__struct_fields__)
    numbers = json.loads(design.files()["design.json"])["parameters"]
    tradeoff = TradeoffResult(Tradeoff(axis, (found[0.6],), {}))
    (tmp_path / "tradeoff.csv").write_bytes(tradeoff.files()["tradeoff.csv"])
    for row in read_table(tmp_path / "tradeoff.csv"):
        for name in ("least_squares", "predicted", "lower_bound", "gap"):
            assert float(row[name]) == numbers[row["parameter"]][name]
    structures = inspect.getmembers(summaries, inspect.isclass)
    structures = [x for _, x in structures if issubclass(x, msgspec.Struct)]
    assert len(structures) == 9
    for structure in structures:
        explained = re.findall(r"^ {4}(\w+): ", inspect.getdoc(structure), re.M)
        assert explained == list(structure.__struct_fields__), structure
