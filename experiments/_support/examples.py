"""Shared code of the example axes: motions as files, tables, and pictures of intervals."""

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
from jaxid.io.text_tables import text_table
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.estimate import Estimate
from jaxid.search.effort import Effort

PROVED = ("parameter", "theta_true", "lower", "upper")  # columns


@dataclass(frozen=True)
class Example(Toys):
    """Options of an example.

    Attributes:
        out: folder for the table, the figure and the motions.
        seed: seed of all searches.
        redraw: use the motions in `out` instead of searching.
        toy: run with minimal effort, only to show that everything works.
    """

    out: Path = Path("figures")
    seed: int = 0
    redraw: bool = False
    toy: bool = False

    @property
    def quick(self) -> Effort:
        """The effort of one short search."""
        return TOY if self.toy else Effort(starts=32, rounds=0, searches=1)

    def motions(
        self, axis: str, searches: Mapping[str, Callable[[], JerkTrajectory]], coordinate: str
    ) -> dict[str, JerkTrajectory]:
        """Return the motions in the files of an axis; search them first unless `redraw` is set.

        Args:
            axis: prefix of the file names.
            searches: function that searches a motion, by the name of the motion.
            coordinate: coordinate of the axis, linear or rotary.
        """
        paths = {name: self.named(f"{axis}_{name}.csv") for name in searches}
        if not self.redraw:
            for name, search in searches.items():
                write_trajectory(paths[name], search(), coordinate)
        return {name: read_trajectory(path, coordinate) for name, path in paths.items()}


def interval_rows(axis: System, truth: Sequence[float], proved: Estimate) -> list[Row]:
    """Return one table row per parameter: its guaranteed interval and its true value."""
    ends = zip(truth, proved.lower.tolist(), proved.upper.tolist(), strict=True)
    return [
        {"parameter": name, "theta_true": true, "lower": lower, "upper": upper}
        for name, (true, lower, upper) in zip(axis.names, ends, strict=True)
    ]


def save_table(path: Path, columns: Sequence[str], rows: Sequence[Row]) -> None:
    """Write a table to a file, and print it."""
    write_table(path, columns, rows)
    print(text_table(columns, [[row[c] for c in columns] for row in rows]), end="\n\n")


def draw_intervals(
    canvas: plots.Figure,
    panel: plots.Axes,
    axis: System,
    found: Mapping[str, Estimate],
    truth: Sequence[float],
) -> None:
    """Draw guaranteed intervals, the prior box, the true parameters and a legend of all panels.

    Args:
        canvas: figure that contains the panel.
        panel: panel to draw on.
        axis: system whose parameters are drawn; they come first in every estimate.
        found: estimates, by the labels of their bars.
        truth: true values of these parameters, possibly followed by others.
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
