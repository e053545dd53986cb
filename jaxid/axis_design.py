"""A motion for an axis of a file: designed, appraised, exported, checked, and drawn on one page."""

from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxid import report
from jaxid.appraisal import Appraisal, appraise
from jaxid.axis_file import Axis
from jaxid.design import Report
from jaxid.files import write_json, write_trajectory
from jaxid.floor import floor
from jaxid.foresight import foreseen
from jaxid.guarantee import assumptions
from jaxid.motion_design import GuaranteedEffort, design_guaranteed
from jaxid.setpoints import margins, read_setpoints, sampled, write_setpoints
from jaxid.trajectory import JerkTrajectory

ALL = "all"  # parameters at once
FILES = (
    "trajectory.csv", "setpoints.csv", "setpoints.mat", "setpoints.h", "design.json", "design.png",
)  # fmt: skip


class AxisDesign(NamedTuple):
    """A motion and what it is worth.

    Attributes:
        axis: that it is for.
        target: the parameter that it is for, or `ALL`.
        seed: of the search.
        motion: within all limits.
        worth: of each parameter.
    """

    axis: Axis
    target: str
    seed: int
    motion: JerkTrajectory
    worth: Appraisal


def design_axis(
    axis: Axis,
    target: str = ALL,
    seed: int = 0,
    effort: GuaranteedEffort = GuaranteedEffort(),
    report: Report = lambda message: None,
) -> AxisDesign:
    """The motion whose log can be expected to prove most.

    Args:
        axis: from a file.
        target: the name of a parameter; or all, of which the largest error over its floor counts.
        seed: of the search.
        effort: how long to search.
        report: told what goes on.

    Raises:
        InfeasibleError: if no motion keeps the limits.
    """
    system, task = axis.system, axis.task
    alone = None if target == ALL else system.index(target)
    report("floor of every parameter")
    least = floor(system, task.limits)
    targets = least.value
    if alone is not None:
        targets = jnp.full_like(targets, jnp.inf).at[alone].set(targets[alone])
    key = jax.random.key(seed)
    motion = design_guaranteed(system, task, targets, key, axis.servo, effort=effort, report=report)
    return AxisDesign(axis, target, seed, motion, appraise(system, motion, axis.servo, least))


def write_design(folder: Path, found: AxisDesign) -> dict[str, float]:
    """Write `FILES`; what the exported positions leave of each limit, in half-widths."""
    axis, coordinate = found.axis, found.axis.system.coordinate
    write_trajectory(folder / "trajectory.csv", found.motion, coordinate)
    points = sampled(found.motion, axis.servo.period)
    for name in FILES[1:4]:
        write_setpoints(folder / name, points, coordinate)
    left = margins(read_setpoints(folder / "setpoints.csv", coordinate), axis.task.limits)
    write_json(folder / "design.json", summary(found, left))
    page(folder / "design.png", found)
    return left


def summary(found: AxisDesign, left: dict[str, float]) -> dict[str, Any]:
    """For other programs: what was designed, what it is worth, and what that rests on."""
    system, servo, worth = found.axis.system, found.axis.servo, found.worth
    parameters = {
        name: {
            "unit": system.units[k],
            "interval": [float(system.lower[k]), float(system.upper[k])],
            "J": float(worth.error[k]),
            "guaranteed": float(worth.guaranteed[k]),
            "floor": float(worth.floor[k]),
            "gap": float(worth.gap[k]),
        }
        for k, name in enumerate(system.names)
    }
    return {
        "program": f"jaxid {version('jaxid')}",
        "target": found.target,
        "seed": found.seed,
        "parameters": parameters,
        "margins": left,
        "rests_on": list(assumptions(system, foreseen(system, found.motion, servo))),
    }


def page(path: Path, found: AxisDesign) -> None:
    """The motion within its limits, and what its log can be expected to leave of each interval."""
    system, worth = found.axis.system, found.worth
    canvas, panels = report.figure(2, 2, (11.0, 7.0))
    title = f"motion for {found.target}" + (" parameters" if found.target == ALL else "")
    limits = np.asarray(found.axis.task.limits.motion)
    report.motion(panels[:3], found.motion, limits, title, system.coordinate)
    panels[1].set_xlabel("time (s)", fontsize=12)
    box = np.asarray(system.half_widths)
    x = np.arange(len(box))
    kinds = {"least squares": worth.error, "guaranteed": worth.guaranteed, "floor": worth.floor}
    for shift, colour, (kind, error) in zip(
        (-0.27, 0.0, 0.27), report.CYCLE, kinds.items(), strict=False
    ):
        share = np.minimum(np.asarray(error) / box, 1.0)
        panels[3].bar(x + shift, share, 0.25, color=colour, label=kind)
    panels[3].set_xticks(x, system.names, fontsize=12)
    panels[3].legend(fontsize=10)
    report.label(panels[3], "", "error, of the prior half-width")
    report.save(canvas, path)
