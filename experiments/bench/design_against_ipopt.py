"""The design search compared with IPOPT's best of ten starts: J* and the time to reach it.

Both searches of a cell run one after the other in one process that is bound to one processor, and
two such processes run in parallel. Compilation before the first iteration is not counted: that of
the design search once per horizon (a shorter search runs first; padding would share one
compilation, but then short motions take as long as long ones), that of IPOPT's functions once per
cell.
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
from jaxid.io.text_tables import text_table
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

STARTS = 10  # starts of IPOPT
SEARCHES = 4  # design searches: together they take up to three times as long as IPOPT's ten starts
# down to a smoothing as small as IPOPT's: with 1e-4 as the last, J of M at N = 30 stays 8e-7 above
SMOOTHINGS = (0.0006, 0.0001, 0.00001)
SHORTER = 10  # difference to the horizon of the motion that a search starts from
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
        """Return the cell of a label."""
        parameter, horizon = label.rsplit("_", 1)
        return cls(parameter, int(horizon))

    @property
    def label(self) -> str:
        """The name of the piece of work for this cell."""
        return f"{self.parameter}_{self.horizon}"

    @property
    def intervals(self) -> int:
        """The number of intervals of constant jerk."""
        return 2 * self.horizon


class Clock(NamedTuple):
    """Wall time and processor time, s."""

    wall: float
    cpu: float


class Mark(NamedTuple):
    """J of an admissible motion, and the time when it was found."""

    error: float
    clock: Clock


@dataclass(frozen=True)
class Comparison:
    """Both searches on the feasible cells of Table I; a stopped run continues.

    Attributes:
        out: folder for bench_design.csv.
        seed: seed of all starts.
        processes: number of cells that are searched in parallel.
        toy: run two starts and one stage, only to show that everything works.
    """

    out: Path = Path("figures")
    seed: int = 0
    processes: int = 2
    toy: bool = False

    @property
    def path(self) -> Path:
        """The file of the table."""
        return self.out / "bench_design.csv"


def main(comparison: Comparison) -> None:
    """Search all cells, save each as soon as it is done, and write and print the table."""
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
    """Return the table row of a cell; None stands for a value that was not reached."""
    values = {name: None if np.isnan(x) else float(x) for name, x in numbers.items()}
    return {"parameter": cell.parameter, "N": cell.horizon, **values}


def verdicts(rows: list[Row]) -> list[str]:
    """Return a sentence on each of the two targets."""
    better = sum(float(row["ours_over_ipopt"] or 2) <= 1 for row in rows)
    sooner = sum(float(row["share_of_wall"] or 2) <= 0.25 for row in rows)
    return [
        f"J* is at or below IPOPT's in {better} of {len(rows)} cells (target: all).",
        f"IPOPT's best reached in a quarter of its time in {sooner} of {len(rows)} (target: all).",
    ]


def compare(seed: int, toy: bool, label: str) -> dict[str, np.ndarray]:
    """Return the numbers of a cell from both searches; IPOPT runs first."""
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
    """Return J of the result of every start, restored to the exact limits, and the total time."""
    problem = _problem(cell)
    inside = interior(problem.limits, problem.boundary, cell.intervals, motor.KNOT_PERIOD)
    stopwatch, marks = Stopwatch(), []
    for jerk in begin:
        found = uniform(problem.boundary.start, jnp.asarray(solve(jerk)), motor.KNOT_PERIOD)
        with stopwatch.stopped():
            marks.append(Mark(error(cell, restored(problem, inside, found)), stopwatch.clock))
    return marks, stopwatch.clock


def by_us(cell: Cell, seed: int, effort: Effort) -> tuple[list[Mark], Clock]:
    """Return J after every descent and refinement of several design searches, and the total time.

    The first descent decides which J a search can reach. All searches but the first one therefore
    start, as those of Table I do, from a motion for a shorter horizon, whose search time counts
    too. If the shorter horizon is infeasible, they start from other random numbers.
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
    """Return the problem with a coarse grid, which is enough for starts and limits."""
    system = motor.system()
    norm = individual(system.index(cell.parameter), len(system.names))
    objective = PlannedError(system, norm, jnp.asarray(1.0), 1)
    return Problem(objective, motor.limits(), motor.boundary())


def starts(cell: Cell, seed: int, count: int) -> list[Jerk]:
    """Return jerks as starts for IPOPT: half random, half with constant speeds in random order."""
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
    """Return J* of the parameter that a cell is designed for, with the exact δ."""
    return float(planned_error(motor.system(), trajectory)[motor.system().index(cell.parameter)])


class Stopwatch:
    """A stopwatch of wall time and processor time that can be paused."""

    def __init__(self) -> None:
        self._begin = self._now()

    @property
    def clock(self) -> Clock:
        """The time on the stopwatch; while it is paused, the time at the pause."""
        now = self._now() if self._held is None else self._held
        return Clock(now.wall - self._begin.wall, now.cpu - self._begin.cpu)

    _held: Clock | None = None

    @contextmanager
    def stopped(self) -> Iterator[None]:
        """Pause the stopwatch for the duration of the context."""
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
    """Run a short search that compiles everything that a whole search does."""
    by_us(Cell(STUDIED[0], horizon), 0, effort._replace(rounds=1, polished=1))


if __name__ == "__main__":
    configure()
    main(tyro.cli(Comparison))
