"""A recorded log in a file: CSV, MAT or HDF5, its columns found by name or number, in SI units."""

from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
from jaxtyping import Float
from scipy.io import loadmat

from jaxid._checks import require
from jaxid.io.recorded import Column, Columns, Recorded
from jaxid.loop.log import Log

_CHUNK = 1_000_000  # rows of a CSV file that are in memory as text at a time
_HEAD = 200  # lines, at most, before the first row of numbers
_BLANKS = r"\s+"
_COMMENTS = ("#", "%")  # marks with which header lines may begin, the line of names too


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
        ending in _READERS,
        f"Argument `path` must end in {', '.join(_READERS)}, but is {path}.",
    )
    require(path.stat().st_size > 0, f"File {path} is empty.")
    wanted = [c for c in (columns.time, columns.position, columns.input) if c is not None]
    try:
        found = _READERS[ending](path, wanted)
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


def log_bytes(log: Log, columns: Columns, delay: int = 0) -> bytes:
    """Return the content of a CSV file of a log, as a drive records it.

    Args:
        log: log, whose inputs are those that acted.
        columns: columns of the file and their units, by which `read_log` reads it again; all other
            columns are zero.
        delay: number of sample periods from a command until it acts.
    """
    position = np.asarray(log.position)
    acting = np.asarray(log.input)
    commanded = np.append(acting, acting[-1:])[delay:]  # the last command acts after the log
    values: dict[Column, np.ndarray] = {}
    if columns.time is not None:
        values[columns.time] = np.arange(position.size) * float(log.period) / columns.time_unit
    values[columns.position] = position / columns.position_unit
    values[columns.input] = np.pad(commanded, (0, delay), mode="edge") / columns.input_unit
    numbered = {column: x for column, x in values.items() if isinstance(column, int)}
    named = {column: x for column, x in values.items() if isinstance(column, str)}
    table: dict[str, np.ndarray] = {}
    for number in range(1, max(numbered, default=0) + 1):
        table[f"column_{number}"] = numbered.get(number, np.zeros(position.size))
    return pd.DataFrame(table | named).to_csv(index=False, float_format="%.12g").encode()


def _read_csv(path: Path, wanted: Sequence[Column]) -> list[Float[np.ndarray, " n"]]:
    before, names, separator, decimal = _layout(path)
    places = [_place(column, names) for column in wanted]
    parts = pd.read_csv(
        path,
        sep=separator,
        decimal=decimal,
        header=None,
        skiprows=before,
        usecols=sorted(set(places)),
        dtype=float,
        chunksize=_CHUNK,
        encoding="utf-8-sig",
        encoding_errors="replace",  # units in the header may be encoded otherwise
    )
    rows = pd.concat(list(parts))
    return [rows[place].to_numpy() for place in places]


def _layout(path: Path) -> tuple[int, list[str], str, str]:
    """Return the number of header lines, the column names, the separator and the decimal mark."""
    before: list[str] = []
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        for line in islice(file, _HEAD):
            separator, decimal = _marks(line)
            fields = _fields(line, separator)
            numeric = bool(fields) and all(_is_number(field, decimal) for field in fields)
            if numeric and not _is_comment(line):
                if separator != "," and any("," in later for later in islice(file, _HEAD)):
                    decimal = ","  # the first row may have no decimal mark, such as a row of zeros
                return len(before), _names(before, separator, len(fields)), separator, decimal
            before.append(line)
    raise ValueError(f"no row of numbers among its first {_HEAD} lines.")


def _names(before: Sequence[str], separator: str, count: int) -> list[str]:
    """Return the names of the columns: from the first line with as many fields, otherwise numbers.

    A comment line is used only if there is no other line. A second such line contains units.
    Numbers in a comment, such as a date, are not names.
    """
    for line in sorted(before, key=_is_comment):
        fields = _fields(line, separator)
        if len(fields) == count and not all(_is_number(field, ".") for field in fields):
            return fields
    return [str(k + 1) for k in range(count)]


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _bare(line: str) -> str:
    return line.strip().lstrip("".join(_COMMENTS)).strip()


