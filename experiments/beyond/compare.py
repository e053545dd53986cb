"""Textbook excitations compared with the motion of this study, each optimised: table5.csv.

All have the same limits, boundary conditions, duration, encoder and servo. Families of excitations
are optimised for the criterion of the study's motion for all parameters, the largest predicted
half-width relative to its target, from as many starts and with as many evaluations. Motions for a
classical criterion, or for least squares, are designed for that criterion with the search of the
study. Each search finds four of them; the one that is best by the criterion of the study is shown.
That criterion also allows for a small velocity error.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Array, Float, PRNGKeyArray
from tqdm import tqdm

from experiments._support import excitations
from experiments._support.classical import InformationCriterion
from experiments._support.evaluations import rows_of
from experiments._support.excitations import Excitation
from experiments._support.family_search import Budget, best_members, polished_member
from experiments._support.processes import each
from experiments._support.toys import Toys
from experiments.axes import linear_motor as motor
from experiments.paper.designs import (
    ALLOWED,
    HORIZON,
    ONE_MOTION,
    STUDIED,
    TOY,
    Cell,
    trajectory_path,
)
from experiments.paper.figures import SYMBOLS
from experiments.paper.tables import Table
from jaxid.design.criteria import LeastSquaresError, PlannedError
from jaxid.design.evaluation import Evaluation, evaluate
from jaxid.design.optimal_motion import optimal_motion
from jaxid.io import plots
from jaxid.io.files import read_trajectory, write_table, write_trajectory
from jaxid.motion.motion_space import motion_space
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.lower_bound import lower_bound
from jaxid.regression.worst_case import infinity
from jaxid.runtime import configure
from jaxid.search.arc_structures import MEMBERS, Arcs, jerk_of
from jaxid.search.effort import Effort
from jaxid.search.problem import Problem
from jaxid.search.restoration import interior_motion, restored

FAMILIES: Mapping[str, type[Excitation]] = {
    "chirp": excitations.Chirp,
    "multisine": excitations.Multisine,
    "fourier": excitations.Fourier,
    "prbs": excitations.PRBS,
    "bang_bang": excitations.BangBang,
}
CRITERIA = {"d_optimal": "D", "a_optimal": "A", "e_optimal": "E"}
LEAST_SQUARES, OURS = "lse", "minimax"
TITLES = {
    "multisine": "multisine",
    "fourier": "Fourier series",
    "prbs": "PRBS",
    "bang_bang": "bang-bang",
    "d_optimal": "D-optimal",
    "a_optimal": "A-optimal",
    "e_optimal": "E-optimal",
    LEAST_SQUARES: "least squares ($J_*$)",
    OURS: "minimax (jaxid)",
}
EXCITATIONS = (*FAMILIES, *CRITERIA, LEAST_SQUARES, OURS)
COLUMNS = ("excitation", "parameter", "J_lse", "predicted", "gap")


@dataclass(frozen=True)
class Compare(Toys):
    """Ten excitations of the motor for 0.6 s, each optimised.

    Attributes:
        out: folder for table5.csv, table5.png and a compare_<excitation>.csv of each motion.
        motions: folder with the study's motion for all parameters.
        seed: seed of all starts.
        processes: number of searches that run in parallel; the results do not depend on it.
        redraw: use the motions in `out` instead of searching.
        toy: run with minimal effort, only to show that everything works.
    """

    out: Path = Path("figures")
    motions: Path = Path("figures")
    seed: int = 0
    processes: int = 2
    redraw: bool = False
    toy: bool = False

    def path(self, excitation: str) -> Path:
        """Return the file of a motion; that of jaxid is the study's motion for all parameters."""
        if excitation == OURS:
            return trajectory_path(self.motions, Cell(ONE_MOTION, HORIZON))
        return self.named(f"compare_{excitation}.csv")


def main(options: Compare) -> None:
    """Design the excitations, evaluate them, and write and print table 5."""
    others = [name for name in EXCITATIONS if name != OURS]
    if not options.redraw:
        found = each(partial(searched, options), others, options.processes)
        for name, motion in tqdm(found, "excitations", len(others)):
            write_trajectory(options.path(name), motion)
    least = lower_bound(motor.system(), motor.limits())
    worth = {
        name: evaluate(motor.system(), read_trajectory(options.path(name)), motor.servo(), least)
        for name in EXCITATIONS
    }
    table = Table(COLUMNS, rows_of(worth, "excitation", motor.system().names))
    write_table(options.named("table5.csv"), table.header, table.rows)
    draw(options.named("table5.png"), worth)
    print(table.text("Table 5: predicted half-width by excitation, and its gap to the lower bound"))
    print("Largest predicted half-width relative to the target of the study's motion:")
    for name, one in worth.items():
        worst = float(jnp.max(one.predicted / one.lower_bound / jnp.asarray(ALLOWED)))
        print(f"  {name:12} {worst:.4f}")


