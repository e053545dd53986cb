"""Files out and in: CSV with 17 digits and JSON; one file is written whole or not at all.

Functions that end in `_bytes` return the content of a file, so that all files of a result exist in
memory before the first one is written (`jaxid.io.results`).
"""

import csv
import io
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Float

from jaxid._checks import require
from jaxid.motion.trajectory import JerkTrajectory, trimmed, uniform

UNITS = {"linear": "m", "rotary": "rad"}
STATES = ("position", "velocity", "acceleration", "jerk")

Cell = str | float | int | bool | None


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all; a file that already has this content is left untouched.

    Args:
        path: file to write; its folder is made if necessary.
        data: content of the file.
    """
    path = Path(path)
    if path.exists() and path.read_bytes() == data:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def table_bytes(header: Sequence[str], rows: Iterable[Mapping[str, Cell]]) -> bytes:
    """Return a CSV table; floats have up to 17 significant digits, None is an empty cell.

    Args:
        header: names of the columns.
        rows: values of each row by column name.
    """
    lines = [",".join(header)]
    for row in rows:
        lines.append(",".join(_cell(row[name]) for name in header))
    return ("\n".join(lines) + "\n").encode()


def write_table(path: Path, header: Sequence[str], rows: Iterable[Mapping[str, Cell]]) -> None:
    """Write a CSV table to a file; the arguments are those of `table_bytes`."""
    write_bytes(path, table_bytes(header, rows))


def json_bytes(data: msgspec.Struct) -> bytes:
    """Return a structure as indented JSON; null stands for NaN and infinity."""
    return msgspec.json.format(msgspec.json.encode(data), indent=2) + b"\n"


def read_table(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file as text, by column name."""
    return table_in(path.read_bytes())


def table_in(data: bytes) -> list[dict[str, str]]:
    """Return the rows of a CSV table, given by its bytes, as text by column name."""
    return list(csv.DictReader(io.StringIO(data.decode(), newline="")))


def trajectory_bytes(trajectory: JerkTrajectory, coordinate: str = "linear") -> bytes:
    """Return a motion as a CSV table with one row per knot.

    The jerk of a row holds until the next row; the last jerk is zero.

    Args:
        trajectory: motion; padding is left out.
        coordinate: "linear" (m) or "rotary" (rad), for the column names.
    """
    trajectory = trimmed(trajectory)
    y, v, a = (np.asarray(x) for x in trajectory.knot_states())
    jerk = np.append(np.asarray(trajectory.jerk), 0.0)
    # multiples of a period are written as such, not as sums of rounded ones
    time = np.asarray(trajectory.knot_times()).round(12)
    columns = dict(zip(trajectory_header(coordinate), (time, y, v, a, jerk), strict=True))
    rows = ({name: float(x[k]) for name, x in columns.items()} for k in range(len(time)))
    return table_bytes(list(columns), rows)


def write_trajectory(path: Path, trajectory: JerkTrajectory, coordinate: str = "linear") -> None:
    """Write a motion to a CSV file with one row per knot, see `trajectory_bytes`."""
    write_bytes(path, trajectory_bytes(trajectory, coordinate))


def read_trajectory(path: Path, coordinate: str = "linear") -> JerkTrajectory:
    """Return the motion in a CSV file of `write_trajectory`.

    Only its times, its first state and its jerk are used.

    Args:
        path: CSV file.
        coordinate: "linear" (m) or "rotary" (rad), for the column names.

    Raises:
        ValueError: if the file has other columns, or its times are not equally spaced.
    """
    return trajectory_in(path.read_bytes(), path, coordinate)


def trajectory_in(data: bytes, path: Path, coordinate: str = "linear") -> JerkTrajectory:
    """Return the motion in the bytes of a CSV file of `write_trajectory`.

    Args:
        data: content of the file.
        path: name of the file, for error messages.
        coordinate: "linear" (m) or "rotary" (rad), for the column names.

    Raises:
        ValueError: if the file has other columns, or its times are not equally spaced.
    """
    rows = table_in(data)
    header = trajectory_header(coordinate)
    require(
        len(rows) > 1 and all(row.get(name) for row in rows for name in header),
        f"Argument `path`: {path} must have the columns {list(header)}, two rows at least, and a "
        "number in each.",
    )
    column = {name: _column(rows, name) for name in header}
    names = header[1:4]
    start = jnp.asarray([column[name][0] for name in names])
    periods = np.diff(column["time_s"])
    require(
        bool(np.all(np.abs(periods - periods[0]) < 1e-9)),
        f"Argument `path`: the times of {path} must be equally spaced.",
    )
    return uniform(start, jnp.asarray(column[header[4]][:-1]), round(float(periods[0]), 12))


def trajectory_header(coordinate: str = "linear") -> tuple[str, ...]:
    """Return the column names of a trajectory table, with units, e.g. velocity_m_s.

    Args:
        coordinate: "linear" (m) or "rotary" (rad).
    """
    unit = UNITS[coordinate]
    suffixes = (unit, f"{unit}_s", f"{unit}_s2", f"{unit}_s3")
    return ("time_s", *(f"{name}_{suffix}" for name, suffix in zip(STATES, suffixes, strict=True)))


def _column(rows: Sequence[Mapping[str, str]], name: str) -> Float[np.ndarray, " n"]:
    return np.array([float(row[name]) for row in rows])


def _cell(value: Cell) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    text = f"{value:.17g}" if isinstance(value, float) else str(value)
    quoted = any(mark in text for mark in ',"\r\n')
    return '"' + text.replace('"', '""') + '"' if quoted else text
