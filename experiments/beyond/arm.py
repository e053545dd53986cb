"""Designs for the one-link arm, one per parameter and one for all, and the results of one run.

The arm is rotary, with gravity and asymmetric limits. The results are arm.csv, arm_proved.csv and
arm.png.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from tqdm import tqdm

from experiments._support.evaluations import WORTH, rows_of
from experiments._support.examples import PROVED, Example, interval_rows, save_table
from experiments._support.processes import each
from experiments.axes import one_link_arm as arm
from experiments.paper.designs import TOY
from jaxid.design.criteria import LeastSquaresError
from jaxid.design.evaluation import Evaluation, evaluate
from jaxid.design.optimal_motion import optimal_motion
from jaxid.design.predicted_error import PredictedError
from jaxid.identification.assumptions import assumptions
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.io import plots
from jaxid.io.files import read_trajectory, write_trajectory
from jaxid.loop.closed_loop import run
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.lower_bound import lower_bound
from jaxid.runtime import configure
from jaxid.search.effort import Effort

ALL = "all"  # target: the largest predicted error over its lower bound
INTERVALS = 50  # intervals of 20 ms: one second
COLUMNS = ("design", "parameter", *WORTH)


@dataclass(frozen=True)
class Study(Example):
    """Six designs for the arm: one for each parameter and one for all.

    Attributes:
        processes: number of searches that run in parallel; the results do not depend on it.
    """

    processes: int = 2

    def path(self, design: str) -> Path:
        """Return the file of a motion."""
        return self.named(f"arm_{design}.csv")


def main(study: Study) -> None:
    """Design the motions, evaluate them, run one, and write and print the results."""
    system, designs = arm.system(), (*arm.system().names, ALL)
    if not study.redraw:
        found = each(partial(searched, study), designs[::-1], study.processes)
        for design, motion in tqdm(found, "designs", len(designs)):
            write_trajectory(study.path(design), motion, system.coordinate)
    motions = {design: read_trajectory(study.path(design), system.coordinate) for design in designs}
    least = lower_bound(system, arm.limits())
    worth = {name: evaluate(system, motion, arm.servo(), least) for name, motion in motions.items()}
    save_table(study.named("arm.csv"), COLUMNS, rows_of(worth, "design", system.names))
    log = run(arm.plant(), arm.controller(), arm.servo(), motions[ALL]).log
    proved = guaranteed_intervals(system, [log]).estimate
    rows = interval_rows(system, arm.TRUE_PARAMETERS, proved)
    save_table(study.named("arm_proved.csv"), PROVED, rows)
    print("These intervals hold provided that:", *assumptions(system, log), sep="\n  ")
    draw(study.named("arm.png"), motions[ALL], worth)


def searched(study: Study, design: str) -> tuple[str, JerkTrajectory]:
    """Return the name and the motion of one design."""
    system = arm.system()
    task = Task(arm.limits(), arm.boundary(), INTERVALS, arm.KNOT_PERIOD)
    key = jax.random.fold_in(jax.random.key(study.seed), (*system.names, ALL).index(design))
    effort = TOY if study.toy else Effort()
    if design != ALL:
        criterion = LeastSquaresError(system, design)
        return design, optimal_motion(task, criterion, key, effort=effort).trajectory
    targets = lower_bound(system, task.limits).value
    criterion = PredictedError(system, targets, arm.servo())
    return design, optimal_motion(task, criterion, key, effort=effort).trajectory


def draw(path: Path, motion: JerkTrajectory, worth: Mapping[str, Evaluation]) -> None:
    """Draw the motion for all parameters, and optimality gaps by design and parameter."""
    canvas, panels = plots.figure(1, 3, (12.0, 4.2))
    time = np.linspace(0.0, float(motion.duration), 1000)
    states, limits = motion.states(jnp.asarray(time)), arm.limits()
    for panel, values, limit, name in zip(
        panels,
        states,
        (limits.position, limits.velocity),
        ("position (rad)", "velocity (rad/s)"),
        strict=False,
    ):
        plots.series(panel, time, np.asarray(values), name)
        plots.limit_lines(panel, np.asarray(limit).tolist())
    gaps = 100 * np.array([np.asarray(one.gap) for one in worth.values()])
    names = arm.system().names
    plots.heat_map(panels[2], gaps, list(worth), names, "{:.1f}", logarithmic=True)
    panels[0].set_title("One motion for all (limits dashed)", fontsize=12)
    panels[1].set_title("Its velocity (limits dashed)", fontsize=12)
    title = "Predicted error, % above its lower bound"
    plots.label(panels[2], "parameter", "motion designed for", title)
    plots.save(canvas, path)


if __name__ == "__main__":
    configure()
    main(tyro.cli(Study))
