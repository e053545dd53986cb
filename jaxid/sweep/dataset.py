"""The results of a sweep as one labelled data set, with units."""

import importlib.metadata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr
from jaxtyping import Shaped

from jaxid.io.files import UNITS
from jaxid.loop.controllers import ARC, PDFeedforward, undelayed
from jaxid.sweep.grid import Grid

LOOP = ("design", "horizon", "gains", "scenario")
FILTERED = (*LOOP, "bandwidth", "parameter")

# dimensions, description and unit of the gains, by class of controller
_GAINS: Mapping[type, Mapping[str, tuple[str | tuple[str, ...], str, str]]] = {
    ARC: {
        "k1": ("gains", "k₁ of (19)", "1/s"),
        "k2": ("gains", "k₂ of (25)", "{u} s/{y}"),
        "epsilon": ("gains", "ε of (26)", "{u} {y}/s"),
        "gamma": (("gains", "parameter"), "diagonal of Γ of (22)", "SI"),
    },
    PDFeedforward: {
        "kp": ("gains", "what the position error is multiplied by", "{u}/{y}"),
        "kd": ("gains", "what the velocity error is multiplied by", "{u} s/{y}"),
    },
}
_VERSIONS = ("jaxid", "jax", "jaxlib", "equinox", "numpy", "xarray")
_PER_PARAMETER = "that of the parameter, see `unit`"


@dataclass(frozen=True)
class Labels:
    """The names along the axes of a grid of closed loops.

    Attributes:
        motions: criterion that each motion was designed for, and its horizon N_i.
        horizons: horizons along the axis of the data set; those without a motion remain empty.
        gains: name of each controller.
        scenarios: name of each scenario.
        shares: by name, the description of a share of disturbance, and its value in each scenario.
        horizon: description of the horizons, and their unit.
    """

    motions: Sequence[tuple[str, int | float]]
    horizons: Sequence[int | float]
    gains: Sequence[str]
    scenarios: Sequence[str]
    shares: Mapping[str, tuple[str, Sequence[float]]] = field(default_factory=dict)
    horizon: tuple[str, str] = ("N_i, half the intervals of a motion", "1")

    @property
    def designs(self) -> list[str]:
        """The criteria that motions were designed for, each once, in order."""
        return list(dict.fromkeys(design for design, _ in self.motions))


def labelled(
    grid: Grid,
    labels: Labels,
    values: Mapping[str, Shaped[np.ndarray, "count *rest"]],
    attributes: Mapping[str, str | int],
) -> xr.Dataset:
    """Return the results of all items of a sweep as a data set with names and units.

    Cells without a motion are NaN; loops that diverged have infinite errors.

    Args:
        grid: motions, controllers, scenarios and bandwidths of the sweep.
        labels: names along the axes.
        values: results of `jaxid.sweep.grid.item` by name, with one entry per item along the first
            axis.
        attributes: attributes of the data set, e.g. the command and the seed.
    """
    variables = _quantities(grid)
    cells = {name: _cells(grid, labels, values[name]) for name in variables}
    data = {name: (dims, cells[name], attrs) for name, (dims, attrs) in variables.items()}
    dataset = xr.Dataset(data, _coordinates(grid, labels), dict(attributes))
    dataset["outside"].encoding = {"dtype": "int8", "_FillValue": -1}
    return dataset.assign_attrs(
        versions=", ".join(f"{name} {importlib.metadata.version(name)}" for name in _VERSIONS)
    )


def names(axis: xr.DataArray) -> list[str]:
    """Return the entries of a coordinate as text, for the labels of a picture."""
    return [f"{value:g}" if axis.dtype.kind in "if" else str(value) for value in axis.values]


def _quantities(grid: Grid) -> dict[str, tuple[tuple[str, ...], dict[str, str]]]:
    """Return the dimensions and attributes of every result of an item."""
    length, force = UNITS[grid.system.coordinate], grid.system.input_unit

    def described(text: str, unit: str) -> dict[str, str]:
        return {"long_name": text, "units": unit}

    quantities = {
        "bound": (FILTERED, described("J_f, worst-case error of the estimate", _PER_PARAMETER)),
        "error": (FILTERED, described("|θ̂ − θ|, error of the estimate", _PER_PARAMETER)),
        "outside": (FILTERED, described("whether the error exceeds its bound", "1")),
        "tracking_error": (LOOP, described("largest |y − y_d| at the ticks", length)),
    }
    for name, text, unit in (
        ("position", "true position at the ticks", length),
        ("velocity", "true velocity at the ticks", f"{length}/s"),
        ("input", "commanded input", force),
    ):
        for end in ("lowest", "highest"):
            quantities[f"{end}_{name}"] = (LOOP, described(f"{end} {text}", unit))
    return quantities


def _coordinates(grid: Grid, labels: Labels) -> dict[str, object]:
    system, known = grid.system, undelayed(grid.controllers)
    length, force = UNITS[system.coordinate], system.input_unit

    def numbers(dims: str | tuple[str, ...], values: object, text: str, unit: str) -> object:
        return dims, np.asarray(values), {"long_name": text, "units": unit}

    return {
        "design": ("design", labels.designs, {"long_name": "what the motion was designed for"}),
        "horizon": numbers("horizon", labels.horizons, *labels.horizon),
        "gains": ("gains", list(labels.gains), {"long_name": "gains of the controller"}),
        "scenario": ("scenario", list(labels.scenarios), {"long_name": "the axis as it truly is"}),
        "bandwidth": numbers("bandwidth", grid.bandwidths, "w of the filter H_f", "rad/s"),
        "parameter": ("parameter", list(system.names), {"long_name": "estimated parameter"}),
        "unit": ("parameter", list(system.units), {"long_name": "unit of the parameter"}),
        "half_width": numbers(
            "parameter", system.half_widths, "half the width of the prior box", _PER_PARAMETER
        ),
        **{
            name: numbers(dims, getattr(known, name), text, unit.format(u=force, y=length))
            for name, (dims, text, unit) in _GAINS.get(type(known), {}).items()
        },
        "theta": numbers(
            ("scenario", "parameter"), grid.scenarios.theta, "true parameters", _PER_PARAMETER
        ),
        **{
            name: numbers("scenario", shares, text, "1")
            for name, (text, shares) in labels.shares.items()
        },
    }


def _cells(
    grid: Grid, labels: Labels, values: Shaped[np.ndarray, "count *rest"]
) -> Shaped[np.ndarray, "design horizon gains scenario *rest"]:
    """Return the items as a table of designs and horizons, NaN where there is no motion."""
    designs, horizons = labels.designs, list(labels.horizons)
    motions, *others = grid.shape
    table = np.full((len(designs), len(horizons), *others, *values.shape[1:]), np.nan)
    by_motion = values.reshape(motions, *others, *values.shape[1:])
    for (design, horizon), found in zip(labels.motions, by_motion, strict=True):
        table[designs.index(design), horizons.index(horizon)] = found
    return table
