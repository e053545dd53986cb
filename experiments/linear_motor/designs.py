"""Table I: one motion per parameter and horizon, searched in as many processes as asked for."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.processes import chained
from jaxid import linear_motor as motor
from jaxid.bound import infinity
from jaxid.design import Effort
from jaxid.experiment import design_motion
from jaxid.feasible import InfeasibleError
from jaxid.problem import Task
from jaxid.trajectory import JerkTrajectory, uniform

INFINITY = "infinity"
STUDIED = ("M", "B", "Fc")

# only shows that everything runs
TOY = Effort(
    starts=8,
    generations=0,
    stages=2,
    steps=5,
    rounds=1,
    variations=8,
    parents=2,
    polished=1,
    polish_steps=5,
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
    return folder / f"trajectory_{cell.target}_N{cell.horizon}.csv"


def table_1(horizons: tuple[int, ...]) -> list[list[Cell]]:
    """Chains of cells; in a chain each search starts from the motion of the one before."""
    return [[Cell(name, horizon) for horizon in horizons] for name in reversed(STUDIED)]


def study(horizons: tuple[int, ...]) -> list[list[Cell]]:
    """Table I, and at one horizon the full ∞ norm and the offset."""
    return [*table_1(horizons), [Cell(INFINITY, 30)], [Cell("dbar", 30)]]


def search(chains: list[list[Cell]], effort: Effort, seed: int, processes: int) -> Iterator[Found]:
    """The results as they come. They do not depend on how many processes share the work."""
    size = max(cell.intervals for chain in chains for cell in chain)
    yield from chained(partial(_search_cell, effort, seed, size), chains, processes)


def _search_cell(effort: Effort, seed: int, size: int, cell: Cell, shorter: Found | None) -> Found:
    system = motor.system()
    names = (*system.names, INFINITY)
    key = jax.random.fold_in(jax.random.key(seed), cell.horizon)
    try:
        found = design_motion(
            system,
            Task(motor.limits(), motor.boundary(), cell.intervals, motor.KNOT_PERIOD, size=size),
            infinity(system.half_widths) if cell.target == INFINITY else cell.target,
            jax.random.fold_in(key, names.index(cell.target)),
            shorter=shorter.trajectory() if shorter and shorter.jerk is not None else None,
            effort=effort,
        )
    except InfeasibleError as error:
        return Found(cell, None, str(error))
    return Found(cell, np.asarray(found.trajectory.jerk))
