"""From a log file to intervals that contain the true parameters, or to a proof of inconsistency."""

import hashlib
import json
import re
from contextlib import contextmanager

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.axis import cli
from jaxid.axis import identify as axis_identify
from jaxid.axis.commands import identify as identify_command
from jaxid.axis.file import read_axis
from jaxid.axis.identify import IdentifyResult, identify_axis
from jaxid.axis.texts import example
from jaxid.identification import identify as door
from jaxid.identification.batches import SIZES, knots_by_length
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.io.files import read_trajectory
from jaxid.io.recorded import Recorded
from jaxid.io.segments import steady_segments
from jaxid.loop.closed_loop import run
from jaxid.loop.log import InconsistentLogError
from jaxid.motion.trajectory import uniform

DELAY = 2
TRUTH = np.array(motor.TRUE_PARAMETERS)
UNITS = [
    ("delay = 0 ", f"delay = {DELAY} "),
    ('time = "time_s"', 'time = "t"'),
    ('time_unit = "s"', 'time_unit = "ms"'),
    ('position = "position_m"', "position = 3"),
    ('position_unit = "m"', 'position_unit = "um"'),
    ('input = "input"', 'input = "u"'),
    ("gain = 1.0", "gain = -0.5"),
]


@pytest.fixture(scope="module")
def log(figures):
    """Return a log of the simulated motor, with cogging and friction."""
    motion = read_trajectory(figures / "trajectory_minimax.csv")
    return run(motor.plant(), motor.controller(), motor.servo(), motion).log


def rows_of(log):
    """Return rows of time in ms, command two sample periods before it acts, and position in µm."""
    n = log.input.size - DELAY
    time = 1e3 * motor.CONTROL_PERIOD * np.arange(n)
    commanded = np.asarray(log.input)[DELAY:] / -0.5
    return np.stack([time, commanded, 1e6 * np.asarray(log.position)[:n]], axis=1)


def written(tmp_path, rows, *changes):
    """Write an axis file and a log file, and return the arguments of the command."""
    axis = example("linear")
    for old, new in (*UNITS, *changes):
        assert old in axis
        axis = axis.replace(old, new, 1)
    axis = axis.replace("input = [-10.0, 10.0]", "input = [-20.0, 20.0]", 1)
    (tmp_path / "axis.toml").write_text(axis)
    np.savetxt(tmp_path / "log.csv", rows, delimiter=";", header="t;u;q", fmt="%.17g")
    return str(tmp_path / "axis.toml"), str(tmp_path / "log.csv"), "--out", str(tmp_path / "out")


