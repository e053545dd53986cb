"""Which search finds the better motion, and how soon: ours or IPOPT's best of ten starts?

Both searches of a cell run one after the other in one process that stays on one processor, and two
such processes side by side. What is compiled before the first iteration is not counted: ours once
per horizon (a shorter search comes before; padding would share one compilation, but then short
motions take as long as long ones), IPOPT's functions once per cell.
"""

import functools
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Float, PRNGKeyArray

from experiments._support.pieces import Pieces
from experiments.axes import linear_motor as motor
from experiments.paper.designs import STUDIED, TOY
from jaxid.design.criteria import LeastSquaresError, PlannedError
from jaxid.design.optimal_motion import optimal_motion
from jaxid.io.files import Cell as Value
from jaxid.io.files import write_table
from jaxid.io.plots import text_table
from jaxid.motion.feasibility import InfeasibleError, interior
from jaxid.motion.motion_space import motion_space
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory, uniform
from jaxid.regression.error_of_motion import planned_error
from jaxid.regression.worst_case import individual
from jaxid.runtime import configure
from jaxid.search.arc_structures import evolve_arcs
from jaxid.search.effort import Effort
from jaxid.search.initial_guesses import random_starts
from jaxid.search.problem import Design, Problem
from jaxid.search.restoration import restored

STARTS = 10  # of IPOPT
SEARCHES = 4  # of ours: together they take up to three times as long as IPOPT's ten starts
# ours goes as far as IPOPT with its corners: with 1e-4 for the last, M at N = 30 stays 8e-7 above
SMOOTHINGS = (0.0006, 0.0001, 0.00001)
SHORTER = 10  # by which the horizon of a motion to begin from is
COLUMNS = (
    "parameter", "N", "J_ours", "J_ipopt", "ours_over_ipopt", "ipopt_s", "ipopt_best_s",
    "ours_s", "ours_reached_s", "share_of_wall", "share_of_cpu", "ipopt_compile_s",
)  # fmt: skip

Row = dict[str, Value]
Jerk = Float[np.ndarray, " n"]


class Cell(NamedTuple):
    """A parameter and a horizon of Table I."""

    parameter: str
    horizon: int

    @classmethod
    def of(cls, label: str) -> "Cell":
        """From its label."""
        parameter, horizon = label.rsplit("_", 1)
        return cls(parameter, int(horizon))

    @property
    def label(self) -> str:
        """The name of its piece of work."""
        return f"{self.parameter}_{self.horizon}"

    @property
    def intervals(self) -> int:
        """Of constant jerk."""
        return 2 * self.horizon


class Clock(NamedTuple):
    """Seconds of wall time and of the processor's time."""

    wall: float
    cpu: float


class Mark(NamedTuple):
    """J of an admissible motion, and when it was there."""

    error: float
    clock: Clock


@dataclass(frozen=True)
class Comparison:
    """Table I's feasible cells by both searches; goes on where it stopped.

    Attributes:
        out: the folder of bench_design.csv.
        seed: of all starts.
        processes: how many cells are searched side by side.
        toy: two starts and one stage: only shows that everything runs.
    """

    out: Path = Path("figures")
    seed: int = 0
    processes: int = 2
    toy: bool = False

    @property
    def path(self) -> Path:
        """Of the table."""
        return self.out / "bench_design.csv"


def main(comparison: Comparison) -> None:
    """Search all cells, keeping each as soon as it is done; save and print the table."""
    horizons = motor.HORIZONS[1:2] if comparison.toy else motor.HORIZONS[1:]
    names = STUDIED[:1] if comparison.toy else STUDIED
    cells = [Cell(name, horizon) for name in names for horizon in horizons]
    pieces = Pieces.of(comparison.path, (comparison.seed, comparison.toy))
    search = functools.partial(compare, comparison.seed, comparison.toy)
    found = pieces.complete([c.label for c in cells], search, comparison.processes, "cells")
    rows = [row_of(cell, numbers) for cell, numbers in zip(cells, found, strict=True)]
    write_table(comparison.path, COLUMNS, rows)
    pieces.discard()
    shown = [[row[name] for name in COLUMNS] for row in rows]
    print(text_table(COLUMNS, shown, "Design search: ours and IPOPT's best of ten starts"))
    print("\n".join(verdicts(rows)))


def row_of(cell: Cell, numbers: Mapping[str, np.ndarray]) -> Row:
    """The row of a cell; no number stands for what was not reached."""
    values = {name: None if np.isnan(x) else float(x) for name, x in numbers.items()}
    return {"parameter": cell.parameter, "N": cell.horizon, **values}


def verdicts(rows: list[Row]) -> list[str]:
    """The two targets in words."""
    better = sum(float(row["ours_over_ipopt"] or 2) <= 1 for row in rows)
    sooner = sum(float(row["share_of_wall"] or 2) <= 0.25 for row in rows)
    return [
        f"J* at or below IPOPT's in {better} of {len(rows)} cells (target: all).",
        f"IPOPT's best reached in a quarter of its time in {sooner} of {len(rows)} (target: all).",
    ]


