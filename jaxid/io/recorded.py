"""A recorded log as arrays in SI units, and the columns of the file that it comes from."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxid._checks import require

Column = str | int


class Columns(NamedTuple):
    """The columns of a log file, each by its name or its number from 1 on, with their units.

    Attributes:
        position: column of the position of the axis.
        input: column of the input as the servo commanded it.
        time: column of the time; default none, for rows that are one sample period apart.
        position_unit: m or rad per unit of the position column.
        input_unit: unit of the axis' input per unit of the input column.
        time_unit: s per unit of the time column.
    """

    position: Column
    input: Column
    time: Column | None = None
    position_unit: float = 1.0
    input_unit: float = 1.0
    time_unit: float = 1.0


class Recorded(NamedTuple):
    """The n rows of a log file; a value that is missing in the file is NaN.

    Attributes:
        time: time, s, shape (n,); None if the file has no such column.
        position: position, m or rad, shape (n,).
        input: input, in the unit of the axis' input, shape (n,).
    """

    time: Float[np.ndarray, " n"] | None
    position: Float[np.ndarray, " n"]
    input: Float[np.ndarray, " n"]


def place_of(column: Column, names: Sequence[str]) -> int:
    """Return the index of a column, from 0.

    Args:
        column: name of the column, or its number from 1.
        names: names of all columns.

    Raises:
        ValueError: if there is no such column.
    """
    if isinstance(column, int):
        require(
            1 <= column <= len(names),
            f"column {column} must be from 1 to {len(names)}, which it has.",
        )
        return column - 1
    require(column in names, f"no column {column!r}; it has {', '.join(names)}.")
    return names.index(column)
