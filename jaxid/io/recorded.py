"""A recorded log as arrays in SI units, and the columns of the file that it comes from."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

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
