import os

import numpy as np
import pytest

from jaxid.io.files import read_table, read_trajectory, write_bytes, write_table, write_trajectory
from jaxid.io.text_tables import text_table


def test_a_trajectory_comes_back_bit_for_bit(tmp_path, motion):
    path = tmp_path / "motion.csv"
    write_trajectory(path, motion)
    again = read_trajectory(path)
    np.testing.assert_array_equal(again.jerk, motion.jerk)
    np.testing.assert_array_equal(again.knot_states().position, motion.knot_states().position)
    rows = read_table(path)
    assert list(rows[0]) == [
        "time_s",
        "position_m",
        "velocity_m_s",
        "acceleration_m_s2",
        "jerk_m_s3",
    ]
    assert len(rows) == 61
    assert float(rows[-1]["time_s"]) == 0.6
    assert float(rows[-1]["jerk_m_s3"]) == 0.0


def test_writing_the_same_again_touches_nothing(tmp_path, motion):
    path = tmp_path / "motion.csv"
    write_trajectory(path, motion)
    os.utime(path, (1, 1))
    write_trajectory(path, motion)
    assert path.stat().st_mtime == 1


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    path = tmp_path / "table.csv"
    write_bytes(path, b"old")
    monkeypatch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError("disk")))
    with pytest.raises(OSError, match="disk"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["table.csv"]


def test_tables_keep_every_digit_and_leave_the_absent_empty(tmp_path):
    path = tmp_path / "table.csv"
    write_table(path, ("a", "b", "c"), [{"a": 0.1, "b": None, "c": False}])
    assert read_table(path) == [{"a": "0.10000000000000001", "b": "", "c": "false"}]


def test_a_file_without_its_columns_is_refused(tmp_path):
    path = tmp_path / "motion.csv"
    path.write_text("time,jerk\n0,1\n")
    with pytest.raises(ValueError, match="must have the columns"):
        read_trajectory(path)


@pytest.mark.parametrize("damage", [lambda t: t[:-40], lambda t: "".join(t.splitlines(True)[:2])])
def test_a_damaged_trajectory_is_refused(tmp_path, motion, damage):
    path = tmp_path / "motion.csv"
    write_trajectory(path, motion)
    path.write_text(damage(path.read_text()))
    with pytest.raises(ValueError, match="two rows at least, and a number in each"):
        read_trajectory(path)


def test_text_tables_line_up():
    lines = text_table(("name", "J"), [("M", 0.00469), ("long name", None)], "Title").splitlines()
    assert lines[0] == "Title"
    assert len({len(line) for line in lines[1:]}) == 1
    assert lines[-1].endswith("-")


def test_text_with_commas_and_quotes_comes_back_as_it_was(tmp_path):
    text = 'one, "two"\nthree'
    write_table(tmp_path / "table.csv", ("a", "b"), [{"a": text, "b": 1}])
    assert read_table(tmp_path / "table.csv") == [{"a": text, "b": "1"}]
