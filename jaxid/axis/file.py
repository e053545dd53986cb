"""An axis in a TOML file.

The file is data. Reading it never runs code, unless the caller permits it.
"""

import hashlib
import importlib.util
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.axis.objects import (
    boundary_of,
    columns_of,
    controller_of,
    limits_of,
    system_of,
    targets_of,
)
from jaxid.axis.schema import AxisTables, whole
from jaxid.axis.tables import read_tables
from jaxid.axis.wording import in_words_of_files
from jaxid.io.recorded import Columns
from jaxid.loop.controllers import Controller
from jaxid.loop.servo import Servo
from jaxid.model.interval_arithmetic import Range
from jaxid.model.system import System
from jaxid.motion.task import Task
from jaxid.motion.trajectory import uniform

PROGRAM = f"jaxid {version('jaxid')}"  # program that writes results


class Axis(NamedTuple):
    """The content of an axis file: model, limits, motion, servo, log columns and controller.

    Attributes:
        system: model of the axis, with prior box and disturbance bound, in the unit of its input.
        task: limits, boundary and duration of the motions, with input limits in the same unit.
        servo: sample period, encoder resolution and delay of the servo.
        gain: unit of the input per unit of the command.
        velocity_error: velocity error of the axis near a jump of δ that a design allows for, m/s or
            rad/s.
        columns: columns of its logs, with the input converted by the gain; None if the file has no
            table [log].
        controller: controller that tracks a motion, in the unit of the input; None if the file has
            no table [controller].
        wanted: required accuracy of each parameter, shape (m,), in their units; inf where the file
            requires none.
        home: position at rest before the approach to the start of a motion, m or rad.
        waiting: number of knot periods of rest at that start.
        digest: SHA-256 of the file, and of the Python module that it names.
    """

    system: System
    task: Task
    servo: Servo
    gain: float
    velocity_error: float
    columns: Columns | None
    controller: Controller | None
    wanted: Float[Array, " m"]
    home: float
    waiting: int
    digest: str

    @property
    def tracking_controller(self) -> Controller:
        """The controller that tracks a motion.

        Raises:
            ValueError: if the file has no table [controller].
        """
        if self.controller is None:
            raise ValueError(
                "The axis file has no table [controller], which a simulation needs; the file that "
                "`jaxid init` writes has an example."
            )
        return self.controller

    def lasting(self, duration: float) -> "Axis":
        """Return the same axis with motions of another duration, in s.

        Raises:
            ValueError: if the duration is not a whole number of knot periods and of sample periods.
        """
        period = self.task.period
        axis = self._replace(
            task=self.task._replace(intervals=whole(duration, period, "the duration"))
        )
        _require_logs(axis.task, axis.servo)
        return axis


def read_axis(path: Path | str, *, run_python: bool = False) -> Axis:
    """Return the axis that a TOML file describes.

    Args:
        path: axis file.
        run_python: run the module that its entry `python` names, if it has one.

    Raises:
        ValueError: if the file is invalid; the message names the file and the entry.
    """
    path = Path(path)
    tables, data = read_tables(path)
    try:
        system = _system(tables, path, run_python)
        return _axis(tables, system, hashlib.sha256(data + _code(tables, path)).hexdigest())
    except ValueError as error:
        raise ValueError(f"File {path}: {in_words_of_files(str(error))}") from None


def _axis(tables: AxisTables, system: System, digest: str) -> Axis:
    limits, motion = limits_of(tables.limits, system, tables.input), tables.motion
    task = Task(limits, boundary_of(motion), motion.intervals, motion.knot_period)
    servo = Servo(tables.servo.period, tables.servo.resolution, tables.input.delay)
    _require_logs(task, servo)
    gain, log, law = tables.input.gain, tables.log, tables.controller
    return Axis(
        system,
        task,
        servo,
        gain,
        tables.servo.velocity_error,
        None if log is None else columns_of(log, tables.coordinate, gain),
        None if law is None else controller_of(law, system),
        targets_of(tables.wanted, system),
        motion.start if motion.home is None else motion.home,
        motion.waiting,
        digest,
    )


