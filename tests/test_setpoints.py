"""Exported set-points: every file format reads back to the same numbers, also in other programs."""

import shutil
import subprocess

import numpy as np
import pytest
from scipy.io import loadmat

from experiments.axes import linear_motor as motor
from jaxid.io.files import read_trajectory
from jaxid.io.setpoints import margins, read_setpoints, sampled, write_setpoints

H = 0.0002


@pytest.fixture(scope="module")
def setpoints(figures):
    return sampled(read_trajectory(figures / "trajectory_minimax.csv"), H)


def test_they_are_the_states_of_the_motion(setpoints, figures):
    """Every fiftieth sample agrees with a row of the file of knots."""
    knots = np.genfromtxt(figures / "trajectory_minimax.csv", delimiter=",", skip_header=1)
    assert setpoints.time.shape == (3001,)
    for values, column in zip(setpoints, knots.T, strict=False):
        np.testing.assert_allclose(values[::50], column, atol=1e-12)
    with pytest.raises(ValueError, match=r"`period` = 0.0007 s must divide"):
        sampled(read_trajectory(figures / "trajectory_minimax.csv"), 0.0007)


@pytest.mark.parametrize("ending", [".csv", ".mat"])
@pytest.mark.parametrize("coordinate", ["linear", "rotary"])
def test_what_is_written_is_read_to_the_last_bit(setpoints, tmp_path, ending, coordinate):
    path = tmp_path / f"motion{ending}"
    write_setpoints(path, setpoints, coordinate)
    for read, written in zip(read_setpoints(path, coordinate), setpoints, strict=True):
        np.testing.assert_array_equal(read, written)


def test_a_matrix_is_as_simulink_reads_it(setpoints, tmp_path):
    """The file has one variable with the time in its first row.

    Writing it again gives the same bytes.
    """
    path = tmp_path / "motion.mat"
    write_setpoints(path, setpoints)
    first = path.read_bytes()
    (name,) = [key for key in loadmat(path) if not key.startswith("__")]
    matrix = loadmat(path)[name]
    assert matrix.shape == (4, 3001)
    np.testing.assert_array_equal(matrix[0], setpoints.time)
    assert b"position_m, velocity_m_s" in first[:116]
    path.unlink()
    write_setpoints(path, setpoints)
    assert path.read_bytes() == first


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_a_c_program_reads_the_same_numbers(setpoints, tmp_path):
    write_setpoints(tmp_path / "motion.h", setpoints)
    (tmp_path / "print.c").write_text(
        '#include <stdio.h>\n#include "motion.h"\nint main(void) {\n'
        "  for (int k = 0; k < SETPOINTS_COUNT; k++)\n"
        '    printf("%.17g %.17g %.17g %.17g\\n", setpoints[k][0], setpoints[k][1],\n'
        "           setpoints[k][2], setpoints[k][3]);\n  return 0;\n}\n"
    )
    compiled = ["cc", "-std=c99", "-Wall", "-Werror", "-o", "print", "print.c"]
    subprocess.run(compiled, cwd=tmp_path, check=True)
    printed = subprocess.run([tmp_path / "print"], check=True, capture_output=True, text=True)
    table = np.array([[float(x) for x in line.split()] for line in printed.stdout.splitlines()])
    np.testing.assert_array_equal(table.T, np.stack(setpoints))


def test_margins_are_those_of_the_positions(setpoints):
    """A motion within all limits has no negative margin; one position off by 0.1 mm is detected."""
    limits = motor.limits()
    found = margins(setpoints, limits)
    assert min(found.values()) >= -1e-9
    assert found["velocity"] < 0.01  # the motion dwells at the velocity limit
    y = setpoints.position
    left = min(y.min() + 0.01, 0.4 - y.max()) / 0.205
    assert found["position"] == pytest.approx(left, abs=1e-12)
    wrong = y.copy()
    wrong[1000] += 1e-4
    bad = margins(setpoints._replace(position=wrong), limits)
    assert bad["acceleration"] < -10
    assert bad["velocity"] < found["velocity"]


def test_an_unknown_ending_is_refused(setpoints, tmp_path):
    with pytest.raises(ValueError, match=r"`path` must end in .csv, .mat, .h, but is .*motion.xls"):
        write_setpoints(tmp_path / "motion.xls", setpoints)
    (tmp_path / "motion.csv").write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match="must have the columns"):
        read_setpoints(tmp_path / "motion.csv")
