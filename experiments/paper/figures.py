"""Figures 1 to 10 of the study, drawn from computed arrays."""

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
    """Draw figures 1 to 3: the optimal desired motions."""
    limits = np.asarray(motor.limits().motion)
    for number, (cell, trajectory) in enumerate(trajectories.items(), start=1):
        canvas, panels = plots.figure(3, 1, (7.0, 7.5))
        seconds = motor.seconds(cell.horizon)
        title = (
            f"Optimal motion of {seconds:g} s for {SYMBOLS[cell.target]}, and its limits (dashed)"
        )
        plots.motion(panels, trajectory, limits, title)
        plots.save(canvas, folder / f"fig{number}.png")


def tracking(folder: Path, loops: Mapping[Cell, ClosedLoopRun]) -> None:
    """Draw figures 4 to 6: control input and tracking error."""
    for number, (cell, loop) in enumerate(loops.items(), start=4):
        signals = loop.signals
        canvas, (above, below) = plots.figure(2, 1, (7.0, 6.0))
        time = np.asarray(signals.time[:-1])
        title = f"ARC follows the motion for {SYMBOLS[cell.target]} (0.5 µm encoder, limits dashed)"
        plots.series(above, time, np.asarray(signals.input), "control input (V)", title=title)
        plots.limit_lines(above, (-10.0, 10.0))
        error = 1e6 * np.asarray(signals.position[:-1] - signals.reference.position)
        plots.series(below, time, error, "tracking error (µm)", plots.RED)
        plots.save(canvas, folder / f"fig{number}.png")


def open_loop(folder: Path, runs: Mapping[float, OpenLoopRun]) -> None:
    """Draw figures 7 and 8: pulses and the resulting position."""
    for number, amplitude in enumerate(motor.OPEN_LOOP_AMPLITUDES, start=7):
        signals = runs[amplitude].signals
        canvas, (above, below) = plots.figure(2, 1, (7.0, 6.0))
        time = np.asarray(signals.time)
        title = f"Open loop, pulses of {amplitude} V (position limits dashed)"
        plots.series(above, time[:-1], np.asarray(signals.input), "input (V)", title=title)
        plots.series(below, time, np.asarray(signals.position), "position (m)", plots.RED)
        plots.limit_lines(below, np.asarray(motor.limits().position).tolist())
        plots.save(canvas, folder / f"fig{number}.png")


def bandwidth(folder: Path, sweeps: Mapping[Cell, Sweep], errors: Mapping[Cell, Errors]) -> None:
    """Draw figure 9: J_f / J* over the bandwidth, and the two error terms of (30)."""
    canvas, panels = plots.figure(2, 2, (9.0, 7.0))
    w = np.asarray(BANDWIDTHS)
    for panel, (cell, sweep) in zip(panels, sweeps.items(), strict=False):
        index = motor.system().index(cell.target)
        star = errors[cell][index]
        panel.semilogx(w, np.asarray(sweep.exact)[:, index] / star, "o-", color=plots.BLUE)
        panel.semilogx(w, np.asarray(sweep.measured)[:, index] / star, "s--", color=plots.RED)
        panel.axhline(1.0, color=plots.GREY, linewidth=1.2)
        title = f"Motion of {motor.seconds(cell.horizon):g} s for {SYMBOLS[cell.target]}"
        plots.label(panel, "filter bandwidth w (rad/s)", r"$J_f / J_*$", title)
        named = ("exact signals", "0.5 µm encoder (no guarantee)", r"$J_*$, without filter")
        panel.legend(named, fontsize=10)
    first = next(iter(sweeps.values()))
    terms = panels[3]
    terms.loglog(w, np.asarray(first.noise), "o-", color=plots.BLUE)
    terms.loglog(w, np.asarray(first.measured_noise), "s--", color=plots.RED)
    terms.loglog(w, np.asarray(first.lag), "^:", color=plots.GREEN)
    title = f"Errors of the filtered acceleration, motion for {next(iter(sweeps)).target}"
    plots.label(terms, "filter bandwidth w (rad/s)", "rms (m/s²)", title)
    names = ("tracking error, exact signals", "tracking error, 0.5 µm encoder", "lag of the filter")
    terms.set_ylim(top=3e3)  # space for the legend above the lines
    terms.legend(names, fontsize=10, loc="upper center")
    plots.save(canvas, folder / "fig9.png")


