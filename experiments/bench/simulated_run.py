"""The time of `jaxid.run`, as a user calls it first, compared with hand-written C.

The call has 3,000 sample periods of one plant, with the reference, all signals and the log. The
process sets nothing but double precision, so that XLA has its default options. The loop in C has
the same controller and axis with an exact sensor, and ends with log J_f instead of the signals.
"""

import multiprocessing
import os
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor

import jax
import numpy as np

import jaxid
from experiments._support.processes import pin, processors
from experiments.axes import linear_motor as motor
from experiments.bench.answers import AT_MOST, Answer, compared, per_step
from experiments.bench.closed_loop import TICKS, nominal
from experiments.bench.loop_against_c import MOTION, c_actions
from experiments.bench.timing import Action, Times, interleaved
from jaxid.io.files import read_trajectory
from jaxid.loop.disturbances import NoDisturbance

QUESTION = "simulated_run"
CASE = f"{TICKS} ticks, default options"
TARGET = (AT_MOST, 2.14)  # 300 ns a step where loop.c takes 140 ns


def ask(repetitions: int) -> list[Answer]:
    """Return the nanoseconds per sample period of `jaxid.run`, and their ratio to loop.c."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        times = pool.submit(_in_new_process, processors()[0], repetitions).result()
    return answers(times)


def answers(times: Mapping[str, Times]) -> list[Answer]:
    """Return the ratio with its target, if there is a C compiler, and the times."""
    found = [per_step(QUESTION, f"{CASE}, {name}", one, TICKS) for name, one in times.items()]
    if "c value" in times:
        pair = times["run"], times["c value"]
        found.append(compared(QUESTION, CASE, "run / C", pair, TARGET))
    return found


def actions() -> dict[str, Action]:
    """Return `jaxid.run` of the motor, and loop.c if there is a C compiler."""
    plant = jaxid.Plant(motor.system(), np.asarray(nominal()), NoDisturbance())
    controller, servo, motion = motor.controller(), motor.servo(), read_trajectory(MOTION)
    run: dict[str, Action] = {"run": lambda: jaxid.run(plant, controller, servo, motion)}
    return run | {name: one for name, one in c_actions(1).items() if name == "c value"}


def _in_new_process(processor: int, repetitions: int) -> dict[str, Times]:
    os.environ.pop("XLA_FLAGS", None)  # those that this process's parent has set for itself
    pin(processor)
    jax.config.update("jax_enable_x64", True)
    return interleaved(actions(), repetitions)
