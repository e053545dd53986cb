"""Set-points of a motion: sampled at the period of a servo, in files that servos read, and checked.

The check reads the numbers back from a file, and assumes that the servo holds the positions, or
joins them by straight lines: their slopes and the changes of slope give velocity and acceleration.
"""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple, TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.io import loadmat, savemat

from jaxid._checks import require, require_concrete, require_float64, require_positive
from jaxid.io.files import table_bytes, table_in, trajectory_header, write_bytes
from jaxid.motion.limits import Limits
from jaxid.motion.trajectory import JerkTrajectory, states_at, ticks

Way = TypeVar("Way")
VARIABLE = "setpoints"  # name of the matrix, and of the array in C


class Setpoints(NamedTuple):
    """The states of a motion at every sample of a servo, the last one included; shapes (n + 1,).

    Attributes:
        time: times of the samples, s.
        position: positions, m or rad.
        velocity: velocities, m/s or rad/s.
        acceleration: accelerations, m/s² or rad/s².
    """

    time: Float[np.ndarray, " samples"]
    position: Float[np.ndarray, " samples"]
    velocity: Float[np.ndarray, " samples"]
    acceleration: Float[np.ndarray, " samples"]


def sampled(trajectory: JerkTrajectory, period: float) -> Setpoints:
    """Return a motion as set-points: its states at every sample of a servo, the end included.

    Args:
        trajectory: motion.
        period: sample period of the servo, s.

    Raises:
        ValueError: if the motion does not last a whole number of sample periods.
    """
    require_float64(trajectory=trajectory)
    require_concrete(
        "a list of setpoints",
        "Trace `JerkTrajectory.states`.",
        trajectory=trajectory,
        period=period,
    )
    require_positive("period", "set-points", period)
    at = np.arange(ticks(trajectory, period) + 1)
    states = states_at(trajectory, jnp.asarray(at * period))
    # multiples of a period are written as such
    return Setpoints((at * period).round(12), *map(np.asarray, states))


def margins(setpoints: Setpoints, limits: Limits) -> dict[str, float]:
    """Return the margin of set-points to each limit of position, velocity and acceleration.

    A margin is a share of the half-width of the limit; below zero, the limit is exceeded. Velocity
    and acceleration are first and second differences of the positions. Rounding of the positions
    changes them by about ε|y|/h and ε|y|/h²: a motion that touches an acceleration limit may have a
    margin of −1e-9.

    Args:
        setpoints: set-points of a motion.
        limits: limits of the axis.
    """
    h = float(setpoints.time[1] - setpoints.time[0])
    y = setpoints.position
    values = {"position": y, "velocity": np.diff(y) / h, "acceleration": np.diff(y, 2) / h**2}
    return {name: _left(x, getattr(limits, name)) for name, x in values.items()}


def write_setpoints(path: Path | str, setpoints: Setpoints, coordinate: str = "linear") -> None:
    """Write set-points to a file in the format of its ending.

    Args:
        path: file that ends in .csv (a header with units, one row per sample), .mat (one matrix
            with the rows time, position, velocity and acceleration, as Simulink's From File reads
            it) or .h (an array of C, one row per sample).
        setpoints: set-points to write.
        coordinate: "linear" (m) or "rotary" (rad), for the units.

    Raises:
        ValueError: if the ending is another one.
    """
    path = Path(path)
    write_bytes(path, setpoint_bytes(path, setpoints, coordinate))


def setpoint_bytes(path: Path, setpoints: Setpoints, coordinate: str = "linear") -> bytes:
    """Return set-points as the content of a file; the arguments are those of `write_setpoints`."""
    return _by_ending(path, _WRITERS)(setpoints, coordinate)


def read_setpoints(path: Path, coordinate: str = "linear") -> Setpoints:
    """Return the set-points in a .csv or .mat file of `write_setpoints`.

    Args:
        path: file that ends in .csv or .mat.
        coordinate: "linear" (m) or "rotary" (rad), for the column names.

    Raises:
        ValueError: if the ending is another one, or columns of a CSV file are missing.
    """
    return setpoints_in(path.read_bytes(), path, coordinate)


def setpoints_in(data: bytes, path: Path, coordinate: str = "linear") -> Setpoints:
    """Return the set-points in the bytes of a .csv or .mat file of `write_setpoints`.

    Args:
        data: content of the file.
        path: name of the file, whose ending gives the format.
        coordinate: "linear" (m) or "rotary" (rad), for the column names.

    Raises:
        ValueError: if the ending is another one, or columns of a CSV file are missing.
    """
    return Setpoints(*_by_ending(path, _READERS)(data, path, coordinate))


def _left(values: Float[np.ndarray, "..."], interval: Float[Array, "2"]) -> float:
    low, high = (float(end) for end in interval)
    return float(min(np.min(values) - low, high - np.max(values)) / ((high - low) / 2))


def _csv(setpoints: Setpoints, coordinate: str) -> bytes:
    header = trajectory_header(coordinate)[:4]
    rows = (dict(zip(header, map(float, row), strict=True)) for row in np.stack(setpoints, axis=1))
    return table_bytes(header, rows)


def _mat(setpoints: Setpoints, coordinate: str) -> bytes:
    buffer = io.BytesIO()
    # files are welcome there, whatever its stub says
    savemat(buffer, {VARIABLE: np.stack(setpoints)})  # pyright: ignore[reportArgumentType]
    # without the date in its text, the same motion makes the same bytes
    text = b"MATLAB 5.0 MAT-file, rows: " + ", ".join(trajectory_header(coordinate)[:4]).encode()
    return text.ljust(116) + buffer.getvalue()[116:]


def _header(setpoints: Setpoints, coordinate: str) -> bytes:
    table = np.stack(setpoints, axis=1)
    names = ", ".join(trajectory_header(coordinate)[:4])
    rows = [f"    {{{', '.join(f'{x:.17g}' for x in row)}}}," for row in table]
    lines = [
        f"/* columns: {names} */",
        f"#define {VARIABLE.upper()}_COUNT {len(table)}",
        f"static const double {VARIABLE}[{VARIABLE.upper()}_COUNT][{table.shape[1]}] = {{",
        *rows,
        "};",
    ]
    return ("\n".join(lines) + "\n").encode()


def _read_csv(data: bytes, path: Path, coordinate: str) -> Float[np.ndarray, "4 samples"]:
    rows, header = table_in(data), trajectory_header(coordinate)[:4]
    require(
        bool(rows) and set(header) <= set(rows[0]),
        f"Argument `path`: {path} must have the columns {list(header)}.",
    )
    return np.array([[float(row[name]) for row in rows] for name in header])


def _read_mat(data: bytes, path: Path, coordinate: str) -> Float[np.ndarray, "4 samples"]:
    # files are welcome there, whatever its stub says
    return loadmat(io.BytesIO(data))[VARIABLE]  # pyright: ignore[reportArgumentType]


_WRITERS: Mapping[str, Callable[[Setpoints, str], bytes]] = {
    ".csv": _csv,
    ".mat": _mat,
    ".h": _header,
}
_READERS: Mapping[str, Callable[[bytes, Path, str], Float[np.ndarray, "4 samples"]]] = {
    ".csv": _read_csv,
    ".mat": _read_mat,
}


def _by_ending(path: Path, ways: Mapping[str, Way]) -> Way:
    require(
        path.suffix in ways,
        f"Argument `path` must end in {', '.join(ways)}, but is {path}.",
    )
    return ways[path.suffix]
