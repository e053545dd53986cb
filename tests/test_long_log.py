"""Identification from a log of 200 MB: `make long`, six minutes, not a part of `make test`."""

import json
import os
import resource
import subprocess
import sys

import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.axis.texts import example
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import run

SIZE = int(float(os.environ.get("JAXID_LONG_LOG", "0")) * 1e6)  # bytes


@pytest.mark.skipif(SIZE == 0, reason="JAXID_LONG_LOG does not say of how many megabytes")
def test_a_long_log_is_read_in_little_memory(figures, tmp_path, capfd):
    """The motor repeats one motion.

    The intervals are no wider than those from a single repetition.
    """
    rows = written(figures, tmp_path / "log.csv")
    (tmp_path / "axis.toml").write_text(example("linear"))
    words = ["identify", "axis.toml", "log.csv", "--out", "out"]
    program = "import sys; from jaxid.axis.cli import main; main(sys.argv[1:])"
    with capfd.disabled():  # show its progress
        subprocess.run([sys.executable, "-c", program, *words], cwd=tmp_path, check=True)
        most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        print(f"{rows} rows took {most:.0f} MB")
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert found["consistent"]
    assert found["rows_used"] == rows
    assert most < 1000 + 3 * SIZE / 1e6
    for truth, widest, one in zip(
        motor.TRUE_PARAMETERS,
        (0.0036, 0.16, 0.17, 0.151),
        found["parameters"].values(),
        strict=True,
    ):
        for low, high in (one["guaranteed"],):
            assert low <= truth <= high
            assert high - low < 2 * widest


def written(figures, path):
    """Write a log of about SIZE bytes, from a closed loop that repeats one motion."""
    motion = read_trajectory(figures / "trajectory_minimax.csv")
    repeats = SIZE // (38 * 3000) + 1  # 38 bytes per row, 3000 rows per motion
    log = run(motor.plant(), motor.controller(), motor.servo(), motion, repeats=repeats).log
    input, position = np.asarray(log.input), np.asarray(log.position)[:-1]
    with open(path, "w") as file:
        file.write("time_s,position_m,input\n")
        for start in range(0, input.size, 100_000):
            part = slice(start, start + 100_000)
            time = np.arange(input.size)[part] * motor.CONTROL_PERIOD
            np.savetxt(file, np.stack([time, position[part], input[part]], 1), "%.10g", ",")
    return input.size
