"""Designs of motions for an axis from a file, of several durations and for several targets."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

from jaxid._checks import require
from jaxid._progress import Report, silent, within
from jaxid.axis.design import AxisDesign, design_axis, evaluated, in_words, require_possible
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import PROGRAM, Axis
from jaxid.axis.result import write
from jaxid.axis.saved_designs import SavedDesign, read_design
from jaxid.io.results import require_writable
from jaxid.motion.violation import worst_violation
from jaxid.regression.lower_bound import lower_bound
from jaxid.search.effort import Effort


class Tradeoff(NamedTuple):
    """Designs for several targets and durations, to choose from.

    Attributes:
        axis: axis from a file.
        designs: designed motions; the axis of each has its own duration.
        results: digest of each design, by its place.
    """

    axis: Axis
    designs: tuple[AxisDesign, ...]
    results: dict[str, str]


def tradeoff(
    axis: Axis,
    targets: Sequence[str],
    durations: Sequence[float],
    out: Path,
    seed: int = 0,
    effort: Effort = Effort(),
    report: Report = silent,
    *,
    replace: bool = False,
) -> Tradeoff:
    """Design a motion for every target and duration, and return all designs.

    Each design is written to its own folder as soon as it is found.

    Args:
        axis: axis from a file.
        targets: targets as in `design_axis`.
        durations: durations of the motions, s.
        out: folder in which each design has its folder; designs of the same search there are
            reused.
        seed: seed of each search.
        effort: effort of each search.
        report: function that is called as each step begins, with its name and the share of the
            work that is done.
        replace: whether other designs in these folders may be replaced.

    Raises:
        InfeasibleError: if no motion of a duration keeps the limits.
        ValueError: if a target does not exist, a duration is not a whole number of knot periods, or
            a folder holds another design that must not be replaced.
    """
    asked = [(target, axis.lasting(duration)) for target, duration in product(targets, durations)]
    places = [f"{target}_{duration_of(longer):.12g}s" for target, longer in asked]
    search, kept = in_words(seed, effort), []
    for place, (target, longer) in zip(places, asked, strict=True):
        require_possible(longer, target)
        kept.append(_kept(out / place, longer, target, search, replace=replace))
    found, results = [], {}
    least = lower_bound(axis.system, axis.task.limits)  # whatever the duration
    for k, (place, (target, longer), saved) in enumerate(zip(places, asked, kept, strict=True)):
        label = f"{place}, {k + 1} of {len(places)}: "
        own = within(report, k / len(places), (k + 1) / len(places), label)
        if saved is None:
            one = design_axis(longer, target, seed, effort, own)
            part = write(out / place, DesignResult(one), replace=replace)
        else:
            own("evaluation", 0.0)
            one, part = evaluated(longer, target, search, saved.motion, least), saved.part
        found.append(one)
        results[f"{place}/{DesignResult.name}"] = part.digest
    return Tradeoff(axis, tuple(found), results)


def duration_of(axis: Axis) -> float:
    """Return the duration of an axis' motions without their approach, in s."""
    return round(axis.task.intervals * axis.task.period, 12)


def _kept(
    folder: Path, axis: Axis, target: str, search: str, *, replace: bool
) -> SavedDesign | None:
    """Return the saved design of this search, if there is one and it keeps the limits.

    Raises:
        ValueError: if the folder holds something else that must not be replaced.
    """
    try:
        saved = read_design(folder, axis.system.coordinate)
    except (ValueError, OSError):  # none, or damaged
        saved = None
    if saved is not None and _is_for(saved, axis, target, search):
        return saved
    require(
        replace or not (folder / "design.json").exists(),
        f"{folder} has a design that was made with another axis file or other search settings: "
        "choose another folder, or use --force to overwrite it.",
    )
    require_writable(folder, DesignResult.names, replace=replace)
    return None


def _is_for(saved: SavedDesign, axis: Axis, target: str, search: str) -> bool:
    """Return whether a saved design is the one that this search would find again."""
    summary, motion, task = saved.summary, saved.motion, axis.task
    if (axis.digest, target, search, PROGRAM) != (
        summary.axis_sha256, summary.target, summary.search, summary.program,
    ):  # fmt: skip
        return False
    return motion.jerk.size == task.intervals and bool(
        worst_violation(task.limits, task.boundary, motion) <= 0
    )