def amplitudes(folder: Path, runs: Mapping[float, OpenLoopRun]) -> None:
    """Draw figure 10: error bounds and travel over the amplitude of open-loop pulses."""
    canvas, (above, below) = plots.figure(2, 1, (7.0, 7.0))
    x = np.array(sorted(runs))
    half = np.asarray(motor.system().half_widths)
    styles = ("o-", "s--", "^:", "d-.")
    for index, name in enumerate(motor.system().names):
        bounds = np.array([float(runs[a].estimate.bound[index]) for a in x]) / half[index]
        above.semilogy(x, bounds, styles[index], color=plots.CYCLE[index], label=SYMBOLS[name])
    above.axhline(1.0, color=plots.GREY, linestyle="--")
    title = "Open loop: no pulse within the stroke narrows B or $F_c$"
    plots.label(above, "", "error bound / prior half-width", title)
    above.legend(fontsize=11)
    travel = np.array([_travel(runs[a]) for a in x])
    below.fill_between(x, travel[:, 0], travel[:, 1], color=plots.SKY, alpha=0.6)
    plots.limit_lines(below, np.asarray(motor.limits().position).tolist())
    below.set_ylim(-0.3, 1.2)
    start = Pulses().start
    below.axhline(start, color=plots.BLACK, linewidth=1.0, label=f"start at {start:g} m")
    below.plot([], [], "--", color=plots.GREY, label="position limits")
    below.legend(fontsize=10, loc="upper left")
    plots.label(below, "pulse amplitude (V)", "positions within 4 s (m)")
    plots.save(canvas, folder / "fig10.png")


def tube(
    path: Path, planned: States, proved: Envelope, simulated: Envelope, limits: Limits, name: str
) -> None:
    """Draw proved and simulated ranges of the axis around its motion, and the limits.

    Args:
        path: file of the picture.
        planned: motion at the samples of the envelopes.
        proved: proved range over all plants.
        simulated: range over the simulated plants.
        limits: limits of the axis.
        name: parameter that the motion is designed for.
    """
    canvas, panels = plots.figure(3, 1, (7.5, 8.5))
    time = motor.CONTROL_PERIOD * np.arange(1, planned.position.size + 1)
    none = np.zeros(planned.position.size)
    sides = (
        ("position", "position error (mm)", 1e3, np.asarray(planned.position)),
        ("velocity", "velocity error (m/s)", 1.0, np.asarray(planned.velocity)),
        ("input", "input (V)", 1.0, none),
    )
    for panel, (side, text, unit, middle) in zip(panels, sides, strict=True):
        for envelope, colour in ((proved, plots.SKY), (simulated, plots.BLUE)):
            lower, upper = (unit * (np.asarray(x) - middle) for x in getattr(envelope, side))
            panel.fill_between(time, lower, upper, color=colour, linewidth=0.0)
        height = panel.get_ylim()
        for end in getattr(limits, side):
            panel.plot(time, unit * (float(end) - middle), "--", color=plots.RED, linewidth=1.5)
        panel.axhline(0.0, color=plots.BLACK, linewidth=0.8)
        panel.set_ylim(1.15 * min(height), 1.15 * max(height))
        plots.label(panel, "", text)
    title = f"Motion for {SYMBOLS[name]}: every plant of the prior box stays within the limits"
    panels[0].set_title(title, fontsize=12)
    panels[0].set_ylim(top=1.4 * panels[0].get_ylim()[1])  # space for the legend
    names = ("proved for every plant", "simulated corners of the box")
    panels[0].legend(names, fontsize=10, loc="upper center", ncols=2)
    limit = panels[-1].lines[0]
    panels[-1].legend([limit], ["limit"], fontsize=10, loc="upper center")
    panels[-1].set_xlabel("time (s)", fontsize=12)
    plots.save(canvas, path)


def _travel(run: OpenLoopRun) -> tuple[float, float]:
    return float(run.signals.position.min()), float(run.signals.position.max())