def test_a_log_with_gaps_in_its_own_units_is_identified(tmp_path, log, capsys):
    rows = rows_of(log)
    rows[1200, 1] = np.nan
    rows = np.delete(rows, slice(700, 720), axis=0)
    rows = np.insert(rows, 2000, rows[2000], axis=0)
    arguments = written(tmp_path, rows)
    cli.main(["identify", *arguments])
    said = capsys.readouterr().out
    assert f"of {len(rows)} rows (1–700, 701–1180, 1182–2001, 2002–{len(rows)})" in said
    assert "acts 2 sample periods after its command" in said
    assert "Long log" not in said
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    there = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert there == sorted([*IdentifyResult.names, "manifest.json"])
    (part,) = json.loads((tmp_path / "out" / "manifest.json").read_text())["parts"].values()
    read = {"axis": tmp_path / "axis.toml", "log": tmp_path / "log.csv"}
    digests = {what: hashlib.sha256(path.read_bytes()).hexdigest() for what, path in read.items()}
    assert part["sources"] == digests
    assert found["consistent"]
    assert found["rows_used"] == len(rows) - 1
    for truth, (name, one) in zip(TRUTH, found["parameters"].items(), strict=True):
        low, high = one["guaranteed"]
        assert one["prior"][0] <= low <= truth <= high <= one["prior"][1]
        assert one["theta_hat"] - one["bound"] <= low
        assert high <= one["theta_hat"] + one["bound"]
        # the printed interval contains the computed one, and agrees to five digits
        printed = re.search(rf"^ *{name} .* (\S+) … (\S+)$", said, re.M)
        at_least, at_most = map(float, printed.groups())
        assert at_least <= low <= at_least + 1e-4 * abs(low)
        assert at_most - 1e-4 * abs(high) <= high <= at_most
    # the same bounds as from Python
    axis = read_axis(tmp_path / "axis.toml")
    time, u, q = rows.T
    recorded = Recorded(time * 1e-3, q * 1e-6, u * -0.5)
    pieces = steady_segments(recorded, axis.servo.period, axis.servo.resolution, DELAY)
    logs = [piece.log for piece in pieces]
    own = guaranteed_intervals(axis.system, logs, knots_by_length(1000, logs))
    bounds = [one["bound"] for one in found["parameters"].values()]
    np.testing.assert_allclose(bounds, own.estimate.bound, rtol=1e-9)
    assert bounds[0] < 0.0039  # the whole log gives 0.0036
    with pytest.raises(SystemExit):
        cli.main(["identify", *arguments])
    assert "already exist" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("step", "done", "said"),
    [
        ("batch 2 of 4", 1, "Interrupted after 1 of 4 batches"),
        ("all batches together", 4, "after all 4 batches, before they were processed together"),
    ],
)
def test_an_interruption_leaves_the_intervals_of_the_rows_before(
    tmp_path, log, capsys, monkeypatch, step, done, said
):
    @contextmanager
    def interrupted():
        def report(message, share):
            if message.startswith(step):
                raise KeyboardInterrupt

        yield report

    monkeypatch.setattr(identify_command, "progress", interrupted)
    monkeypatch.setattr(axis_identify, "SIZES", SIZES._replace(samples=800))
    with pytest.raises(SystemExit) as stopped:
        cli.main(["identify", *written(tmp_path, rows_of(log))])
    assert stopped.value.code == 130
    assert said in capsys.readouterr().out
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert found["interrupted"]
    assert (found["batches"], len(found["segments"])) == (done, done)
    assert found["rows_used"] == found["segments"][-1]["last_row"]
    assert (found["rows_used"] == found["rows"]) == (done == 4)
    for truth, one in zip(TRUTH, found["parameters"].values(), strict=True):
        assert one["guaranteed"][0] <= truth <= one["guaranteed"][1]


def test_a_log_with_a_large_unknown_force_is_falsified(tmp_path, log, capsys):
    """An additional 0.6 V in the last third of the log is reported as an inconsistency.

    It is more than twice δ, so that no θ of the prior box explains it.
    """
    rows = rows_of(log)
    rows[2000:, 1] += 0.6 / -0.5
    with pytest.raises(SystemExit) as stopped:
        cli.main(["identify", *written(tmp_path, rows)])
    assert stopped.value.code == 3
    assert "Inconsistent log:" in capsys.readouterr().out
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert not found["consistent"]
    assert 1.0 < found["disturbance_factor"] < 0.75 / 0.15
    assert all("guaranteed" not in one for one in found["parameters"].values())


def test_what_no_disturbance_explains_is_a_contradiction_too(tmp_path, log, capsys):
    """A position offset that jumps by 0.2 m within one sample period is reported as inconsistent.

    The reported factor of δ is the largest that is tested.
    """
    rows = rows_of(log)[:600]
    rows[300:, 2] += 0.2e6
    with pytest.raises(SystemExit) as stopped:
        cli.main(["identify", *written(tmp_path, rows)])
    assert stopped.value.code == 3
    sentence = "at least 1000·δ."
    assert sentence in capsys.readouterr().out
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert sentence in found["inconsistency"]
    assert found["disturbance_factor"] == 1000.0


