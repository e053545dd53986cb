"""A recorded log as arrays in a MAT or HDF5 file, found by name or number."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float
from scipy.io import loadmat

from jaxid._checks import require
from jaxid.io.recorded import Column, place_of


def read_mat(path: Path, wanted: Sequence[Column]) -> list[Float[np.ndarray, " n"]]:
    """Return arrays of a MAT file of any version by name, or columns of its matrix by number.

    Args:
        path: MAT file.
        wanted: names of arrays, or numbers of columns.

    Raises:
        ValueError: if the file cannot be read, or there is no such array or column.
    """
    if h5py.is_hdf5(path):  # version 7.3
        return read_hdf5(path, wanted)
    try:
        found = loadmat(path)
    except Exception as error:  # loadmat raises many kinds of errors for a broken file
        raise ValueError(f"no MAT file that can be read ({error}).") from None
    return _of_arrays({k: v for k, v in found.items() if not k.startswith("__")}, wanted)


def read_hdf5(path: Path, wanted: Sequence[Column]) -> list[Float[np.ndarray, " n"]]:
    """Return arrays of an HDF5 file by name, or columns of its matrix by number.

    Args:
        path: HDF5 file.
        wanted: names of arrays, or numbers of columns.

    Raises:
        ValueError: if there is no such array or column.
    """
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
    return rows[:, place_of(column, [str(k + 1) for k in range(rows.shape[1])])]


def _numbers(name: str, array: np.ndarray | h5py.Dataset) -> Float[np.ndarray, "..."]:
    require(
        array.dtype.kind in "biuf",
        f"{name} must hold real numbers, but holds {array.dtype}; a struct or a table has to be "
        "written as one array for each column.",
    )
    return np.asarray(array[()], dtype=float)
