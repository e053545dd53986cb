"""The designs of Table I, one motion per parameter and horizon, searched by several processes."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PRNGKeyArray

from experiments._support.processes import chained
from experiments.axes import linear_motor as motor
from jaxid.design.criteria import LeastSquaresError
from jaxid.design.optimal_motion import optimal_motion
from jaxid.motion.feasibility import InfeasibleError
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory, uniform
from jaxid.regression.lower_bound import lower_bound
from jaxid.regression.worst_case import infinity
from jaxid.search.effort import Effort

STUDIED = ("M", "B", "Fc")
INFINITY = "infinity"  # target: the largest error relative to the prior box
ONE_MOTION = "one_motion"  # target: the largest predicted error over its lower bound
HORIZON = 30  # horizon of motions other than those of Table I
# targets for the predicted errors of the motion for all parameters, relative to the lower bounds
ALLOWED = (1.06, 1.015, 1.02, 1.01)

# minimal effort, only to show that everything works
TOY = Effort(
    starts=8,
    generations=0,
    stages=2,
    steps=5,
    rounds=1,
    variations=8,
    parents=2,
    finalists=1,
    programs=5,
    searches=1,
    predicted_programs=1,
    predicted_smoothings=(1e-3, 1e-4),
)


@dataclass(frozen=True)
class Cell:
    """One design: its target and its horizon N_i; its motion has 2·N_i intervals."""

    target: str
    horizon: int

    @property
    def intervals(self) -> int:
        """The number of intervals of constant jerk."""
        return 2 * self.horizon

    @property
    def label(self) -> str:
        """The name of the design in a table."""
        return self.target if self.target == ONE_MOTION else f"lse_{self.target}"


@dataclass(frozen=True)
class Found:
    """The result of one search: the jerk of the motion in m/s³, or None with the reason."""

    cell: Cell
    jerk: Float[np.ndarray, " n"] | None
    reason: str = ""

    def trajectory(self) -> JerkTrajectory:
        """Return the motion that was found."""
        assert self.jerk is not None, self.reason
        return uniform(motor.boundary().start, jnp.asarray(self.jerk), motor.KNOT_PERIOD)


def trajectory_path(folder: Path, cell: Cell) -> Path:
    """Return the file of the motion of a cell."""
    if cell == Cell(ONE_MOTION, HORIZON):
        return folder / "trajectory_minimax.csv"
    return folder / f"trajectory_{cell.target}_N{cell.horizon}.csv"


def table_1(horizons: tuple[int, ...]) -> list[list[Cell]]:
    """Return the chains of cells of Table I; each search starts from the motion before it."""
    return [[Cell(name, horizon) for horizon in horizons] for name in reversed(STUDIED)]


def study(horizons: tuple[int, ...]) -> list[list[Cell]]:
    """Return all chains: Table I, and at one horizon two designs for all parameters and d̄."""
    others = [Cell(target, HORIZON) for target in (ONE_MOTION, INFINITY, "dbar")]
    return [*table_1(horizons), *([cell] for cell in others)]


def search(chains: list[list[Cell]], effort: Effort, seed: int, processes: int) -> Iterator[Found]:
    """Yield the results as they are completed; they do not depend on the number of processes."""
    size = max(cell.intervals for chain in chains for cell in chain)
    yield from chained(partial(_search_cell, effort, seed, size), chains, processes)


def _search_cell(effort: Effort, seed: int, size: int, cell: Cell, shorter: Found | None) -> Found:
    system = motor.system()
    task = Task(motor.limits(), motor.boundary(), cell.intervals, motor.KNOT_PERIOD, size=size)
    names = (*system.names, INFINITY, ONE_MOTION)
    key = jax.random.fold_in(jax.random.key(seed), cell.horizon)
    key = jax.random.fold_in(key, names.index(cell.target))
    try:
        if cell.target == ONE_MOTION:
            return Found(cell, np.asarray(one_motion(task, key, effort).jerk))
        target = infinity(system.half_widths) if cell.target == INFINITY else cell.target
        found = optimal_motion(
            task,
            LeastSquaresError(system, target),
            key,
            shorter=shorter.trajectory() if shorter and shorter.jerk is not None else None,
            effort=effort,
        )
    except InfeasibleError as error:
        return Found(cell, None, str(error))
    return Found(cell, np.asarray(found.trajectory.jerk))


def one_motion(task: Task, key: PRNGKeyArray, effort: Effort) -> JerkTrajectory:
    """Return a motion for all parameters, optimal for predicted errors relative to `ALLOWED`."""
    targets = jnp.asarray(ALLOWED) * lower_bound(motor.system(), task.limits).value
    return optimal_motion(task, motor.predicted_error(targets), key, effort=effort).trajectory
