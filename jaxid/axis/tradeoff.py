"""Motions for an axis of a file, of several durations and for several targets, compared."""

from collections.abc import Iterable, Sequence
from itertools import cycle, product
from pathlib import Path

from jaxid._checks import require
from jaxid.axis.design import (
    AxisDesign,
    appraised,
    design_axis,
    in_words,
    read_design,
    require_possible,
    write_design,
)
from jaxid.axis.file import PROGRAM, Axis
from jaxid.io import plots
from jaxid.io.files import Cell, read_trajectory, write_table
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.motion.violation import worst_violation
from jaxid.regression.lower_bound import lower_bound
from jaxid.search.effort import Effort
from jaxid.search.problem import Report

FILES = ("tradeoff.csv", "tradeoff.png")
COLUMNS = ("target", "duration_s", "parameter", "unit", "J", "guaranteed", "floor", "gap")


def tradeoff(
    axis: Axis,
    targets: Sequence[str],
    durations: Sequence[float],
    out: Path,
    seed: int = 0,
    effort: Effort = Effort(),
    tell: Report = lambda message: None,
    *,
    replace: bool = False,
) -> list[AxisDesign]:
    """Every target with every duration; each design is kept in a folder of its own when found.

    Args:
        axis: from a file.
        targets: as those of `design_axis`.
        durations: of the motions, s.
        out: the folder that theirs go into; designs of the same search that are there are used.
        seed: of each search.
        effort: of each search.
        tell: told what goes on.
        replace: a design of something else that a folder holds.

    Raises:
        InfeasibleError: if no motion of a duration keeps the limits.
        ValueError: if a folder holds another design that must not be replaced.
    """
    asked = [(target, axis.lasting(duration)) for target, duration in product(targets, durations)]
    folders = [out / f"{target}_{_duration(longer):.12g}s" for target, longer in asked]
    search, kept = in_words(seed, effort), []
    for folder, (target, longer) in zip(folders, asked, strict=True):
        require_possible(longer, target)
        kept.append(_kept(folder, longer, target, search))
        require(
            kept[-1] is not None or replace or not (folder / "design.json").exists(),
            f"{folder} holds a design that is none of this axis and search: choose another folder, "
            "or allow to replace it with --force.",
        )
    found, least = [], lower_bound(axis.system, axis.task.limits)  # whatever the duration
    for folder, (target, longer), motion in zip(folders, asked, kept, strict=True):
        label = folder.name
        if motion is None:
            one = design_axis(
                longer, target, seed, effort, lambda said, label=label: tell(f"{label}: {said}")
            )
            write_design(folder, one)
        else:
            tell(f"{label}: what it is worth")
            one = appraised(longer, target, search, motion, least)
        found.append(one)
    return found


def write_tradeoff(folder: Path, found: Sequence[AxisDesign]) -> None:
    """Write `FILES`."""
    write_table(folder / FILES[0], COLUMNS, rows(found))
    page(folder / FILES[1], found)


def rows(found: Iterable[AxisDesign]) -> list[dict[str, Cell]]:
    """One per design and parameter."""
    return [
        {
            "target": one.target,
            "duration_s": _duration(one.axis),
            "parameter": name,
            "unit": one.axis.system.units[k],
            "J": float(one.worth.error[k]),
            "guaranteed": float(one.worth.guaranteed[k]),
            "floor": float(one.worth.floor[k]),
            "gap": float(one.worth.gap[k]),
        }
        for one in found
        for k, name in enumerate(one.axis.system.names)
    ]


def text(found: Iterable[AxisDesign]) -> str:
    """For people."""
    cells = [[row[name] for name in COLUMNS] for row in rows(found)]
    return plots.text_table(COLUMNS, cells, "What their logs can be expected to prove")


def page(path: Path, found: Sequence[AxisDesign]) -> None:
    """What is guaranteed of each parameter over the duration, one line per target."""
    system = found[0].axis.system
    targets = list(dict.fromkeys(one.target for one in found))
    count = len(system.names)
    canvas, panels = plots.figure(1, count, (3.4 * count, 3.8))
    for k, (panel, name, unit) in enumerate(zip(panels, system.names, system.units, strict=True)):
        for target, colour in zip(targets, cycle(plots.CYCLE), strict=False):
            own = [one for one in found if one.target == target]
            time = [_duration(one.axis) for one in own]
            error = [float(one.worth.guaranteed[k]) for one in own]
            panel.plot(time, error, "o-", color=colour, label=f"for {target}")
        least = float(found[0].worth.floor[k])
        panel.axhline(least, color=plots.GREY, linestyle="--", linewidth=1.2, label="floor")
        plots.label(panel, "duration (s)", f"guaranteed ± ({unit})", name)
    panels[0].legend(fontsize=10)
    plots.save(canvas, path)


def _duration(axis: Axis) -> float:
    return round(axis.task.intervals * axis.task.period, 12)


def _kept(folder: Path, axis: Axis, target: str, search: str) -> JerkTrajectory | None:
    """The motion that was designed before, if it is one for this and within the limits."""
    try:
        there = read_design(folder / "design.json")
        motion = read_trajectory(folder / "trajectory.csv", axis.system.coordinate)
    except (ValueError, OSError):  # none, or damaged
        return None
    names = "axis_sha256", "target", "search", "program"
    if (axis.digest, target, search, PROGRAM) != tuple(there.get(name) for name in names):
        return None
    right = motion.jerk.size == axis.task.intervals
    right = right and worst_violation(axis.task.limits, axis.task.boundary, motion) <= 0
    return motion if right else None
