"""Figures of the optimality gaps of designs, and of the guaranteed intervals of one experiment."""

from collections.abc import Mapping
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from experiments.axes import linear_motor as motor
from experiments.paper.certificates import PLANES, Proof, Worth
from experiments.paper.figures import SYMBOLS
from jaxid.io import plots
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory

_MARKS = {
    "least squares, exact signals": ("x", plots.GREY),
    "predicted guaranteed, with encoder and servo": ("o", plots.BLUE),
    "best estimator, exact signals": ("D", plots.RED),
}


def above_floor(folder: Path, worths: Mapping[str, Worth]) -> None:
    """Draw errors relative to the lower bound: one panel per parameter, one column per design."""
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
            style = {"markersize": 8, "markeredgewidth": 1.8, "linestyle": "none"}
            style |= {"markerfacecolor": "none" if mark == "D" else colour}  # both marks visible
            panel.plot(x, values / floor, mark, color=colour, label=label, **style)
        panel.axhline(1.0, color=plots.BLACK, linewidth=1.2)
        designs = [SYMBOLS.get(design, design.replace("_", "\n")) for design in worths]
        panel.set_xticks(x, designs, fontsize=10)
        panel.set_xlim(-0.5, len(worths) - 0.5)
        panel.set_ylim(0.97, 1.8)
        plots.label(
            panel, "motion designed for", "error / lower bound" if k == 0 else "", SYMBOLS[name]
        )
    handles, labels = panels[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=11)
    canvas.suptitle("Errors divided by their lower bound: none can be below 1", fontsize=12)
    plots.save(canvas, folder / "floor.png")


def possible(folder: Path, proof: Proof) -> None:
    """Draw planes of two parameters: prior box, guaranteed intervals, feasible set, true values."""
    system = motor.system()
    canvas, panels = plots.figure(2, 2, (9.0, 8.0))
    found = proof.guarantee.estimate
    for panel, pair in zip(panels, PLANES, strict=True):
        index = [system.index(name) for name in pair]
        for lower, upper, colour, label in (
            (system.lower, system.upper, plots.GREY, "prior box"),
            (found.lower, found.upper, plots.BLUE, "guaranteed by a fixed linear estimator"),
        ):
            (x0, y0), (x1, y1) = ((np.asarray(end)[index]) for end in (lower, upper))
            panel.fill((x0, x1, x1, x0), (y0, y0, y1, y1), color=colour, alpha=0.25, label=label)
        corners = proof.projections[pair]
        panel.fill(*corners.T, color=plots.GREEN, alpha=0.6, label="feasible set of the same log")
        truth = np.asarray(motor.TRUE_PARAMETERS)[index]
        panel.plot(*truth, "k+", markersize=12, markeredgewidth=2, label="true value")
        units = [system.units[k] for k in index]
        plots.label(panel, *(f"{SYMBOLS[n]} ({u})" for n, u in zip(pair, units, strict=True)))
    handles, labels = panels[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=11)
    plots.save(canvas, folder / "possible.png")


def overview(folder: Path, motion: JerkTrajectory, proof: Proof) -> None:
    """Draw the picture of the README: a motion within its limits, and its guaranteed intervals."""
    system, limits = motor.system(), motor.limits()
    canvas = plots.Figure(figsize=(11.0, 4.6), layout="constrained")
    grid = canvas.add_gridspec(2, 2, width_ratios=(1.0, 1.1))
    panels = [canvas.add_subplot(grid[row, 0]) for row in range(2)]
    time = jnp.linspace(0.0, float(motion.duration), 1500)
    states = motion.states(time)
    views = (("position (m)", states.position, limits.position),
             ("velocity (m/s)", states.velocity, limits.velocity))  # fmt: skip
    for panel, (name, values, interval) in zip(panels, views, strict=True):
        panel.plot(time, np.asarray(values), color=plots.BLUE, linewidth=1.8)
        plots.limit_lines(panel, np.asarray(interval).tolist())
        panel.grid(alpha=0.3)
        plots.label(panel, "", name)
    panels[0].set_title("One designed motion, and its limits (dashed)", fontsize=12)
    panels[1].set_xlabel("time (s)", fontsize=12)
    _guaranteed(canvas.add_subplot(grid[:, 1]), system, proof)
    plots.save(canvas, folder / "overview.png")


def _guaranteed(panel: plots.Axes, system: System, proof: Proof) -> None:
    """Draw prior intervals, the paper's intervals and those of one run, relative to the prior."""
    centre, half = np.asarray(system.centre), np.asarray(system.half_widths)
    paper = [motor.PAPER_TABLE_2.get(name, (np.nan, np.nan)) for name in system.names]
    hat, error = (np.array(column) for column in zip(*paper, strict=True))
    ends = {
        "prior": (centre - half, centre + half),
        "paper: θ̂ ± J_f of three experiments": (hat - error, hat + error),
        "guaranteed by one run of 0.6 s": (np.asarray(proof.left.lower), proof.left.upper),
    }

    def share(end: object) -> plots.Array:
        return np.clip((np.asarray(end) - centre) / half, -1.0, 1.0)

    shares = {label: (share(low), share(high)) for label, (low, high) in ends.items()}
    truth = (np.array(motor.TRUE_PARAMETERS) - centre) / half
    plots.intervals(panel, [SYMBOLS[name] for name in system.names], shares, truth)
    panel.legend(fontsize=10, loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=2)
    plots.label(panel, "", "share of the prior interval", "Parameter intervals")
    panel.grid(alpha=0.3)
