"""How far designs are from the floor, and what one experiment leaves of the prior box."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from experiments.axes import linear_motor as motor
from experiments.paper.certificates import PLANES, Proof, Worth
from experiments.paper.figures import SYMBOLS
from jaxid.io import plots

_MARKS = {
    "least squares, exact signals": ("x", plots.GREY),
    "guaranteed, with encoder and servo": ("o", plots.BLUE),
    "best estimator, exact signals": ("_", plots.RED),
}


def above_floor(folder: Path, worths: Mapping[str, Worth]) -> None:
    """Errors over the certified floor: one panel per parameter, one column per design."""
    names = motor.system().names
    canvas, panels = plots.figure(1, len(names), (11.0, 4.4))
    for k, (panel, name) in enumerate(zip(panels, names, strict=True)):
        columns = [
            np.array([float(error[k]) for error in kind])
            for kind in (
                [w.evaluation.least_squares for w in worths.values()],
                [w.evaluation.predicted for w in worths.values()],
                [w.errors["minimax"] for w in worths.values()],
            )
        ]
        floor = np.array([float(w.evaluation.lower_bound[k]) for w in worths.values()])
        x = np.arange(len(worths))
        for values, (label, (mark, colour)) in zip(columns, _MARKS.items(), strict=True):
            style = {"markersize": 9, "markeredgewidth": 2, "linestyle": "none"}
            panel.plot(x, values / floor, mark, color=colour, label=label, **style)
        panel.axhline(1.0, color=plots.BLACK, linewidth=1.2)
        panel.set_xticks(x, [d.replace("_", "\n") for d in worths], fontsize=10)
        panel.set_xlim(-0.5, len(worths) - 0.5)
        plots.label(panel, "designed for", "error / floor" if k == 0 else "", SYMBOLS[name])
    handles, labels = panels[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=11)
    plots.save(canvas, folder / "floor.png")


def possible(folder: Path, proof: Proof) -> None:
    """Two parameters at a time: prior box, guaranteed intervals, feasible set, truth."""
    system = motor.system()
    canvas, panels = plots.figure(2, 2, (9.0, 8.0))
    found = proof.guarantee.estimate
    for panel, pair in zip(panels, PLANES, strict=True):
        index = [system.index(name) for name in pair]
        for lower, upper, colour, label in (
            (system.lower, system.upper, plots.GREY, "prior box"),
            (found.lower, found.upper, plots.BLUE, "guaranteed by weights chosen before the data"),
        ):
            (x0, y0), (x1, y1) = ((np.asarray(end)[index]) for end in (lower, upper))
            panel.fill((x0, x1, x1, x0), (y0, y0, y1, y1), color=colour, alpha=0.25, label=label)
        corners = proof.projections[pair]
        panel.fill(
            *corners.T, color=plots.GREEN, alpha=0.6, label="all that the data leave possible"
        )
        truth = np.asarray(motor.TRUE_PARAMETERS)[index]
        panel.plot(*truth, "k+", markersize=12, markeredgewidth=2, label="true value")
        units = [system.units[k] for k in index]
        plots.label(panel, *(f"{SYMBOLS[n]} ({u})" for n, u in zip(pair, units, strict=True)))
    handles, labels = panels[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=11)
    plots.save(canvas, folder / "possible.png")