def _require_logs(task: Task, servo: Servo) -> None:
    """Raise an error if the servo cannot record a log of the motion."""
    at_rest = uniform(task.boundary.start, jnp.asarray(np.zeros(task.intervals)), task.period)
    servo.ticks(at_rest)


def _system(tables: AxisTables, path: Path, run_python: bool) -> System:
    if tables.python is None:
        return system_of(tables)
    require(
        run_python,
        f"this file refers to Python code ({tables.python}); add --run-python to allow it to run.",
    )
    system = _named(tables.python, path.parent)
    said = (system.coordinate, system.input_unit)
    expected = (tables.coordinate, tables.input.unit)
    require(
        said == expected,
        f"the system of `python` ({tables.python}) must agree with `coordinate` and `input.unit`, "
        f"{expected[0]} and {expected[1]}, but is {said[0]} with an input in {said[1]}.",
    )
    return system


def _code(tables: AxisTables, path: Path) -> bytes:
    """Return the bytes of the module that a file names."""
    if tables.python is None:
        return b""
    return (path.parent / f"{tables.python.partition(':')[0]}.py").read_bytes()


def _named(name: str, folder: Path) -> System:
    """Return the system, or the result of the function, that the name module:object refers to.

    Raises:
        ValueError: if the code cannot be run, or the object is no system.
    """
    module, _, attribute = name.partition(":")
    path = (folder / f"{module}.py").resolve()
    require(
        attribute and module.isidentifier() and path.exists(),
        "`python` must be module:object, with module.py in the folder of the file, but is "
        f"{name!r}.",
    )
    # a unique name: the modules of two axes may have the same one
    own = f"jaxid_axis_{hashlib.sha256(str(path).encode()).hexdigest()}"
    spec = importlib.util.spec_from_file_location(own, path)
    assert spec is not None
    assert spec.loader is not None
    loaded = sys.modules[own] = importlib.util.module_from_spec(spec)
    with _sentences(path):
        spec.loader.exec_module(loaded)
    require(
        hasattr(loaded, attribute),
        f"`python` must be module:object, but {path} has no {attribute!r}.",
    )
    found = getattr(loaded, attribute)
    with _sentences(path):
        system: object = found if isinstance(found, System) or not callable(found) else found()
    if not isinstance(system, System):
        raise ValueError(
            f"`python` must name a jaxid.System, or a function that returns one, but {name} is a "
            f"{type(system).__name__}."
        )
    wide = Range(jnp.zeros(2), jnp.ones(2))
    with _sentences(path):  # user functions must accept traced arrays, with jax.numpy
        columns = jax.eval_shape(system.regressors, *jnp.zeros((3, 2)))
        delta = jax.eval_shape(system.disturbance_bound, *jnp.zeros((2, 2)))
    for name, column in zip(
        (*system.names, "the disturbance bound"), (*columns, delta), strict=True
    ):
        require(
            column is not None and column.shape == (2,),
            f"`python`: the function of {name} must return one number for each pair of position "
            "and velocity, in an array of their shape.",
        )
    with _sentences(path):
        ranges = (*system.regressor_ranges(wide, wide), system.disturbance_bound.range(wide, wide))
    require(
        all(isinstance(found, Range) for found in ranges),
        "`python`: the method `range` of every regressor and of the disturbance bound must return "
        "a Range.",
    )
    return system


@contextmanager
def _sentences(path: Path) -> Iterator[None]:
    """Turn an exception of the user's code into one that names the last line that ran."""
    try:
        yield
    except (Exception, SystemExit) as error:
        lines = [
            f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)
        ]
        where = f" in line {lines[-1]}" if lines else ""
        first = next(iter(str(error).splitlines()), "")
        raised = f"{type(error).__name__}: {first}"
        raise ValueError(
            f"`python`: {path} must run without an error, but{where} raises {raised}."
        ) from error
