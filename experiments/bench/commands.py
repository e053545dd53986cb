"""The waiting time of a user: CPU seconds of every command, on the first run and on the next one.

Each command runs in new processes: first with an empty cache of compiled code, then again with that
cache and other numbers of the same size. CPU seconds depend on the machine, so that they are scaled
to one on which a step of the hand-written C loop takes 140 ns; this loop is timed beside them.
"""

import functools
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.bench import compiled, user_files
from experiments.bench.answers import AT_MOST, Answer
from experiments.bench.closed_loop import TICKS, nominal
from experiments.bench.loop_against_c import motion
from experiments.bench.timing import timed
from jaxid.runtime import configure

QUESTION = "commands"
REFERENCE = 140.0  # ns: a step of the C loop on the machine that targets are given for
_PROGRAM = "import sys; from jaxid.axis.cli import main; sys.exit(main(sys.argv[1:]))"
_PROJECT = Path(__file__).parents[2]
_REPETITIONS = 50  # of the C loop, before and after every command


class Command(NamedTuple):
    """A command or program whose time is measured.

    Attributes:
        case: description of the case.
        words: function that writes the files of the case to a folder and returns the arguments of
            `jaxid`; its second argument is 0 for the first run and 1 for the next one.
        first: target of the first run, CPU s on the reference machine.
        again: target of the next run, CPU s on the reference machine.
        program: first arguments of Python; default the command `jaxid`.
        here: whether it runs in the project's folder, instead of that of the files.
    """

    case: str
    words: Callable[[Path, int], Sequence[str]]
    first: float
    again: float
    program: Sequence[str] = ("-c", _PROGRAM)
    here: bool = False


MEASURED = (
    Command("--help", lambda folder, run: ("--help",), 0.5, 0.5),
    Command("a typo in an axis file", user_files.typo, 0.5, 0.5),
    Command("identify, 3,000 rows, 4 terms", functools.partial(user_files.log, rows=3_000), 10, 3),
    Command("identify, 20,000 rows", functools.partial(user_files.log, rows=20_000), 25, 12),
    Command("identify, 7 pieces of 6,000 rows", user_files.pieces, 25, 8),
    Command("prior, 6,600 rows, 5 terms", user_files.prior, 20, 6),
    Command("design quick, 4 terms", user_files.quick_design, 25, 8),
    Command("design usual, 5 terms", user_files.usual_design, 90, 60),
    Command("simulate, 200 axes, 10 logs", user_files.simulate, 20, 8),
    Command("make reproduce", user_files.reproduction, 240, 200, ("-m", "experiments.paper"), True),
    Command("make test", user_files.tests, 1_200, 500, ("-m", "pytest"), True),
)
SUITES = tuple(command.case for command in MEASURED if command.here)
COMMANDS = tuple(command.case for command in MEASURED if not command.here)


def ask(cases: Sequence[str], available: Sequence[int]) -> list[Answer]:
    """Return the CPU seconds of some commands on the reference machine, first and again.

    They run from a new process, which is not bound to one processor as this one is.

    Args:
        cases: descriptions of cases.
        available: processors that they may use.
    """
    if compiled.compiler() is None:
        return []
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, _begin, (tuple(available),)) as pool:
        return [answer for case in cases for answer in pool.submit(measured, case).result()]


def _begin(available: tuple[int, ...]) -> None:
    """Let this process use all processors, and set it up to make files."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, available)
    configure()


def measured(case: str) -> list[Answer]:
    """Return the CPU seconds of one command on the reference machine, first and again."""
    (command,) = (one for one in MEASURED if one.case == case)
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "cache"
        times = []
        for run in range(2):
            place = Path(folder) / str(run)
            place.mkdir()
            words = command.words(place, run)
            before = step_of_c()
            place = _PROJECT if command.here else place
            spent = cpu_seconds((*command.program, *words), place, cache)
            times.append(spent * REFERENCE / min(before, step_of_c()))
    return [
        Answer(QUESTION, command.case, f"CPU s, {name}", time, None, (AT_MOST, target))
        for name, time, target in zip(
            ("first", "again"), times, (command.first, command.again), strict=True
        )
    ]


def cpu_seconds(words: Sequence[str], folder: Path, cache: Path) -> float:
    """Return the CPU seconds of a Python program and of all processes that it starts.

    Args:
        words: arguments of Python.
        folder: folder in which it runs.
        cache: folder for compiled code.
    """
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    process = subprocess.Popen(
        [sys.executable, *words],
        cwd=folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, _, used = os.wait4(process.pid, 0)
    return used.ru_utime + used.ru_stime


def step_of_c() -> float:
    """Return the time of a step of the hand-written C loop, ns: the least of some repetitions."""
    action = _c_loop()
    return 1e9 * min(timed(action) for _ in range(_REPETITIONS)) / TICKS


@functools.cache
def _c_loop() -> Callable[[], object]:
    return compiled.Loop(1, 1).value(motion(), np.asarray(nominal()))
