"""Data sets in netCDF files."""

from pathlib import Path

import xarray as xr

from jaxid.io.files import write_bytes


def dataset_bytes(dataset: xr.Dataset) -> bytes:
    """Return a data set as netCDF (HDF5), compressed without loss.

    The same data set gives the same bytes.
    """
    packed = {"zlib": True, "complevel": 9, "shuffle": True}
    encoding = dict.fromkeys(dataset.data_vars, packed)
    return bytes(dataset.to_netcdf(engine="h5netcdf", encoding=encoding))


def write_dataset(path: Path, dataset: xr.Dataset) -> None:
    """Write a data set to a netCDF file; a file that already has this content is left untouched."""
    write_bytes(path, dataset_bytes(dataset))


def read_dataset(path: Path) -> xr.Dataset:
    """Return the data set in a netCDF file, loaded into memory."""
    return xr.load_dataset(path, engine="h5netcdf")
