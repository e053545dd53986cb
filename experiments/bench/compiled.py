"""The C code of `loop.c` and of CasADi as Python functions, compiled on demand."""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import get_type_hints

import numpy as np
from jaxtyping import Float

from experiments.bench import closed_loop
from jaxid.loop import simulate

SOURCE = Path(__file__).with_name("loop.c")
FLAGS = ("-O3", "-march=native")
FAST_MATH = ("-ffast-math", "-mprefer-vector-width=512")

Vector = Float[np.ndarray, " n"]
Lanes = Float[np.ndarray, "n lanes"]

_DOUBLES = ctypes.POINTER(ctypes.c_double)
_M = 4


class _Case(ctypes.Structure):
    """The struct `Case` of loop.c, with the fields of `Numbers` in their order."""

    _fields_ = tuple(
        (name, ctypes.c_int if kind is int else ctypes.c_double * (_M if kind is not float else 1))
        for name, kind in get_type_hints(closed_loop.Numbers).items()
    )


def compiler() -> str | None:
    """Return the path of the C compiler of this machine, or None if there is none."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def build(source: Path, library: Path, *flags: str) -> Path:
    """Compile one C file into a shared library."""
    tool = compiler()
    assert tool is not None, "there is no C compiler"
    compiled = library.with_suffix(".o")
    # compiled and linked separately, since a library linked with -ffast-math switches off subnormal
    # numbers in the whole process that loads it
    for command in (
        [tool, *FLAGS, *flags, "-fPIC", "-c", str(source), "-o", str(compiled)],
        [tool, "-shared", str(compiled), "-o", str(library), "-lm"],
    ):
        subprocess.run(command, check=True, capture_output=True)
    return library


def loop_library(lanes: int = 1, *flags: str) -> ctypes.CDLL:
    """Return loop.c for a number of parallel loops, with the tableau of `jaxid.loop.simulate`."""
    nodes, weights = (",".join(map(repr, x)) for x in (simulate.NODES, simulate.WEIGHTS))
    defined = (f"-DNODES={nodes}", f"-DWEIGHTS={weights}", f"-DSTAGES={len(simulate.NODES)}")
    with tempfile.TemporaryDirectory() as folder:
        named = (f"-DLANES={lanes}", *defined, "-fopenmp-simd", "-Wno-psabi")
        return ctypes.CDLL(str(build(SOURCE, Path(folder) / "loop.so", *named, *flags)))


class Loop:
    """The closed loop in hand-written C: `loop_error` of several lanes, or of one with gradient."""

    def __init__(
        self,
        repeats: int,
        lanes: int = 1,
        *flags: str,
        intervals: int = closed_loop.INTERVALS,
    ) -> None:
        """Compile loop.c; `flags` beyond -O3 -march=native must be named where times are shown."""
        self._library = loop_library(lanes, *flags)
        numbers = closed_loop.numbers(repeats, intervals)
        self._case = ctypes.byref(_case(numbers))
        ticks = intervals * numbers.per_interval * repeats
        self._value = np.zeros(lanes)
        self._work = np.zeros(ticks * self._library.row_size() * lanes)
        if lanes == 1:
            self._kept = np.zeros(ticks * self._library.kept_size(), np.uint8)
            self._gradient = np.zeros(intervals)

    def value(self, jerk: Lanes | Vector, theta: Lanes | Vector) -> Callable[[], Vector]:
        """Return a function that computes log J of every lane.

        The lane is the last axis of both arguments.
        """
        arguments = [np.ascontiguousarray(x) for x in (jerk, theta)]
        pointers = [_pointer(x) for x in (*arguments, self._work, self._value)]

        def run(arguments: list[np.ndarray] = arguments) -> Vector:
            self._library.loop_value(self._case, *pointers)
            return self._value

        return run

    def value_and_gradient(self, jerk: Vector, theta: Vector) -> Callable[[], tuple[float, Vector]]:
        """Return a function that computes log J of a single loop and its gradient in the jerk."""
        arguments = [np.ascontiguousarray(x) for x in (jerk, theta)]
        pointers = [_pointer(x) for x in (*arguments, self._work)]
        kept = self._kept.ctypes.data_as(ctypes.c_void_p)
        results = [_pointer(x) for x in (self._value, self._gradient)]

        def run(arguments: list[np.ndarray] = arguments) -> tuple[float, Vector]:
            self._library.loop_value_and_gradient(self._case, *pointers, kept, *results)
            return float(self._value[0]), self._gradient

        return run


def _pointer(array: np.ndarray) -> object:
    return array.ctypes.data_as(_DOUBLES)


def _case(numbers: closed_loop.Numbers) -> _Case:
    case = _Case()
    for name, value in numbers._asdict().items():
        if isinstance(value, int):
            setattr(case, name, value)
        else:
            getattr(case, name)[:] = value if isinstance(value, tuple) else (value,)
    return case
