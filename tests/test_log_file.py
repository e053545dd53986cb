"""Recorded logs in text, MAT and HDF5 files: they are read exactly, or refused with a message."""

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from jaxid.io.csv_log import log_bytes
from jaxid.io.log_file import read_log
from jaxid.io.recorded import Columns
from jaxid.io.segments import steady_segments
from jaxid.loop.log import Log

RANDOM = np.random.default_rng(0)
TIME = 0.001 * np.arange(40)
POSITION, INPUT = RANDOM.normal(size=(2, 40))
NAMED = Columns("q", "u", "t")
SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "blanks": "  "}


def text_of(separator, decimal, before, names, rows=None):
    rows = np.stack([TIME, INPUT, POSITION], axis=1) if rows is None else rows
    lines = [*before, *([separator.join(names)] if names else [])]
    lines += [separator.join(repr(float(x)).replace(".", decimal) for x in row) for row in rows]
    return "\n".join(lines) + "\n"


def same(found, time=TIME):
    np.testing.assert_array_equal(found.position, POSITION)
    np.testing.assert_array_equal(found.input, INPUT)
    assert time is found.time or np.array_equal(found.time, time)


@given(
    st.sampled_from(sorted(SEPARATORS)),
    st.booleans(),
    st.sampled_from([[], ["# of 2026-11-26, axis 3"], ["", "% one", "# 2026 11 26"]]),
    st.sampled_from(["names", "names and units", "names and a blank", "commented", "none"]),
    st.booleans(),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_text_of_any_layout_is_read(tmp_path, separator, comma, before, header, mark):
    """The texts vary in separator, decimal comma, comments, row of units and byte order mark."""
    parted = SEPARATORS[separator]
    decimal = "," if comma and separator != "comma" else "."
    names = ["t", "u", "q"] if header != "none" else []
    if header == "commented":
        names[0] = "# t"
    text = text_of(parted, decimal, before, names)
    if header == "names and a blank":
        text = text.replace(parted.join(names), parted.join(names) + "\n", 1)
    if header == "names and units":
        text = text.replace(parted.join(names), parted.join(names) + "\n" + parted.join("sVm"), 1)
    path = tmp_path / "log.csv"
    path.write_text(("\ufeff" if mark else "") + text)
    same(read_log(path, NAMED if names else Columns(3, 2, 1)))
    same(read_log(path, Columns(3, 2)), time=None)


def test_arrays_are_read_by_name_and_columns_of_a_matrix_by_number(tmp_path):
    matrix = np.stack([TIME, INPUT, POSITION])
    savemat(tmp_path / "named.mat", {"t": TIME, "u": INPUT[:, None], "q": POSITION, "gain": 3.0})
    savemat(tmp_path / "matrix.mat", {"ans": matrix})
    with h5py.File(tmp_path / "named.h5", "w") as file:
        for name, x in {"run/t": TIME, "run/u": INPUT, "run/q": POSITION}.items():
            file[name] = x
    with h5py.File(tmp_path / "new.mat", "w") as file:  # the format of MATLAB 7.3
        file["ans"] = matrix.T
    same(read_log(tmp_path / "named.mat", NAMED))
    same(read_log(tmp_path / "matrix.mat", Columns(3, 2, 1)))
    same(read_log(tmp_path / "named.h5", Columns("run/q", "run/u", "run/t")))
    same(read_log(tmp_path / "new.mat", Columns(3, 2, 1)))


def test_units_are_converted(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(text_of(",", ".", [], ["t", "u", "q"]))
    found = read_log(path, Columns("q", "u", "t", 1e-3, -35.0, 1e-6))
    np.testing.assert_array_equal(found.position, 1e-3 * POSITION)
    np.testing.assert_array_equal(found.input, -35.0 * INPUT)
    np.testing.assert_array_equal(found.time, 1e-6 * TIME)


@pytest.mark.parametrize(
    ("text", "names", "rows"),
    [
        ("0 ,100 ,2\n1 ,101 ,3\n", (3, 2, 1), [[0, 100, 2], [1, 101, 3]]),
        ("t;u;q\n0;0;0\n0,001;1,5;2\n", ("q", "u", "t"), [[0, 0, 0], [0.001, 1.5, 2]]),
        ("# Drive log 2024\nt u q x\n1 2 3 4\n", ("q", "u", "t"), [[1, 2, 3]]),
        ("# 24 drive log\nt u q\n1 2 3\n", ("q", "u", "t"), [[1, 2, 3]]),
        ("# Drive log 7\n", None, None),
    ],
)
def test_what_looks_like_another_layout_is_read_as_it_is(tmp_path, text, names, rows):
    """The layout of these texts is ambiguous.

    They have blanks before commas, a first row without a decimal mark, or comments that look like
    names or numbers.
    """
    path = tmp_path / "log.csv"
    path.write_text(text)
    if names is None:
        with pytest.raises(ValueError, match="no row of numbers"):
            read_log(path, NAMED)
        return
    found = read_log(path, Columns(*names))
    np.testing.assert_array_equal(np.stack([found.time, found.input, found.position], 1), rows)


def test_a_header_in_another_encoding_is_read(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes("t [s],q [µm],u\n0,1,2\n1,3,4\n".encode("latin-1"))
    np.testing.assert_array_equal(read_log(path, Columns(2, "u", "t [s]")).position, [1, 3])


def test_arrays_that_hold_no_real_numbers_are_refused(tmp_path):
    savemat(tmp_path / "log.mat", {"log": {"t": TIME}, "z": 1j * TIME})
    table = np.zeros(3, dtype=[("t", float), ("u", float)])
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["table"] = table
    for name, column in (("log.mat", "log"), ("log.mat", "z"), ("log.h5", "table")):
        with pytest.raises(ValueError, match=f"{name}: {column} must hold real numbers, but holds"):
            read_log(tmp_path / name, Columns(column, column))


def test_a_missing_number_is_none(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,u,q\n0.0,1.0,2.0\n0.001,,2.5\n0.002,nan,2.5\n0.003,1.0,\n")
    found = read_log(path, NAMED)
    assert np.isnan(found.input).tolist() == [False, True, True, False]
    assert np.isnan(found.position).tolist() == [False, False, False, True]


@pytest.mark.parametrize(
    ("name", "content", "columns", "said"),
    [
        ("log.csv", "", NAMED, "is empty"),
        ("log.csv", "t,u,q\n", NAMED, "no row of numbers"),
        ("log.csv", "t,u,y\n0,1,2\n", NAMED, "no column 'q'; it has t, u, y"),
        ("log.csv", "0,1,2\n", Columns(4, 2, 1), "column 4 must be from 1 to 3"),
        ("log.csv", "t,u,q\n0,1,2\n1,off,3\n", NAMED, "off"),
        ("log.mat", "no matrix", NAMED, r"log\.mat"),
        ("log.h5", "no HDF5", NAMED, r"log\.h5"),
        ("log.bin", "0", NAMED, r"must end in \.csv"),
    ],
)
def test_what_is_no_log_is_refused_in_a_sentence(tmp_path, name, content, columns, said):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ValueError, match=said) as refused:
        read_log(path, columns)
    assert name in str(refused.value)


def test_arrays_that_do_not_belong_together_are_refused(tmp_path):
    path = tmp_path / "log.mat"
    savemat(path, {"t": TIME, "u": INPUT[1:], "q": POSITION})
    with pytest.raises(ValueError, match=r"one length, but are \{'t': 40, 'q': 40, 'u': 39\}"):
        read_log(path, NAMED)
    with pytest.raises(ValueError, match="no array 'y'; it has t, u, q"):
        read_log(path, Columns("y", "u"))
    with pytest.raises(ValueError, match="0 matrices instead of one"):
        read_log(path, Columns(1, 2))


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize(
    "columns",
    [
        Columns("q", "u", "t", 1e-3, -0.5, 1e-3),
        Columns(5, 2, 1, 1e-6),
        Columns("position", "input"),
    ],
)
def test_a_written_log_is_read_back(tmp_path, columns, delay):
    """In the file, a command is recorded `delay` sample periods before it acts."""
    rng = np.random.default_rng(0)
    log = Log(rng.normal(size=40), rng.normal(size=41), 1e-3, 1e-6)
    (tmp_path / "log.csv").write_bytes(log_bytes(log, columns, delay))
    recorded = read_log(tmp_path / "log.csv", columns)
    (piece,) = steady_segments(recorded, 1e-3, 1e-6, delay)
    np.testing.assert_allclose(piece.log.position, log.position[delay:], rtol=1e-11)
    np.testing.assert_allclose(piece.log.input, log.input[delay:], rtol=1e-11)