def searched(options: Compare, name: str) -> tuple[str, JerkTrajectory]:
    """Return the best motion of one kind: of all that are found, that of the smallest criterion."""
    limits = motor.limits()
    task = Task(limits, motor.boundary(), 2 * HORIZON, motor.KNOT_PERIOD)
    targets = jnp.asarray(ALLOWED) * lower_bound(motor.system(), limits).value
    effort = TOY if options.toy else Effort()
    key = jax.random.fold_in(jax.random.key(options.seed), EXCITATIONS.index(name))
    find = members if name in FAMILIES else optimal
    found = [
        (_reached(task, targets, motion), k, motion)
        for k, key in enumerate(jax.random.split(key, effort.searches))
        for motion in find(name, task, targets, key, effort)
    ]
    return name, min(found)[-1]


def optimal(
    name: str, task: Task, targets: Float[Array, " m"], key: PRNGKeyArray, effort: Effort
) -> list[JerkTrajectory]:
    """Return a list of one motion, designed for a classical criterion or for least squares."""
    system = motor.system()
    if name == LEAST_SQUARES:
        criterion = LeastSquaresError(system, infinity(targets))
    else:
        criterion = InformationCriterion(system, CRITERIA[name])
    return [optimal_motion(task, criterion, key, effort=effort).trajectory]


def members(
    name: str, task: Task, targets: Float[Array, " m"], key: PRNGKeyArray, effort: Effort
) -> list[JerkTrajectory]:
    """Return the best motions of a family, found in the same way as the study's motion.

    A search for least squares is followed by two refinements. Each of the best few motions is
    refined to the end, while for the study's motion only the best of all is.
    """
    system, family = motor.system(), family_of(name, task)
    problem = Problem.of(task, PlannedError(system, infinity(targets), _fastest(task), 5))
    deep, found = interior_motion(problem, task.intervals, task.period), []
    best = best_members(problem, deep, family, key, budget(effort), effort.finalists)
    for z in best:
        motion = restored(problem, deep, family.trajectory(z))
        for smoothings in (effort.predicted_smoothings[:1], effort.predicted_smoothings[1:]):
            exact = _expected(task, targets, motion)
            z, motion = polished_member(
                exact, deep, family, z, effort.predicted_programs, smoothings
            )
        found.append(motion)
    return found


def family_of(name: str, task: Task) -> Excitation:
    """Return a family of excitations for a task, with its two moves.

    The first move has the largest margin to the limits; the second one goes there and back at top
    speed.
    """
    limits = task.limits
    space = motion_space(limits, task.boundary, task.intervals, task.period)
    problem = Problem.of(task, lambda motion, smoothing: jnp.zeros(()))
    deep = interior_motion(problem, task.intervals, task.period)
    dwells = Arcs(jnp.flip(limits.velocity), jnp.ones(2))
    moves = jnp.stack([deep.jerk, jerk_of(dwells, limits, space)])
    peak, jerk = (jnp.min(jnp.abs(x)) for x in (limits.acceleration, limits.jerk))
    edge = 2 * peak / jerk / deep.duration
    return FAMILIES[name](space, moves, peak, edge)


def budget(effort: Effort) -> Budget:
    """Return the numbers of starts and evaluations of one design search."""
    random = effort.starts // 8
    bred = (effort.starts - random) * MEMBERS
    rounds = effort.rounds * effort.variations
    descents = (effort.starts + rounds) * effort.stages * effort.steps  # at most
    return Budget(bred + random + rounds, bred * effort.generations + descents)


def draw(path: Path, worth: Mapping[str, Evaluation]) -> None:
    """Draw optimality gaps as bars, one panel per parameter for which the motion matters."""
    canvas, panels = plots.figure(1, len(STUDIED), (11.0, 4.8))
    most = 100 * max(float(jnp.max(one.gap[: len(STUDIED)])) for one in worth.values())
    y = np.arange(len(worth))
    for k, (panel, name) in enumerate(zip(panels, STUDIED, strict=True)):
        gaps = [100 * float(one.gap[k]) for one in worth.values()]
        colours = [plots.RED if excitation == OURS else plots.BLUE for excitation in worth]
        bars = panel.barh(y, gaps, color=colours)
        panel.bar_label(bars, fmt="%.1f", padding=3, fontsize=10)
        panel.set_yticks(y, [TITLES.get(e, e) for e in worth] if k == 0 else [""] * len(y))
        panel.invert_yaxis()
        panel.set_xlim(0.0, 1.15 * most)
        plots.label(panel, "% above the lower bound", "", SYMBOLS[name])
    canvas.suptitle(
        "Predicted guaranteed half-widths: no motion and no estimator is below 0 %", fontsize=12
    )
    plots.save(canvas, path)


def _expected(task: Task, targets: Float[Array, " m"], motion: JerkTrajectory) -> Problem:
    """Return the problem of the study's motion for all parameters, near a given motion."""
    return Problem.of(task, motor.predicted_error(targets).near(task, motion))


def _reached(task: Task, targets: Float[Array, " m"], motion: JerkTrajectory) -> float:
    return float(_expected(task, targets, motion).value(motion))


def _fastest(task: Task) -> Array:
    return jnp.max(jnp.abs(task.limits.velocity))


if __name__ == "__main__":
    configure()
    main(tyro.cli(Compare))
