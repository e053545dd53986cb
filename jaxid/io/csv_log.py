"""A recorded log as text: columns of numbers, found by name or number."""

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from jaxid.io.recorded import Column, Columns, place_of
from jaxid.loop.log import Log

_CHUNK = 1_000_000  # rows of a file that are in memory as text at a time
_HEAD = 200  # lines, at most, before the first row of numbers
_BLANKS = r"\s+"
_COMMENTS = ("#", "%")  # marks with which header lines may begin, the line of names too


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


def read_columns(path: Path, wanted: Sequence[Column]) -> list[Float[np.ndarray, " n"]]:
    """Return columns of a text file, in its units.

    Args:
        path: file with or without a header, its numbers separated by commas, semicolons, tabs or
            blanks.
        wanted: names or numbers of the columns.

    Raises:
        ValueError: if there is no such column, or no row of numbers.
    """
    before, names, separator, decimal = _layout(path)
    places = [place_of(column, names) for column in wanted]
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
