"""A recorded log in a file: CSV, MAT or HDF5, its columns found by name or number, in SI units."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxid._checks import require
from jaxid.io.recorded import Column, Columns, Recorded

_ENDINGS = (".csv", ".txt", ".mat", ".h5", ".hdf5")


def read_log(path: Path | str, columns: Columns) -> Recorded:
    """Return the rows of a log file, in SI units.

    Args:
        path: file that ends in .csv or .txt (with or without a header, numbers separated by commas,
            semicolons, tabs or blanks), .mat (any version; one variable per column, or one matrix)
            or .h5, .hdf5 (likewise).
        columns: columns of the file and their units.

    Raises:
        ValueError: if the file is of another kind, cannot be read, lacks a column, or has columns
            of different length.
    """
    path = Path(path)
    ending = path.suffix.lower()
    require(
        ending in _ENDINGS,
        f"Argument `path` must end in {', '.join(_ENDINGS)}, but is {path}.",
    )
    require(path.stat().st_size > 0, f"File {path} is empty.")
    wanted = [c for c in (columns.time, columns.position, columns.input) if c is not None]
    try:
        found = _read(path, ending, wanted)
    except (ValueError, OSError, KeyError) as error:
        raise ValueError(f"File {path}: {error}") from None
    require(len(found[0]) > 0, f"File {path} holds no row of numbers.")
    sizes = dict(zip(map(str, wanted), map(len, found), strict=True))
    require(
        len(set(sizes.values())) == 1,
        f"File {path}: columns must be of one length, but are {sizes}.",
    )
    *time, position, input = found
    return Recorded(
        time[0] * columns.time_unit if time else None,
        position * columns.position_unit,
        input * columns.input_unit,
    )


def _read(path: Path, ending: str, wanted: Sequence[Column]) -> list[Float[np.ndarray, " n"]]:
    """Return columns of a file; only the packages that it needs are imported, which takes time."""
    if ending in (".csv", ".txt"):
        from jaxid.io.csv_log import read_columns

        return read_columns(path, wanted)
    from jaxid.io.array_log import read_hdf5, read_mat

    return read_mat(path, wanted) if ending == ".mat" else read_hdf5(path, wanted)
