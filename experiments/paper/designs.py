"""Table I: one motion per parameter and horizon, searched in as many processes as asked for."""

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
INFINITY = "infinity"  # the largest error relative to the prior box
ONE_MOTION = "one_motion"  # the largest predicted error relative to its lower bound
HORIZON = 30  # of the motions that are not for one parameter of Table I
# predicted errors of the one motion that are permitted, relative to the lower bounds
ALLOWED = (1.06, 1.015, 1.02, 1.01)

# only shows that everything runs
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
    """One design: what it is for, and its horizon N_i; its motion lasts 2·N_i intervals."""

    target: str
    horizon: int

    @property
    def intervals(self) -> int:
        """Of constant jerk."""
        return 2 * self.horizon

    @property
    def label(self) -> str:
        """Of the design in a table."""
        return self.target if self.target == ONE_MOTION else f"lse_{self.target}"


@dataclass(frozen=True)
class Found:
    """The jerk of a cell's motion; None, and the reason, where there is none."""

    cell: Cell
    jerk: Float[np.ndarray, " n"] | None
    reason: str = ""

    def trajectory(self) -> JerkTrajectory:
        """The motion."""
        assert self.jerk is not None, self.reason
        return uniform(motor.boundary().start, jnp.asarray(self.jerk), motor.KNOT_PERIOD)


def trajectory_path(folder: Path, cell: Cell) -> Path:
    """Where the motion of a cell is kept."""
    if cell == Cell(ONE_MOTION, HORIZON):
        return folder / "trajectory_minimax.csv"
    return folder / f"trajectory_{cell.target}_N{cell.horizon}.csv"


def table_1(horizons: tuple[int, ...]) -> list[list[Cell]]:
    """Chains of cells; in a chain each search starts from the motion of the one before."""
    return [[Cell(name, horizon) for horizon in horizons] for name in reversed(STUDIED)]


def study(horizons: tuple[int, ...]) -> list[list[Cell]]:
    """Table I, and at one horizon all parameters at once, in two ways, and the offset."""
    others = [Cell(target, HORIZON) for target in (ONE_MOTION, INFINITY, "dbar")]
    return [*table_1(horizons), *([cell] for cell in others)]


def search(chains: list[list[Cell]], effort: Effort, seed: int, processes: int) -> Iterator[Found]:
    """The results as they come. They do not depend on how many processes share the work."""
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
    """Good for all parameters at once: its predicted errors compared with what is allowed."""
    targets = jnp.asarray(ALLOWED) * lower_bound(motor.system(), task.limits).value
    return optimal_motion(task, motor.predicted_error(targets), key, effort=effort).trajectory
