"""Figures 1 to 10, drawn from arrays that were computed before."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from experiments.axes import linear_motor as motor
from experiments.paper.designs import Cell
from experiments.paper.runs import BANDWIDTHS, ClosedLoopRun, OpenLoopRun, Pulses, Sweep
from experiments.paper.tables import Errors
from jaxid.io import plots
from jaxid.motion.limits import Limits
from jaxid.motion.trajectory import JerkTrajectory, States
from jaxid.motion.violation import Envelope

Trajectories = Mapping[Cell, JerkTrajectory]
SYMBOLS = {"M": "M", "B": "B", "Fc": "$F_c$", "dbar": r"$\bar d$"}


def desired(folder: Path, trajectories: Trajectories) -> None:
    """Figures 1 to 3: the optimal desired motions."""
    limits = np.asarray(motor.limits().motion)
    for number, (cell, trajectory) in enumerate(trajectories.items(), start=1):
        canvas, panels = plots.figure(3, 1, (7.0, 7.5))
        title = (
            f"Desired trajectory for the estimation of {SYMBOLS[cell.target]}, N = {cell.horizon}"
        )
        plots.motion(panels, trajectory, limits, title)
        plots.save(canvas, folder / f"fig{number}.png")


def tracking(folder: Path, loops: Mapping[Cell, ClosedLoopRun]) -> None:
    """Figures 4 to 6: control input and tracking error."""
    for number, (cell, loop) in enumerate(loops.items(), start=4):
        signals = loop.signals
        canvas, (above, below) = plots.figure(2, 1, (7.0, 6.0))
        time = np.asarray(signals.time[:-1])
        title = f"ARC on the motion for {SYMBOLS[cell.target]}, 0.5 µm encoder"
        plots.series(above, time, np.asarray(signals.input), "control input (V)", title=title)
        plots.limit_lines(above, (-10.0, 10.0))
        error = 1e6 * np.asarray(signals.position[:-1] - signals.reference.position)
        plots.series(below, time, error, "tracking error (µm)", plots.RED)
        plots.save(canvas, folder / f"fig{number}.png")


def open_loop(folder: Path, runs: Mapping[float, OpenLoopRun]) -> None:
    """Figures 7 and 8: pulses and the position that they lead to."""
    for number, amplitude in enumerate(motor.OPEN_LOOP_AMPLITUDES, start=7):
        signals = runs[amplitude].signals
        canvas, (above, below) = plots.figure(2, 1, (7.0, 6.0))
        time = np.asarray(signals.time)
        title = f"Open-loop identification with {amplitude} V pulses"
        plots.series(above, time[:-1], np.asarray(signals.input), "input (V)", title=title)
        plots.series(below, time, np.asarray(signals.position), "position (m)", plots.RED)
        plots.limit_lines(below, np.asarray(motor.limits().position).tolist())
        plots.save(canvas, folder / f"fig{number}.png")


def bandwidth(folder: Path, sweeps: Mapping[Cell, Sweep], errors: Mapping[Cell, Errors]) -> None:
    """Figure 9: J_f over the bandwidth beside J*, and the two terms of (30)."""
    canvas, panels = plots.figure(2, 2, (9.0, 7.0))
    w = np.asarray(BANDWIDTHS)
    for panel, (cell, sweep) in zip(panels, sweeps.items(), strict=False):
        index = motor.system().index(cell.target)
        star = errors[cell][index]
        panel.semilogx(w, np.asarray(sweep.exact)[:, index] / star, "o-", color=plots.BLUE)
        panel.semilogx(w, np.asarray(sweep.measured)[:, index] / star, "s--", color=plots.RED)
        panel.axhline(1.0, color=plots.GREY, linewidth=1.2)
        plots.label(
            panel, "w (rad/s)", r"$J_f / J_*$", f"{SYMBOLS[cell.target]}, N = {cell.horizon}"
        )
        panel.legend(("exact signals", "0.5 µm, differenced", r"$J_*$"), fontsize=10)
    first = next(iter(sweeps.values()))
    terms = panels[3]
    terms.loglog(w, np.asarray(first.noise), "o-", color=plots.BLUE)
    terms.loglog(w, np.asarray(first.measured_noise), "s--", color=plots.RED)
    terms.loglog(w, np.asarray(first.lag), "^:", color=plots.GREEN)
    plots.label(
        terms, "w (rad/s)", "rms (m/s²)", f"Terms of (30), motion for {next(iter(sweeps)).target}"
    )
    names = ("first: error, exact", "first: error, measured", "second: lag of the filter")
    terms.set_ylim(top=3e3)  # room for the legend above the lines
    terms.legend(names, fontsize=10, loc="upper center")
    plots.save(canvas, folder / "fig9.png")


def amplitudes(folder: Path, runs: Mapping[float, OpenLoopRun]) -> None:
    """Figure 10: what larger open-loop pulses gain, and where the stroke ends."""
    canvas, (above, below) = plots.figure(2, 1, (7.0, 7.0))
    x = np.array(sorted(runs))
    half = np.asarray(motor.system().half_widths)
    styles = ("o-", "s--", "^:", "d-.")
    for index, name in enumerate(motor.system().names):
        bounds = np.array([float(runs[a].estimate.bound[index]) for a in x]) / half[index]
        above.semilogy(x, bounds, styles[index], color=plots.CYCLE[index], label=SYMBOLS[name])
    above.axhline(1.0, color=plots.GREY, linestyle="--")
    plots.label(above, "", "bound / half of the prior box", "Open loop: larger pulses …")
    above.legend(fontsize=11)
    travel = np.array([_travel(runs[a]) for a in x])
    below.fill_between(x, travel[:, 0], travel[:, 1], color=plots.SKY, alpha=0.6)
    plots.limit_lines(below, np.asarray(motor.limits().position).tolist())
    below.set_ylim(-0.3, 1.2)
    start = Pulses().start
    below.axhline(start, color=plots.BLACK, linewidth=1.0)
    plots.label(below, "pulse amplitude (V)", "travel within 4 s (m)", "… and the travel they use")
    plots.save(canvas, folder / "fig10.png")


def tube(
    path: Path, planned: States, proved: Envelope, seen: Envelope, limits: Limits, name: str
) -> None:
    """What the axis may do beside its motion, proved and seen, and the room that it has.

    Args:
        path: of the picture.
        planned: the motion at the ticks of the envelopes.
        proved: of all plants.
        seen: of those that were tried.
        limits: of the axis.
        name: of the parameter that the motion is for.
    """
    canvas, panels = plots.figure(3, 1, (7.5, 8.5))
    time = motor.CONTROL_PERIOD * np.arange(1, planned.position.size + 1)
    none = np.zeros(planned.position.size)
    sides = (
        ("position", "position: axis - motion (mm)", 1e3, np.asarray(planned.position)),
        ("velocity", "speed: axis - motion (m/s)", 1.0, np.asarray(planned.velocity)),
        ("input", "input (V)", 1.0, none),
    )
    for panel, (side, text, unit, middle) in zip(panels, sides, strict=True):
        for envelope, colour in ((proved, plots.SKY), (seen, plots.BLUE)):
            lower, upper = (unit * (np.asarray(x) - middle) for x in getattr(envelope, side))
            panel.fill_between(time, lower, upper, color=colour, linewidth=0.0)
        height = panel.get_ylim()
        for end in getattr(limits, side):
            panel.plot(time, unit * (float(end) - middle), "--", color=plots.RED, linewidth=1.5)
        panel.set_ylim(1.15 * min(height), 1.15 * max(height))
        plots.label(panel, "", text)
    panels[0].set_title(f"Motion for {SYMBOLS[name]} with a proved tube", fontsize=12)
    panels[0].set_ylim(top=1.4 * panels[0].get_ylim()[1])  # room for the legend
    names = ("proved, every plant", "seen", "limit")
    panels[0].legend(names, fontsize=10, loc="upper center", ncols=3)
    panels[-1].set_xlabel("time of the motion (s)", fontsize=12)
    plots.save(canvas, path)


def _travel(run: OpenLoopRun) -> tuple[float, float]:
    return float(run.signals.position.min()), float(run.signals.position.max())
