"""A motion for an axis of a file: designed, appraised, exported, checked, and drawn on one page."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.axis.file import PROGRAM, Axis
from jaxid.design.evaluation import Evaluation, evaluate
from jaxid.design.nominal_log import nominal_log
from jaxid.design.optimal_motion import optimal_motion
from jaxid.design.predicted_error import PredictedError
from jaxid.identification.assumptions import assumptions
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.io import plots
from jaxid.io.files import write_json, write_trajectory
from jaxid.io.setpoints import margins, read_setpoints, sampled, write_setpoints
from jaxid.motion.feasibility import interior
from jaxid.motion.point_to_point import approach, joined, wait
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.lower_bound import LowerBound, lower_bound
from jaxid.search.effort import Effort
from jaxid.search.problem import Report

ALL = "all"  # parameters at once, each error over its floor
WANTED = "wanted"  # those of the file, each error over what is wanted
FILES = (
    "trajectory.csv", "setpoints.csv", "setpoints.mat", "setpoints.h", "design.json", "design.png",
)  # fmt: skip
_TITLES = {ALL: "all parameters", WANTED: "the errors that are wanted"}
_ROUNDED = 1e-6  # half-widths: what differences of rounded positions may be beyond
FACTORS = (0.5, 2.0)  # of δ, for which it is shown too what could be guaranteed


class AxisDesign(NamedTuple):
    """A motion and what it is worth.

    Attributes:
        axis: that it is for.
        target: the parameter that it is for, `ALL` or `WANTED`.
        search: its seed and effort, in words.
        motion: within all limits.
        worth: of each parameter.
        sensitivity: what would be guaranteed with `FACTORS` of δ, shape (factors, m).
    """

    axis: Axis
    target: str
    search: str
    motion: JerkTrajectory
    worth: Evaluation
    sensitivity: Float[np.ndarray, "factors m"]


def design_axis(
    axis: Axis,
    target: str = ALL,
    seed: int = 0,
    effort: Effort = Effort(),
    tell: Report = lambda message: None,
) -> AxisDesign:
    """The motion whose log can be expected to prove most.

    Args:
        axis: from a file.
        target: the name of a parameter, `ALL` or `WANTED`; of several the largest error counts,
            over its floor or over what is wanted.
        seed: of the search.
        effort: how long to search.
        tell: told what goes on.

    Raises:
        InfeasibleError: if no motion keeps the limits.
        ValueError: if the target is none, or the axis cannot come to the start of a motion.
    """
    system, task, servo = axis.system, axis.task, axis.servo
    require_possible(axis, target)
    tell("floor of every parameter")
    least = lower_bound(system, task.limits)
    targets, key = _targets(axis, target, least), jax.random.key(seed)
    criterion = PredictedError(system, targets, servo, velocity_error=axis.velocity_error)
    motion = optimal_motion(task, criterion, key, effort=effort, report=tell).trajectory
    tell("what it is worth")
    return appraised(axis, target, in_words(seed, effort), motion, least)


def require_possible(axis: Axis, target: str) -> None:
    """Refuse before a search what it would end in.

    Raises:
        InfeasibleError: if no motion keeps the limits.
        ValueError: if the target is none, or an approach does not end with a tick of the servo.
    """
    task, period = axis.task, axis.servo.period
    if target == WANTED:
        require(
            bool(jnp.any(jnp.isfinite(axis.wanted))),
            f"Argument `target` must not be {WANTED} unless the axis says what is wanted.",
        )
    elif target != ALL:
        axis.system.index(target)
    before = float(lead_in(axis, task.boundary.start).duration) / period
    require(
        abs(before - round(before)) < 1e-6,
        f"`knot_period` must be a multiple of the servo's period {period:g} s for an approach, but "
        f"is {task.period:g} s.",
    )
    interior(task.limits, task.boundary, task.intervals, task.period)


def in_words(seed: int, effort: Effort) -> str:
    """Of a search, to tell it from others."""
    return f"seed {seed}, {effort}"


def appraised(
    axis: Axis, target: str, search: str, motion: JerkTrajectory, least: LowerBound
) -> AxisDesign:
    """A motion with what it is worth, and would be with another δ."""
    worth = evaluate(axis.system, motion, axis.servo, least)
    systems = [axis.system.with_scaled_disturbance(factor) for factor in FACTORS]
    found = [
        guaranteed_intervals(x, [nominal_log(x, motion, axis.servo)]).estimate for x in systems
    ]
    sensitivity = np.stack([np.asarray(estimate.half_length) for estimate in found])
    return AxisDesign(axis, target, search, motion, worth, sensitivity)


def lead_in(axis: Axis, start: Float[Array, "3"]) -> JerkTrajectory:
    """From home to the start of a motion, and the rest there; of no interval if it is at home."""
    position, period = float(start[0]), axis.task.period
    move = approach(axis.task.limits, axis.home, position, period)
    return joined(move, wait(position, axis.waiting, period))


def played(axis: Axis, motion: JerkTrajectory) -> JerkTrajectory:
    """All that the servo plays: from home to the start of the motion, rest, and the motion."""
    return joined(lead_in(axis, motion.start), motion)


def write_design(folder: Path, found: AxisDesign) -> dict[str, float]:
    """Write `FILES`; what the exported positions leave of each limit, in half-widths."""
    (folder / "design.json").unlink(missing_ok=True)  # it stands for the whole, and comes last
    axis, coordinate = found.axis, found.axis.system.coordinate
    write_trajectory(folder / "trajectory.csv", found.motion, coordinate)
    points = sampled(played(axis, found.motion), axis.servo.period)
    for name in FILES[1:4]:
        write_setpoints(folder / name, points, coordinate)
    left = margins(read_setpoints(folder / "setpoints.csv", coordinate), axis.task.limits)
    require(
        min(left.values()) >= -_ROUNDED,
        f"The exported positions leave the limits: {left}, in half-widths.",
    )
    page(folder / "design.png", found)
    write_json(folder / "design.json", summary(found, left))
    return left


def of_another_axis(paths: Iterable[Path], axis: Axis) -> tuple[Path, ...]:
    """Folders of those design.json that are of another axis file, or of what this one was."""
    return tuple(
        path.parent for path in paths if read_design(path).get("axis_sha256") != axis.digest
    )


def read_design(path: Path) -> dict[str, Any]:
    """What `write_design` wrote as design.json.

    Raises:
        ValueError: if it is none.
    """
    try:
        found = json.loads(path.read_text())
    except ValueError:
        found = None
    if not isinstance(found, dict) or "target" not in found:
        raise ValueError(f"File {path} must be one of jaxid design, but has no target.")
    return found


def designs_in(folder: Path) -> list[Path]:
    """Every design.json of `write_design` or `tradeoff`."""
    return sorted([*folder.glob("design.json"), *folder.glob("*/design.json")])


def summary(found: AxisDesign, left: dict[str, float]) -> dict[str, Any]:
    """For other programs: what was designed, what it is worth, and what that rests on."""
    axis, system, motion = found.axis, found.axis.system, found.motion
    begins = float(lead_in(axis, motion.start).duration)
    return {
        "program": PROGRAM,
        "axis_sha256": axis.digest,
        "target": found.target,
        "search": found.search,
        "begins_s": begins,
        "ends_s": begins + float(motion.duration),
        "parameters": {name: _parameter(found, k) for k, name in enumerate(system.names)},
        "margins": left,
        "rests_on": list(
            assumptions(system, nominal_log(system, motion, axis.servo), delay=axis.servo.delay)
        ),
    }


def _parameter(found: AxisDesign, k: int) -> dict[str, Any]:
    system, worth, wanted = found.axis.system, found.worth, float(found.axis.wanted[k])
    known = {
        "unit": system.units[k],
        "interval": [float(system.lower[k]), float(system.upper[k])],
        "J": float(worth.error[k]),
        "guaranteed": float(worth.guaranteed[k]),
        "floor": float(worth.floor[k]),
        "gap": float(worth.gap[k]),
        "guaranteed_with_delta_times": {
            f"{factor:g}": float(row[k])
            for factor, row in zip(FACTORS, found.sensitivity, strict=True)
        },
    }
    return known if np.isinf(wanted) else known | {"wanted": wanted}


def _targets(axis: Axis, target: str, least: LowerBound) -> Float[Array, " m"]:
    """What each error is compared with; inf leaves a parameter out."""
    if target == ALL:
        return least.value
    if target == WANTED:
        return axis.wanted
    k = axis.system.index(target)
    return jnp.full_like(least.value, jnp.inf).at[k].set(least.value[k])


def text(found: AxisDesign, left: dict[str, float]) -> str:
    """For people."""
    system, worth = found.axis.system, found.worth
    twice = FACTORS.index(2.0)
    header = ["parameter", "unit", "J", "guaranteed", "floor", "gap", "with 2·δ"]
    columns = [worth.error, worth.guaranteed, worth.floor, worth.gap, found.sensitivity[twice]]
    cells: list[list[float | None]] = [column.tolist() for column in columns]
    wanted = found.axis.wanted.tolist()
    if np.any(np.isfinite(wanted)):
        header.append("wanted")
        cells.append([None if np.isinf(x) else x for x in wanted])
    rows = list(zip(system.names, system.units, *cells, strict=True))
    margins = ", ".join(f"{name} {x:.2%}" for name, x in left.items())
    title = "What its log can be expected to prove"
    return f"{plots.text_table(header, rows, title)}\nLeft of the limits: {margins}"


def page(path: Path, found: AxisDesign) -> None:
    """What is played within its limits, and what the log of the motion can be expected to leave."""
    axis, worth = found.axis, found.worth
    canvas, panels = plots.figure(2, 2, (11.0, 7.0))
    title = f"motion for {_TITLES.get(found.target, found.target)}"
    limits, whole = np.asarray(axis.task.limits.motion), played(axis, found.motion)
    plots.motion(panels[:3], whole, limits, title, axis.system.coordinate)
    before = float(whole.duration - found.motion.duration)
    for panel in panels[: 3 if before else 0]:
        panel.axvspan(0.0, before, color=plots.GREY, alpha=0.2, linewidth=0)
    if before:
        panels[0].set_title(f"{title}; grey: its approach", fontsize=12)
    panels[1].set_xlabel("time (s)", fontsize=12)
    box = np.asarray(axis.system.half_widths)
    kinds = {"least squares": worth.error, "guaranteed": worth.guaranteed, "floor": worth.floor}
    shares = {kind: np.asarray(error) / box for kind, error in kinds.items()}
    plots.bars(panels[3], axis.system.names, shares, 1.0, np.asarray(axis.wanted) / box)
    plots.label(panels[3], "", "error, of the prior half-width")
    plots.save(canvas, path)
