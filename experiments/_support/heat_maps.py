"""Heat maps of the sweep, drawn from its data set."""

from pathlib import Path

import numpy as np
import xarray as xr

from experiments.axes import linear_motor as motor
from experiments.paper.figures import SYMBOLS
from jaxid.io import plots
from jaxid.sweep.dataset import names

REFERENCE = {"gains": "as chosen", "scenario": "cogging, friction"}


def draw(folder: Path, sweep: xr.Dataset) -> None:
    """All of them."""
    bounds(folder, sweep)
    errors(folder, sweep)
    tracking(folder, sweep)


def bounds(folder: Path, sweep: xr.Dataset) -> None:
    """J_f of each parameter on the motions designed for it, over the horizon and the bandwidth."""
    designs, columns = names(sweep.design), names(sweep.bandwidth)
    canvas, panels = plots.figure(len(designs), 1, (7.5, 2.6 * len(designs)))
    for panel, name in zip(panels, designs, strict=True):
        own = sweep.sel(REFERENCE | {"design": name, "parameter": name})
        percent = 100 * (own.bound / own.half_width).transpose("horizon", "bandwidth").values
        plots.heat_map(panel, percent, names(sweep.horizon), columns, "{:.1f}", highest=100.0)
        title = f"$J_f$ of {SYMBOLS[name]}, % of half its prior box"
        plots.label(panel, "", "horizon N", title)
    canvas.suptitle("hatched: no such motion; orange: the box is not reduced", fontsize=12)
    panels[-1].set_xlabel("bandwidth w of the filter (rad/s)", fontsize=12)
    plots.save(canvas, folder / "sweep_bound.png")


def errors(folder: Path, sweep: xr.Dataset) -> None:
    """How much of J_f the true error takes, at most over bandwidths and the gains that are stable.

    An adversary against tracking comes close to all of it: J_f is hardly more than it must be.
    """
    designs = names(sweep.design)
    canvas, panels = plots.figure(1, len(designs), (9.0, 4.3))
    for panel, name in zip(panels, designs, strict=True):
        own = sweep.sel(design=name, parameter=name).dropna("horizon")
        # ∞/∞ of a loop that diverged is NaN, which the maximum passes over
        worst = (own.error / own.bound).max(["bandwidth", "gains"])
        percent = 100 * worst.transpose("scenario", "horizon").values
        rows = names(own.scenario) if panel is panels[0] else [""] * own.scenario.size
        plots.heat_map(panel, percent, rows, names(own.horizon), "{:.0f}", highest=100.0)
        plots.label(panel, "horizon N", "", f"error of {SYMBOLS[name]}, % of $J_f$")
    canvas.suptitle("The largest of all bandwidths and stable gains", fontsize=12)
    plots.save(canvas, folder / "sweep_error.png")


def tracking(folder: Path, sweep: xr.Dataset) -> None:
    """Peak tracking error and input over gains and scenarios, at most over all motions."""
    canvas, (above, below) = plots.figure(2, 1, (7.5, 8.5))
    rows, columns, motions = names(sweep.gains), names(sweep.scenario), ["design", "horizon"]
    error = 1e6 * sweep.tracking_error.max(motions).transpose("gains", "scenario").values
    plots.heat_map(above, error, rows, [""] * len(columns), "{:.0f}", logarithmic=True)
    plots.label(above, "", "", "Largest tracking error, µm (∞: the loop diverges)")
    limit = float(np.max(np.abs(np.asarray(motor.limits().input))))
    largest = np.maximum(sweep.highest_input, -sweep.lowest_input).max(motions)
    percent = 100 / limit * largest.transpose("gains", "scenario").values
    plots.heat_map(below, percent, rows, columns, "{:.0f}", highest=100.0)
    plots.label(below, "", "", f"Largest input, % of its limit of {limit:g} V (orange: beyond)")
    below.set_xticklabels(columns, rotation=35, ha="right")
    plots.save(canvas, folder / "sweep_tracking.png")
