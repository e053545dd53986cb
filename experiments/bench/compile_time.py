"""Compilation times of the design step, once for all horizons, without and with JAX's cache."""

import functools
import multiprocessing
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from experiments._support.processes import pin, processors
from experiments.axes import linear_motor as motor
from experiments.bench.answers import AT_MOST, Answer
from experiments.paper.designs import STUDIED
from jaxid._types import Scalar
from jaxid.design.criteria import PlannedError
from jaxid.motion.motion_space import motion_space
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.worst_case import individual
from jaxid.runtime import configure
from jaxid.search.augmented_lagrangian import descend
from jaxid.search.effort import Effort
from jaxid.search.problem import Problem

QUESTION = "compile_time"


class Found(NamedTuple):
    """Times until one descent step is done, compilation included.

    Attributes:
        first: time of the first design, s.
        others: time of all other designs, s.
        traces: number of times that the objective is traced for the other designs.
    """

    first: float
    others: float
    traces: int


class Traces:
    """A counter of traces that equals no other counter, so that no compiled code is shared."""

    def __init__(self) -> None:
        self.count = 0


class Counted(eqx.Module):
    """An objective that counts how often it is traced."""

    objective: PlannedError
    traces: Traces = eqx.field(static=True)

    def __call__(self, trajectory: JerkTrajectory, smoothing: Scalar) -> Scalar:
        """Return the value of the objective."""
        self.traces.count += 1
        return self.objective(trajectory, smoothing)


def ask(horizons: tuple[int, ...]) -> list[Answer]:
    """Return the times of two new processes: the first fills the cache that the second one uses."""
    with tempfile.TemporaryDirectory() as folder:
        cold, cached = (_in_a_process(functools.partial(steps, folder, horizons)) for _ in range(2))
    case = f"{len(horizons)} horizons, all parameters"
    answer = functools.partial(Answer, QUESTION, case)
    return [
        answer("s, cold, first design", cold.first),
        answer("s, cold, all others", cold.others),
        answer("s, from the cache, first design", cached.first),
        answer("s, from the cache, all others", cached.others),
        answer("traces of the others", float(cold.traces), None, (AT_MOST, 0.0)),
    ]


def steps(folder: str, horizons: tuple[int, ...]) -> Found:
    """Return the times of one descent step for every parameter and horizon, in a new process."""
    pin(processors()[0])
    configure()
    jax.config.update("jax_compilation_cache_dir", folder)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    traces = Traces()
    cells = [(name, horizon) for horizon in horizons for name in STUDIED]
    (first, *others) = cells
    begin = time.perf_counter()
    step(*first, traces)
    middle, before = time.perf_counter(), traces.count
    for cell in others:
        step(*cell, traces)
    return Found(middle - begin, time.perf_counter() - middle, traces.count - before)


def step(name: str, horizon: int, traces: Traces) -> None:
    """Run the step that a design repeats: a stage of the descent, padded to the longest horizon."""
    system, limits, boundary = motor.system(), motor.limits(), motor.boundary()
    norm = individual(system.index(name), len(system.names))
    speed = jnp.max(jnp.abs(limits.velocity))
    objective = Counted(PlannedError(system, norm, speed, 5), traces)
    size = 2 * max(motor.HORIZONS)
    space = motion_space(limits, boundary, 2 * horizon, motor.KNOT_PERIOD, size)
    z = jnp.zeros((Effort().starts, space.basis.shape[1]))
    jax.block_until_ready(descend(Problem(objective, limits, boundary), space, z, 1, 1))


def _in_a_process(action: Callable[[], Found]) -> Found:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(action).result()