def compare(seed: int, toy: bool, label: str) -> dict[str, np.ndarray]:
    """The numbers of a cell, from both searches, IPOPT first."""
    from experiments.bench.shooting import LADDER, Program

    cell = Cell.of(label)
    begin = time.perf_counter()
    program = Program(cell.parameter, cell.intervals, LADDER[:1] if toy else LADDER)
    compiled = time.perf_counter() - begin
    ipopt, whole_ipopt = by_ipopt(cell, program.solve, starts(cell, seed, 2 if toy else STARTS))
    effort = TOY if toy else Effort(smoothings=SMOOTHINGS)
    _compile(cell.horizon, effort)
    ours, whole_ours = by_us(cell, seed, effort)
    goal, best = min(ipopt), min(ours)
    reached = next((mark.clock for mark in ours if mark.error <= goal.error), None)
    numbers = {
        "J_ours": best.error,
        "J_ipopt": goal.error,
        "ours_over_ipopt": best.error / goal.error,
        "ipopt_s": whole_ipopt.wall,
        "ipopt_best_s": goal.clock.wall,
        "ours_s": whole_ours.wall,
        "ours_reached_s": reached.wall if reached else np.nan,
        "share_of_wall": reached.wall / whole_ipopt.wall if reached else np.nan,
        "share_of_cpu": reached.cpu / whole_ipopt.cpu if reached else np.nan,
        "ipopt_compile_s": compiled,
    }
    return {name: np.asarray(number) for name, number in numbers.items()}


def by_ipopt(
    cell: Cell, solve: Callable[[Jerk], Jerk], begin: list[Jerk]
) -> tuple[list[Mark], Clock]:
    """J of every start's result, walked back into the exact limits as ours are."""
    problem = _problem(cell)
    inside = interior(problem.limits, problem.boundary, cell.intervals, motor.KNOT_PERIOD)
    stopwatch, marks = Stopwatch(), []
    for jerk in begin:
        found = uniform(problem.boundary.start, jnp.asarray(solve(jerk)), motor.KNOT_PERIOD)
        with stopwatch.stopped():
            marks.append(Mark(error(cell, restored(problem, inside, found)), stopwatch.clock))
    return marks, stopwatch.clock


def by_us(cell: Cell, seed: int, effort: Effort) -> tuple[list[Mark], Clock]:
    """J of the best motion after every descent of a few searches, and of the polished ones.

    The first descent decides what a search can reach. All but the first therefore begin as those of
    Table I do, from a motion for a shorter horizon, whose search counts too; or, where the shorter
    one is infeasible, from other random numbers.
    """
    stopwatch, marks = Stopwatch(), []

    def show(trajectory: JerkTrajectory) -> None:
        with stopwatch.stopped():
            marks.append(Mark(error(cell, trajectory), stopwatch.clock))

    first, *keys = jax.random.split(_key(cell, seed), 2 * SEARCHES - 1)
    _design(cell, first, effort, show=show)
    for before, after in zip(keys[::2], keys[1::2], strict=True):
        shorter = _shorter(cell, before, effort)
        _design(cell, after, effort, shorter=shorter, show=show)
    return marks, stopwatch.clock


def _shorter(cell: Cell, key: PRNGKeyArray, effort: Effort) -> JerkTrajectory | None:
    before = Cell(cell.parameter, cell.horizon - SHORTER)
    try:
        return _design(before, key, effort).trajectory
    except InfeasibleError:
        return None


def _design(cell: Cell, key: PRNGKeyArray, effort: Effort, **options: Any) -> Design:
    task = Task(motor.limits(), motor.boundary(), cell.intervals, motor.KNOT_PERIOD)
    criterion = LeastSquaresError(motor.system(), cell.parameter)
    return optimal_motion(task, criterion, key, effort=effort, **options)


def _problem(cell: Cell) -> Problem:
    """A crude grid is enough to make starts and to know the limits."""
    system = motor.system()
    norm = individual(system.index(cell.parameter), len(system.names))
    objective = PlannedError(system, norm, jnp.asarray(1.0), 1)
    return Problem(objective, motor.limits(), motor.boundary())


def starts(cell: Cell, seed: int, count: int) -> list[Jerk]:
    """Half of them random, half of them dwells in random order."""
    problem = _problem(cell)
    space = motion_space(problem.limits, problem.boundary, cell.intervals, motor.KNOT_PERIOD)
    random, dwells = jax.random.split(_key(cell, seed))
    z = jnp.concatenate(
        [
            random_starts(random, space, count // 2),
            evolve_arcs(dwells, problem, space, count - count // 2, generations=0),
        ]
    )
    return [np.asarray(space.trajectory(coordinates).jerk) for coordinates in z]


def error(cell: Cell, trajectory: JerkTrajectory) -> float:
    """J* of the parameter that a cell is for, with the exact δ."""
    return float(planned_error(motor.system(), trajectory)[motor.system().index(cell.parameter)])


class Stopwatch:
    """Wall and processor time since it was made, without the time that it was stopped."""

    def __init__(self) -> None:
        self._begin = self._now()

    @property
    def clock(self) -> Clock:
        """What it shows; while it is stopped, when it was stopped."""
        now = self._now() if self._held is None else self._held
        return Clock(now.wall - self._begin.wall, now.cpu - self._begin.cpu)

    _held: Clock | None = None

    @contextmanager
    def stopped(self) -> Iterator[None]:
        """Do not count what happens inside."""
        self._held = self._now()
        yield
        now = self._now()
        self._begin = Clock(
            self._begin.wall + now.wall - self._held.wall,
            self._begin.cpu + now.cpu - self._held.cpu,
        )
        self._held = None

    @staticmethod
    def _now() -> Clock:
        return Clock(time.perf_counter(), time.process_time())


def _key(cell: Cell, seed: int) -> PRNGKeyArray:
    key = jax.random.fold_in(jax.random.key(seed), cell.horizon)
    return jax.random.fold_in(key, motor.system().index(cell.parameter))


@functools.cache
def _compile(horizon: int, effort: Effort) -> None:
    """Search as short as possible, with everything in it that a whole search compiles."""
    by_us(Cell(STUDIED[0], horizon), 0, effort._replace(rounds=1, polished=1))


if __name__ == "__main__":
    configure()
    main(tyro.cli(Comparison))