def test_a_contradiction_of_the_second_reading_is_one_too(tmp_path, log, monkeypatch, capsys):
    """The log is inconsistent if its intervals are empty, even if the test of δ accepted it."""

    def refused(*arguments):
        raise InconsistentLogError("no M in its prior interval can have left it.")

    monkeypatch.setattr(door, "guaranteed_intervals", refused)
    with pytest.raises(SystemExit) as stopped:
        cli.main(["identify", *written(tmp_path, rows_of(log)[:600])])
    assert stopped.value.code == 3
    said = capsys.readouterr().out
    assert "Inconsistent log: No parameter vector of the prior box explains the data" in said
    assert "Check, in this order: sign and unit of the input" in said  # no tested δ was sufficient
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert not found["consistent"]
    assert found["disturbance_factor"] > 100


def test_a_record_that_cannot_tell_two_parameters_apart_says_so(tmp_path, capsys):
    """At one constant speed friction and offset are one force.

    M, B and F_c are reported as not identifiable.
    """
    n, period, speed = 1500, motor.CONTROL_PERIOD, 0.5
    time = period * np.arange(n)
    q = 0.1 + speed * time
    u = np.full(n, TRUTH[1] * speed + TRUTH[2] + TRUTH[3])
    rows = np.stack([1e3 * time, u / -0.5, np.round(1e6 * q, 1)], axis=1)
    cli.main(["identify", *written(tmp_path, rows)])
    said = capsys.readouterr().out
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert "M is not identifiable from this log" in said
    assert {"M", "B", "Fc"} <= found["not_identifiable"].keys()
    assert found["parameters"]["M"]["guaranteed"] == found["parameters"]["M"]["prior"]
    assert found["parameters"]["M"]["least_squares_estimate"] is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            ('position_unit = "um"', 'position_unit = "mm"'),
            r"position from .* Check `log.position_unit`",
        ),
        (("input_unit = 1.0", "input_unit = 1e4"), r"input from .* Check `log.input_unit`"),
        (('time_unit = "ms"', 'time_unit = "s"'), "every 0.2 s, .*unit of time is probably wrong"),
        (("position = 3", "position = 4"), "column 4 must be from 1 to 3"),
        (('input = "u"', 'input = "U"'), "no column 'U'; it has t, u, q"),
    ],
)
def test_what_is_wrong_with_a_log_is_hinted_at(tmp_path, log, capsys, change, said):
    with pytest.raises(SystemExit) as stopped:
        cli.main(["identify", *written(tmp_path, rows_of(log), change)])
    assert stopped.value.code == 1
    message = capsys.readouterr().err.splitlines()[-1]
    assert message.startswith("jaxid: ")
    assert re.search(said, message)
    assert not (tmp_path / "out").exists()


def test_an_axis_without_columns_reads_no_log(tmp_path, log, capsys):
    arguments = written(tmp_path, rows_of(log))
    text = (tmp_path / "axis.toml").read_text()
    (tmp_path / "axis.toml").write_text(text[: text.index("[log]")])
    with pytest.raises(SystemExit):
        cli.main(["identify", *arguments])
    assert "has no table [log]" in capsys.readouterr().err


def test_a_log_of_any_motion_will_do(tmp_path):
    """The motion has constant speeds there and back and is not optimised."""
    jerk = jnp.array([60.0, -60.0, 0.0, -60.0, 60.0, -60.0, 60.0, 0.0, 60.0, -60.0])
    motion = uniform(jnp.zeros(3), jerk, 0.06)
    _, signals, log = run(motor.plant(), motor.controller(), motor.servo(), motion)
    (tmp_path / "axis.toml").write_text(example("linear"))
    recorded = Recorded(None, np.asarray(log.position)[:-1], np.asarray(log.input))
    found = identify_axis(read_axis(tmp_path / "axis.toml"), recorded)
    assert np.all((found.result.lower <= TRUTH) & (found.result.upper >= TRUTH))
    assert found.result.disturbance_factor < 1
    assert found.result.batches == 1
    # the residual exceeds δ only by what the error of the least-squares fit adds
    assert np.max(np.abs(found.fit.residual)) < 2 * 0.25
    assert np.max(np.abs(found.fit.velocity)) == pytest.approx(
        float(jnp.max(jnp.abs(signals.velocity))), rel=0.05
    )
