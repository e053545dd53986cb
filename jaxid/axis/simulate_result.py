"""The files and the text of a simulation of random axes along a motion."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Array

from jaxid._text import at_most
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import PROGRAM, Axis
from jaxid.axis.result import Result
from jaxid.axis.simulate import DRAWN, SUBSTEPS, Simulated
from jaxid.axis.summaries import SimulatedHalfWidth, SimulatedLimit, SimulationSummary
from jaxid.identification.assumptions import assumptions
from jaxid.io import plots
from jaxid.io.files import UNITS, json_bytes
from jaxid.io.log_file import Columns, log_bytes

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
            (name, one.unit, one.exceeded_by, one.smallest_margin)
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
                "evidence, not a proof.",
                *self._verdict(),
                plots.text_table(
                    ("limit", "unit", "plants that exceed it", "smallest margin"), margins
                ),
                plots.text_table(("parameter", "unit", "median", "largest"), lengths, title),
                "These intervals hold provided that:",
                *(f"  {sentence}" for sentence in said.assumptions),
            )
        )

    def _verdict(self) -> Iterator[str]:
        """Yield a sentence for each limit that is exceeded, or one that all are kept."""
        said = self.summary()
        exceeded = {name: one for name, one in said.limits.items() if one.exceeded_by}
        if not exceeded:
            yield "All plants kept all limits."
        for name, one in exceeded.items():
            if one.smallest_margin is None:
                by = "the loop of at least one of them diverged"
            else:
                most = at_most(-one.smallest_margin)
                by = f"by up to {most} {one.unit}: design for limits that are narrower by this"
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
    """Return a picture of tracking error, velocity and input of some simulated axes, as PNG."""
    axis, drawn = found.axis, found.drawn
    unit, limits = UNITS[axis.system.coordinate], axis.task.limits
    canvas, panels = plots.figure(1, 3, (12.0, 4.2))
    instants = np.asarray(drawn.time[0])
    error = drawn.position - found.played.states(drawn.time[0]).position[None]
    ticks_at = instants[:-1:SUBSTEPS]
    views: tuple[tuple[str, np.ndarray, Array, Array | None], ...] = (
        (f"position less the motion's ({unit})", instants, error, None),
        (f"velocity ({unit}/s)", instants, drawn.velocity, limits.velocity),
        (f"input ({axis.system.input_unit})", ticks_at, drawn.input, limits.input),
    )
    for panel, (name, time, values, interval) in zip(panels, views, strict=True):
        panel.plot(time, np.asarray(values[:DRAWN]).T, linewidth=0.7, alpha=0.7)
        if interval is not None:
            plots.limit_lines(panel, interval.tolist())
        plots.label(panel, "time (s)", name)
    return plots.png(canvas)
