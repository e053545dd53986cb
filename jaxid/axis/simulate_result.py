"""The files and the text of a simulation of random axes along a motion."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float

from jaxid._text import at_least, at_most
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import PROGRAM, Axis
from jaxid.axis.result import Result
from jaxid.axis.simulate import DRAWN, SUBSTEPS, Simulated
from jaxid.axis.summaries import SimulatedHalfWidth, SimulatedLimit, SimulationSummary
from jaxid.identification.assumptions import assumptions
from jaxid.io import plots
from jaxid.io.csv_log import log_bytes
from jaxid.io.files import UNITS, json_bytes
from jaxid.io.recorded import Columns
from jaxid.io.text_tables import text_table

_DEFAULT = Columns("position", "input", "time")  # of a log, if the axis file names none


@dataclass(frozen=True, eq=False)
class SimulateResult(Result):
    """The result of `jaxid simulate`: random axes along a designed motion.

    Attributes:
        found: simulated axes.
        design: digest of the design in the same folder, whose motion they tracked.
    """

    found: Simulated
    design: str
    name: ClassVar[str] = "simulate"
    names: ClassVar[tuple[str, ...]] = ("simulation.json", "simulation.png", "simulated_log.csv")

    @property
    def axis(self) -> Axis:
        """The axis that was simulated."""
        return self.found.axis

    @property
    def results(self) -> dict[str, str]:
        """The digest of the design whose motion was simulated, by its place."""
        return {DesignResult.name: self.design}

    def summary(self) -> SimulationSummary:
        """Return the content of `simulation.json`."""
        found = self.found
        system = found.axis.system
        lengths = np.median(found.half_widths, axis=0), np.max(found.half_widths, axis=0)
        return SimulationSummary(
            program=PROGRAM,
            axis_sha256=found.axis.digest,
            seed=found.seed,
            plants=found.plants,
            limits=_limits(found),
            logs=len(found.half_widths),
            logs_missing_the_truth=found.outside,
            half_widths={
                name: SimulatedHalfWidth(unit=unit, median=float(median), largest=float(most))
                for name, unit, median, most in zip(
                    system.names, system.units, *lengths, strict=True
                )
            },
            log_theta=dict(zip(system.names, found.theta.tolist(), strict=True)),
            assumptions=assumptions(system, found.log, delay=found.axis.servo.delay),
        )

    def files(self) -> Mapping[str, bytes]:
        """Return the content of the JSON file, the picture, and one of the logs, by name."""
        axis = self.found.axis
        columns = _DEFAULT if axis.columns is None else axis.columns
        log = log_bytes(self.found.log, columns, axis.servo.delay)
        contents = json_bytes(self.summary()), page(self.found), log
        return dict(zip(self.names, contents, strict=True))

    def text(self) -> str:
        """Return the result as text: violated limits, half-widths of intervals, and assumptions."""
        said = self.summary()
        margins = [
            (
                name,
                one.unit,
                one.exceeded_by,
                None if one.smallest_margin is None else at_least(one.smallest_margin),
            )
            for name, one in said.limits.items()
        ]
        lengths = [
            (name, x.unit, x.median, None if x.largest is None else at_most(x.largest, 4))
            for name, x in said.half_widths.items()
        ]
        title = (
            f"Half-widths of the intervals from {said.logs} simulated logs; "
            f"{said.logs_missing_the_truth} of {said.logs} logs had a true parameter outside its "
            "interval."
        )
        return "\n".join(
            (
                f"Monte Carlo check on {said.plants} simulated plants (seed {said.seed}): "
                "evidence, not a proof. Δ is zero, random or against the tracking in turn.",
                *_verdict(said),
                text_table(("limit", "unit", "plants that exceed it", "smallest margin"), margins),
                text_table(("parameter", "unit", "median", "largest"), lengths, title),
                "These intervals hold provided that:",
                *(f"  {sentence}" for sentence in said.assumptions),
            )
        )


def _verdict(said: SimulationSummary) -> Iterator[str]:
    """Yield a sentence for each limit that is exceeded, or one that all are kept."""
    exceeded = {name: one for name, one in said.limits.items() if one.exceeded_by}
    if not exceeded:
        yield "All plants kept all limits."
    for name, one in exceeded.items():
        if one.smallest_margin is None:
            by = "the loop of at least one of them diverged"
        else:
            most = at_most(-one.smallest_margin)
            by = f"by up to {most} {one.unit}: narrow it, and design again (jaxid guide safety)"
        number = f"{one.exceeded_by} of {said.plants} plants"
        yield f"`limits.{name}` was exceeded by {number}, {by}."


def _limits(found: Simulated) -> dict[str, SimulatedLimit]:
    """Return the violations of each limit, in its unit."""
    system, limits = found.axis.system, found.axis.task.limits
    length = UNITS[system.coordinate]
    units = {"position": length, "velocity": f"{length}/s", "input": system.input_unit}
    violations = {}
    for name, worst in found.excess.items():
        low, high = np.asarray(getattr(limits, name)).tolist()
        most = float(np.max(worst)) * (high - low) / 2
        violations[name] = SimulatedLimit(
            unit=units.get(name, f"{system.input_unit}/s"),
            exceeded_by=int(np.sum(~(worst <= 0))),
            smallest_margin=-most if np.isfinite(most) else None,
        )
    return violations


def page(found: Simulated) -> bytes:
    """Return a picture of tracking error and margins to the limits of some plants, as PNG."""
    axis, drawn = found.axis, found.drawn
    unit, limits = UNITS[axis.system.coordinate], axis.task.limits
    canvas, panels = plots.figure(2, 2, (11.0, 7.0))
    instants = np.asarray(drawn.time[0])
    error = np.asarray(drawn.position - found.played.states(drawn.time[0]).position[None])
    exceeded = np.max(np.stack(list(found.excess.values())), axis=0)[: len(error)] > 0
    _draw(panels[0], instants, error, exceeded)
    plots.engineering(panels[0], unit)
    plots.label(panels[0], "", "tracking error", "Position − designed position")
    ticks_at = instants[:-1:SUBSTEPS]
    views = (
        ("position", instants, drawn.position, limits.position, unit),
        ("velocity", instants, drawn.velocity, limits.velocity, f"{unit}/s"),
        ("input", ticks_at, drawn.input, limits.input, axis.system.input_unit),
    )
    for panel, (name, time, values, interval, of) in zip(panels[1:], views, strict=True):
        low, high = np.asarray(interval).tolist()
        margin = np.minimum(high - np.asarray(values), np.asarray(values) - low)
        _draw(panel, time, margin, exceeded)
        count = int(np.sum(~(found.excess[name] <= 0)))
        kept = f"exceeded by {count} of {found.plants}" if count else "kept by all"
        plots.label(panel, "", f"margin ({of})", f"Margin of the {name}: {kept}")
        worst = float(np.min(margin[:DRAWN]))
        panel.axhline(0.0, color=plots.BLACK, linewidth=1.2)
        if worst < 0:  # so that a small violation is visible
            panel.set_ylim(1.5 * worst, max(-8 * worst, 0.02 * (high - low) / 2))
            panel.axhspan(1.5 * worst, 0.0, color=plots.RED, alpha=0.12, linewidth=0)
    for panel in panels[2:]:
        panel.set_xlabel("time (s)", fontsize=12)
    shown = min(DRAWN, error.shape[0])
    canvas.suptitle(
        f"The first {shown} of {found.plants} simulated plants; orange-red: those that exceed a "
        "limit",
        fontsize=12,
    )
    return plots.png(canvas)


def _draw(
    panel: plots.Axes,
    time: Float[np.ndarray, " n"],
    values: Float[np.ndarray, "k n"],
    exceeded: Bool[np.ndarray, " k"],
) -> None:
    for one, beyond in list(zip(values, exceeded, strict=False))[:DRAWN]:
        panel.plot(time, one, color=plots.RED if beyond else plots.BLUE, linewidth=0.6, alpha=0.5)
