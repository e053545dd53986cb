"""What the example axes have in common: their motions as files, one run of each, the tables."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jax import Array

from experiments._support.evaluations import Row
from experiments._support.toys import Toys
from experiments.paper.designs import TOY
from jaxid.io import plots
from jaxid.io.files import read_trajectory, write_table, write_trajectory
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.estimate import Estimate
from jaxid.search.effort import Effort

PROVED = ("parameter", "theta_true", "lower", "upper")  # columns


@dataclass(frozen=True)
class Example(Toys):
    """Options of an example.

    Attributes:
        out: the folder that the table, the figure and the motions are written to.
        seed: of all searches.
        redraw: use the motions in `out` instead of searching.
        toy: search hardly at all: only shows that everything runs.
    """

    out: Path = Path("figures")
    seed: int = 0
    redraw: bool = False
    toy: bool = False

    @property
    def quick(self) -> Effort:
        """Of one short search."""
        return TOY if self.toy else Effort(starts=32, rounds=0, searches=1)

    def motions(
        self, axis: str, searches: Mapping[str, Callable[[], JerkTrajectory]], coordinate: str
    ) -> dict[str, JerkTrajectory]:
        """Those in the files of an axis, which are searched for before unless it is redrawn.

        Args:
            axis: what the names of its files begin with.
            searches: by the names of the motions.
            coordinate: of the axis.
        """
        paths = {name: self.named(f"{axis}_{name}.csv") for name in searches}
        if not self.redraw:
            for name, search in searches.items():
                write_trajectory(paths[name], search(), coordinate)
        return {name: read_trajectory(path, coordinate) for name, path in paths.items()}


def interval_rows(axis: System, truth: Sequence[float], proved: Estimate) -> list[Row]:
    """Of every parameter, beside the truth."""
    ends = zip(truth, proved.lower.tolist(), proved.upper.tolist(), strict=True)
    return [
        {"parameter": name, "theta_true": true, "lower": lower, "upper": upper}
        for name, (true, lower, upper) in zip(axis.names, ends, strict=True)
    ]


def save_table(path: Path, columns: Sequence[str], rows: Sequence[Row]) -> None:
    """Write it and print it."""
    write_table(path, columns, rows)
    print(plots.text_table(columns, [[row[c] for c in columns] for row in rows]), end="\n\n")


def draw_intervals(
    canvas: plots.Figure,
    panel: plots.Axes,
    axis: System,
    found: Mapping[str, Estimate],
    truth: Sequence[float],
) -> None:
    """Intervals beside the prior box and the truth, and one legend below all panels.

    Args:
        canvas: of the panel.
        panel: to draw on.
        axis: whose parameters are drawn: the first ones of every estimate.
        found: by the names of the bars.
        truth: of these parameters, at least.
    """
    m, centre, half = len(axis.names), np.asarray(axis.centre), np.asarray(axis.half_widths)

    def relative(values: Sequence[float] | Array) -> plots.Array:
        return (np.asarray(values)[:m] - centre) / half

    bars = {name: (relative(e.lower), relative(e.upper)) for name, e in found.items()}
    bars = {"prior interval": (-np.ones(m), np.ones(m))} | bars
    plots.intervals(panel, axis.names, bars, relative(truth))
    plots.label(
        panel, "parameter", "share of the prior interval", "Guaranteed intervals of one log"
    )
    legend = panel.get_legend()
    assert legend is not None
    legend.remove()
    handles, labels = panel.get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=11)
