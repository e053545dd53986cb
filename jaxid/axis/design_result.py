"""The files and the text of a designed motion: set-points, JSON, picture, table."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid._text import at_least
from jaxid._types import dot
from jaxid.axis.defaults import ALL
from jaxid.axis.design import FACTORS, WANTED, AxisDesign, lead_in, played
from jaxid.axis.file import PROGRAM, Axis
from jaxid.axis.result import Result
from jaxid.axis.summaries import DesignedParameter, DesignSummary
from jaxid.design.evaluation import ParameterEvaluation
from jaxid.design.nominal_log import nominal_log
from jaxid.identification.assumptions import assumptions
from jaxid.io import plots
from jaxid.io.files import UNITS, json_bytes, trajectory_bytes
from jaxid.io.setpoints import margins, sampled, setpoint_bytes, setpoints_in
from jaxid.io.text_tables import text_table
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory

_SETPOINTS = tuple(Path(name) for name in ("setpoints.csv", "setpoints.mat", "setpoints.h"))
_TITLES = {ALL: "all parameters", WANTED: "the required accuracies"}
_ROUNDED = 1e-6  # half-widths: tolerance for differences of rounded positions
_NOTHING = 1e-3  # relative: an interval that shrinks by less counts as not narrowed
TITLE = "Predicted guaranteed half-widths, for an undisturbed axis at the centre of the prior box"
HEADINGS = ("least squares ±", "predicted ±", "lower bound ±", "optimality gap")


@dataclass(frozen=True, eq=False)
class DesignResult(Result):
    """The result of `jaxid design` for one motion, as files and as text.

    Attributes:
        found: design.
    """

    found: AxisDesign
    name: ClassVar[str] = "design"
    names: ClassVar[tuple[str, ...]] = (
        "trajectory.csv", *map(str, _SETPOINTS), "design.json", "design.png",
    )  # fmt: skip

    @property
    def axis(self) -> Axis:
        """The axis that the motion was designed for."""
        return self.found.axis

    @cached_property
    def setpoints(self) -> Mapping[Path, bytes]:
        """The content of the set-point files (CSV, MAT, C header), by path."""
        axis = self.found.axis
        points = sampled(played(axis, self.found.motion), axis.servo.period)
        return {path: setpoint_bytes(path, points, axis.system.coordinate) for path in _SETPOINTS}

    @cached_property
    def margins(self) -> Mapping[str, float]:
        """The smallest margin of the exported positions to each limit, in half-widths of the limit.

        The positions are read back from the exported CSV file.

        Raises:
            ValueError: if a margin is below −1e-6.
        """
        axis, path = self.found.axis, _SETPOINTS[0]
        read = setpoints_in(self.setpoints[path], path, axis.system.coordinate)
        left = margins(read, axis.task.limits)
        require(
            min(left.values()) >= -_ROUNDED,
            f"The exported positions exceed the limits: {left}, relative to half their range.",
        )
        return left

    def summary(self) -> DesignSummary:
        """Return the content of `design.json`."""
        found = self.found
        axis, system, motion = found.axis, found.axis.system, found.motion
        begins = float(lead_in(axis, motion.start).duration)
        log = nominal_log(system, motion, axis.servo)
        return DesignSummary(
            program=PROGRAM,
            axis_sha256=axis.digest,
            target=found.target,
            search=found.search,
            begins_s=begins,
            ends_s=begins + float(motion.duration),
            parameters={name: _parameter(found, k) for k, name in enumerate(system.names)},
            margins=dict(self.margins),
            assumptions=assumptions(system, log, delay=axis.servo.delay),
        )

    def files(self) -> Mapping[str, bytes]:
        """Return the content of the trajectory, set-point, JSON and PNG files, by name."""
        found = self.found
        return {
            "trajectory.csv": trajectory_bytes(found.motion, found.axis.system.coordinate),
            **{str(path): data for path, data in self.setpoints.items()},
            "design.json": json_bytes(self.summary()),
            "design.png": page(found),
        }

    def text(self) -> str:
        """Return the result as text: predicted errors of each parameter, margins to the limits."""
        found = self.found
        system, worth, wanted = found.axis.system, found.worth, found.axis.wanted.tolist()
        header = ["parameter", "unit", *HEADINGS, "with 2·δ ±"]
        cells = list(zip(*map(evaluation_cells, worth.by_parameter), strict=True))
        twice = found.sensitivity[FACTORS.index(2.0)].tolist()
        columns: list[Sequence[object]] = [*cells, twice]
        if np.any(np.isfinite(wanted)):
            header.append("wanted ±")
            columns.append([None if np.isinf(x) else x for x in wanted])
        rows = list(zip(system.names, system.units, *columns, strict=True))
        # rounding of the exported positions is no violation
        margins = ", ".join(f"{name} {max(x, 0.0):.2%}" for name, x in self.margins.items())
        low, high = found.axis.task.limits.acceleration.tolist()
        return "\n".join(
            (
                text_table(header, rows, TITLE),
                *_unidentified(found),
                *_impossible(found),
                f"Acceleration limit: [{low:.4g}, {high:.4g}] {UNITS[system.coordinate]}/s²",
                f"Margin to the limits, relative to half their range: {margins}",
            )
        )


def evaluation_cells(one: ParameterEvaluation) -> tuple[object, ...]:
    """Return the evaluation of one parameter as cells of a table with the columns `HEADINGS`."""
    return one.least_squares, one.predicted, at_least(one.lower_bound, 4), f"{one.gap:.1%}"


def _unidentified(found: AxisDesign) -> Iterator[str]:
    """Yield a sentence for each parameter whose prior interval this motion would not narrow."""
    box, predicted = np.asarray(found.axis.system.half_widths), np.asarray(found.worth.predicted)
    if np.all(predicted >= (1 - _NOTHING) * box):
        servo, unit = found.axis.servo, UNITS[found.axis.system.coordinate]
        yield (
            "No parameter is predicted to be identified. Check `servo.resolution` = "
            f"{servo.resolution:g} {unit}, `servo.period` = {servo.period:g} s and [disturbance]."
        )
        return
    for k, name in enumerate(found.axis.system.names):
        if predicted[k] >= (1 - _NOTHING) * box[k]:
            yield (
                f"{name}: predicted to stay unidentified, since the log of this motion would not "
                f"narrow its prior interval (± {box[k]:.4g} {found.axis.system.units[k]})."
            )


def _impossible(found: AxisDesign) -> Iterator[str]:
    """Yield a sentence for each required accuracy that no motion within the limits can promise."""
    least, wanted = found.worth.lower_bound.tolist(), found.axis.wanted.tolist()
    for name, low, want in zip(found.axis.system.names, least, wanted, strict=True):
        if want < low:
            yield (
                f"`wanted.{name}` = {want:g} is below the lower bound {at_least(low, 4)}: no "
                "motion within the limits can promise it (jaxid guide design)."
            )


def _parameter(found: AxisDesign, k: int) -> DesignedParameter:
    system, wanted = found.axis.system, float(found.axis.wanted[k])
    return DesignedParameter(
        unit=system.units[k],
        prior=(float(system.lower[k]), float(system.upper[k])),
        **found.worth.by_parameter[k]._asdict(),
        predicted_with_delta_times={
            f"{factor:g}": float(row[k])
            for factor, row in zip(FACTORS, found.sensitivity, strict=True)
        },
        wanted=msgspec.UNSET if np.isinf(wanted) else wanted,
    )


def page(found: AxisDesign) -> bytes:
    """Return a picture of the motion with its limits, and of its predicted errors, as PNG."""
    axis = found.axis
    canvas, panels = plots.figure(2, 3, (14.0, 7.4))
    limits, whole = axis.task.limits, played(axis, found.motion)
    plots.motion(panels[:3], whole, np.asarray(limits.motion), "Position", axis.system.coordinate)
    panels[1].set_title("Velocity", fontsize=12)
    panels[2].set_title("Acceleration", fontsize=12)
    before = float(whole.duration - found.motion.duration)
    _draw_input(panels[3], axis, whole)
    _draw_jerk(panels[4], axis, whole)
    for panel in panels[: 5 if before else 0]:
        panel.axvspan(0.0, before, color=plots.GREY, alpha=0.2, linewidth=0)
    _draw_errors(panels[5], found)
    approach = "; grey: approach" if before else ""
    title = f"Motion for {_TITLES.get(found.target, found.target)}; dashed: limits{approach}"
    canvas.suptitle(title, fontsize=13)
    return plots.png(canvas)


def _draw_input(panel: plots.Axes, axis: Axis, whole: JerkTrajectory) -> None:
    """Draw the input at the centre of the prior box, and its range over the box and all |Δ| ≤ δ."""
    system, time = axis.system, np.linspace(0.0, np.sum(np.asarray(whole.durations)), 2000)
    nominal, reach = map(np.asarray, _needed(system, whole, jnp.asarray(time)))
    panel.fill_between(
        time, nominal - reach, nominal + reach, color=plots.SKY, alpha=0.4, linewidth=0,
        label="all of the prior box and δ",
    )  # fmt: skip
    panel.plot(time, nominal, color=plots.BLUE, linewidth=1.5, label="centre of the prior box")
    plots.limit_lines(panel, np.asarray(axis.task.limits.input).tolist())
    panel.legend(fontsize=9)
    plots.label(panel, "time (s)", f"input ({system.input_unit})", "Input that the motion needs")


@eqx.filter_jit
def _needed(
    system: System, whole: JerkTrajectory, times: Float[Array, " k"]
) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Return the input at the centre of the prior box, and half its range over box and δ."""
    states = whole.states(times)
    phi = system.regressors(*states)
    delta = system.disturbance_bound(states.position, states.velocity)
    reach = dot([jnp.abs(column) for column in phi], system.half_widths)
    return dot(phi, system.centre), reach + delta


def _draw_jerk(panel: plots.Axes, axis: Axis, whole: JerkTrajectory) -> None:
    edges = np.concatenate([[0.0], np.cumsum(np.asarray(whole.durations))])
    panel.stairs(np.asarray(whole.jerk), edges, color=plots.BLUE, linewidth=1.2, baseline=None)
    plots.limit_lines(panel, np.asarray(axis.task.limits.jerk).tolist())
    plots.label(panel, "time (s)", f"jerk ({UNITS[axis.system.coordinate]}/s³)", "Jerk")


def _draw_errors(panel: plots.Axes, found: AxisDesign) -> None:
    axis, worth, box = found.axis, found.worth, np.asarray(found.axis.system.half_widths)
    kinds = {
        "least squares, exact signals": worth.least_squares,
        "predicted guaranteed": worth.predicted,
        "lower bound": worth.lower_bound,
    }
    shares = {kind: 100 * np.asarray(error) / box for kind, error in kinds.items()}
    plots.bars(panel, axis.system.names, shares, 100.0, 100 * np.asarray(axis.wanted) / box)
    plots.label(panel, "", "half-width (% of the prior one)", "Predicted errors")
