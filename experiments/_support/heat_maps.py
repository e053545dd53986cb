"""Heat maps of the sweep, drawn from its data set."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from experiments.axes import linear_motor as motor
from experiments.paper.figures import SYMBOLS
from jaxid.io import plots
from jaxid.sweep.dataset import names

NOMINAL = "nominal gains"
REFERENCE = {"gains": NOMINAL, "scenario": "cogging, friction"}


def draw(folder: Path, sweep: xr.Dataset) -> None:
    """Draw the three heat maps into a folder."""
    bounds(folder, sweep)
    errors(folder, sweep)
    tracking(folder, sweep)


def bounds(folder: Path, sweep: xr.Dataset) -> None:
    """Draw J_f of each parameter over duration and bandwidth, for the motions designed for it."""
    designs, columns = names(sweep.design), names(sweep.bandwidth)
    canvas, panels = plots.figure(len(designs), 1, (8.5, 2.4 * len(designs)))
    for panel, name in zip(panels, designs, strict=True):
        own = sweep.sel(REFERENCE | {"design": name, "parameter": name}).dropna(
            "horizon", how="all"
        )
        percent = 100 * (own.bound / own.half_width).transpose("horizon", "bandwidth").values
        rows = _seconds(own.horizon)
        plots.heat_map(panel, percent, rows, columns, "{:.1f}", highest=100.0, ends=(0.0, 100.0))
        plots.label(panel, "", "duration (s)", f"{SYMBOLS[name]}, motion designed for it")
    title = "$J_f$ in % of the prior half-width (orange-red: the prior interval is not reduced)"
    canvas.suptitle(title, fontsize=12)
    panels[-1].set_xlabel("bandwidth w of the filter (rad/s)", fontsize=12)
    plots.save(canvas, folder / "sweep_bound.png")


def errors(folder: Path, sweep: xr.Dataset) -> None:
    """Draw the largest true error as a share of J_f, over all bandwidths and all stable gains."""
    designs = names(sweep.design)
    canvas, panels = plots.figure(1, len(designs), (10.0, 4.6))
    for panel, name in zip(panels, designs, strict=True):
        own = sweep.sel(design=name, parameter=name).dropna("horizon")
        # a diverged loop gives ∞/∞ = NaN, which the maximum ignores
        worst = (own.error / own.bound).max(["bandwidth", "gains"])
        percent = 100 * worst.transpose("scenario", "horizon").values
        rows = names(own.scenario) if panel is panels[0] else [""] * own.scenario.size
        plots.heat_map(
            panel, percent, rows, _seconds(own.horizon), "{:.0f}", highest=100.0, ends=(0.0, 100.0)
        )
        plots.label(panel, "duration (s)", "", SYMBOLS[name])
    title = "Largest true error in % of its bound $J_f$, over all bandwidths and stable gains"
    canvas.suptitle(title, fontsize=12)
    plots.save(canvas, folder / "sweep_error.png")


def tracking(folder: Path, sweep: xr.Dataset) -> None:
    """Draw the peak tracking error and the peak input of all motions, over gains and scenarios."""
    canvas, (above, below) = plots.figure(2, 1, (8.5, 8.5))
    rows, columns, motions = names(sweep.gains), names(sweep.scenario), ["design", "horizon"]
    error = 1e6 * sweep.tracking_error.max(motions).transpose("gains", "scenario").values
    plots.heat_map(above, error, rows, [""] * len(columns), "{:.0f}", logarithmic=True)
    title = "Largest tracking error of all motions (µm; ∞: the loop diverges)"
    plots.label(above, "", "gains of ARC", title)
    limit = float(np.max(np.abs(np.asarray(motor.limits().input))))
    largest = np.maximum(sweep.highest_input, -sweep.lowest_input).max(motions)
    percent = 100 / limit * largest.transpose("gains", "scenario").values
    plots.heat_map(below, percent, rows, columns, "{:.0f}", highest=100.0)
    title = f"Largest input in % of its limit of {limit:g} V (orange-red: limit exceeded)"
    plots.label(below, "", "gains of ARC", title)
    below.set_xticklabels(columns, rotation=35, ha="right")
    plots.save(canvas, folder / "sweep_tracking.png")


def _seconds(horizons: xr.DataArray) -> Sequence[str]:
    return [f"{motor.seconds(int(n)):g}" for n in horizons]
