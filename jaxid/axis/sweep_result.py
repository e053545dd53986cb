"""The files and the text of a sweep of closed loops."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import xarray as xr

from jaxid.axis.file import Axis
from jaxid.axis.result import Result
from jaxid.axis.sweep import Sweep
from jaxid.io import plots
from jaxid.io.datasets import dataset_bytes
from jaxid.io.text_tables import text_table
from jaxid.sweep.dataset import names

_USUAL = "× 1"


class SweepRow(NamedTuple):
    """The best bandwidth for one motion and parameter: that of the least worst-case J_f.

    Attributes:
        target: target that the motion was designed for.
        duration: duration of the motion without its approach, s.
        parameter: name of the parameter.
        bandwidth: bandwidth w of H_f, rad/s.
        worst: largest J_f over all scenarios with it, in the unit of the parameter.
        unit: unit of the parameter.
    """

    target: str
    duration: float
    parameter: str
    bandwidth: float
    worst: float
    unit: str


@dataclass(frozen=True, eq=False)
class SweepResult(Result):
    """The result of `jaxid sweep`: closed loops as one data set, beside their designs.

    Attributes:
        found: simulated closed loops.
    """

    found: Sweep
    name: ClassVar[str] = "sweep"
    names: ClassVar[tuple[str, ...]] = ("sweep.nc", "sweep_bound.png", "sweep_tracking.png")

    @property
    def axis(self) -> Axis:
        """The axis whose closed loops were simulated."""
        return self.found.axis

    @property
    def results(self) -> dict[str, str]:
        """The digests of the designs whose motions were simulated, by their places."""
        return {where: one.part.digest for where, one in self.found.saved.designs.items()}

    def summary(self) -> tuple[SweepRow, ...]:
        """Return the best bandwidth for each motion and parameter, with the nominal gains."""
        data = self.found.data
        usual = data.sel(gains=_usual(data)).bound.max("scenario")
        rows = []
        for design in names(data.design):
            for time in data.horizon.values:
                own = usual.sel(design=design, horizon=time)
                if bool(own.isnull().all()):
                    continue
                for name, unit in zip(names(data.parameter), data.unit.values, strict=True):
                    best = own.sel(parameter=name)
                    w, worst = float(best.idxmin("bandwidth")), float(best.min())
                    rows.append(SweepRow(design, float(time), name, w, worst, str(unit)))
        return tuple(rows)

    def files(self) -> Mapping[str, bytes]:
        """Return the content of `sweep.nc` and of both pictures, by name."""
        data = self.found.data
        contents = dataset_bytes(data), bounds_page(data), tracking_page(data)
        return dict(zip(self.names, contents, strict=True))

    def text(self) -> str:
        """Return the result as text: best bandwidths, and the number of diverged loops."""
        data = self.found.data
        header = ("target", "duration (s)", "parameter", "best w (rad/s)", "largest J_f", "unit")
        title = f"Least-squares error bound J_f, worst case of all scenarios, gains {_usual(data)}"
        table = text_table(header, self.summary(), title)
        count = int(data.tracking_error.count())
        diverged = int(np.isinf(data.tracking_error).sum())
        loops = f"{count} closed loops (seed {data.seed}), of which {diverged} diverged."
        kept = data.outside.where(np.isfinite(data.tracking_error))
        share = f"{float(kept.mean()):.1%}"
        misses = (
            f"J_f is not a guaranteed bound: in {share} of the runs a true parameter was outside "
            "θ̂ ± J_f."
        )
        return f"{table}\n{loops}\n{misses}"


def bounds_page(found: xr.Dataset) -> bytes:
    """Return a picture of the largest J_f over all scenarios, by motion and bandwidth, as PNG."""
    parameters = names(found.parameter)
    canvas, panels = plots.figure(len(parameters), 1, (8.0, 2.4 * len(parameters)))
    for panel, name in zip(panels, parameters, strict=True):
        own = found.sel(gains=_usual(found), parameter=name)
        percent = 100 * (own.bound.max("scenario") / own.half_width)
        table = percent.stack(motion=("design", "horizon")).dropna("motion", how="all")
        rows = [f"{design}, {time:g} s" for design, time in table.motion.values]
        values = table.transpose("motion", "bandwidth").values
        plots.heat_map(
            panel, values, rows, names(found.bandwidth), "{:.1f}", highest=100.0, ends=(0.0, 100.0)
        )
        plots.label(panel, "", "", f"worst $J_f$ of {name}, % of half its prior interval")
    canvas.suptitle("motion by bandwidth; orange-red: the interval is not reduced", fontsize=12)
    panels[-1].set_xlabel("bandwidth w of the filter (rad/s)", fontsize=12)
    return plots.png(canvas)


def tracking_page(found: xr.Dataset) -> bytes:
    """Return a picture of the peak tracking error of all motions, by gains and scenario, as PNG."""
    canvas, (panel,) = plots.figure(1, 1, (9.0, 1.8 + 0.7 * found.gains.size))
    worst = found.tracking_error.max(["design", "horizon"]).transpose("gains", "scenario")
    rows, columns = names(found.gains), names(found.scenario)
    plots.heat_map(panel, worst.values, rows, columns, "{:.1e}", logarithmic=True)
    unit = found.tracking_error.attrs["units"]
    plots.label(panel, "", "gains", f"largest tracking error, {unit} (∞: the loop diverges)")
    panel.set_xticklabels(columns, rotation=25, ha="right")
    return plots.png(canvas)


def _usual(found: xr.Dataset) -> str:
    """Return the name of the gains of the file, or of the first ones."""
    gains = names(found.gains)
    return _USUAL if _USUAL in gains else gains[0]