def _fields(line: str, separator: str) -> list[str]:
    text = _bare(line)
    fields = text.split() if separator == _BLANKS else text.split(separator)
    return [field.strip().strip('"') for field in fields] if text else []


def _marks(line: str) -> tuple[str, str]:
    """Return separator and decimal mark of a row of numbers."""
    text = _bare(line)
    words = text.split()
    # commas inside words are decimal marks: 0,001 1,5
    parted = len(words) > 1 and not any(word[0] == "," or word[-1] == "," for word in words)
    marks = ";\t" if parted else ";\t,"
    separator = next((mark for mark in marks if mark in text), _BLANKS)
    return separator, "," if separator != "," and "," in text else "."


def _is_number(field: str, decimal: str) -> bool:
    try:
        float(field.replace(decimal, ".") or "nan")
    except ValueError:
        return False
    return True


def _place(column: Column, names: Sequence[str]) -> int:
    """Return the index of a column, from 0."""
    if isinstance(column, int):
        require(
            1 <= column <= len(names),
            f"column {column} must be from 1 to {len(names)}, which it has.",
        )
        return column - 1
    require(column in names, f"no column {column!r}; it has {', '.join(names)}.")
    return names.index(column)


def _read_mat(path: Path, wanted: Sequence[Column]) -> list[Float[np.ndarray, " n"]]:
    if h5py.is_hdf5(path):  # version 7.3
        return _read_hdf5(path, wanted)
    try:
        found = loadmat(path)
    except Exception as error:  # loadmat raises many kinds of errors for a broken file
        raise ValueError(f"no MAT file that can be read ({error}).") from None
    return _of_arrays({k: v for k, v in found.items() if not k.startswith("__")}, wanted)


def _read_hdf5(path: Path, wanted: Sequence[Column]) -> list[Float[np.ndarray, " n"]]:
    with h5py.File(path) as file:
        arrays: dict[str, h5py.Dataset] = {}

        def keep(name: str, item: object) -> None:
            if isinstance(item, h5py.Dataset):
                arrays[name] = item

        file.visititems(keep)
        return _of_arrays(arrays, wanted)


def _of_arrays(
    arrays: Mapping[str, np.ndarray | h5py.Dataset], wanted: Sequence[Column]
) -> list[Float[np.ndarray, " n"]]:
    """Return whole arrays by name, or columns of the only matrix by number."""
    return [_of_arrays_one(arrays, column) for column in wanted]


def _of_arrays_one(
    arrays: Mapping[str, np.ndarray | h5py.Dataset], column: Column
) -> Float[np.ndarray, " n"]:
    if isinstance(column, str):
        require(column in arrays, f"no array {column!r}; it has {', '.join(arrays)}.")
        return _numbers(column, arrays[column]).ravel()
    matrices = [a for a in arrays.values() if a.ndim == 2 and min(a.shape) > 1]
    require(
        len(matrices) == 1,
        f"column {column} is a number, but it has {len(matrices)} matrices instead of one; its "
        f"arrays are {', '.join(arrays)}.",
    )
    matrix = _numbers("its matrix", matrices[0])
    rows = matrix if matrix.shape[0] >= matrix.shape[1] else matrix.T  # time is the longer side
    return rows[:, _place(column, [str(k + 1) for k in range(rows.shape[1])])]


def _numbers(name: str, array: np.ndarray | h5py.Dataset) -> Float[np.ndarray, "..."]:
    require(
        array.dtype.kind in "biuf",
        f"{name} must hold real numbers, but holds {array.dtype}; a struct or a table has to be "
        "written as one array for each column.",
    )
    return np.asarray(array[()], dtype=float)


Reader = Callable[[Path, Sequence[Column]], list[Float[np.ndarray, " n"]]]
_READERS: Mapping[str, Reader] = {
    ".csv": _read_csv,
    ".txt": _read_csv,
    ".mat": _read_mat,
    ".h5": _read_hdf5,
    ".hdf5": _read_hdf5,
}
