"""An axis in a TOML file: what an engineer knows of hers.

The file is data. It never runs code, whatever is in it, unless who reads it allows that.
"""

import hashlib
import importlib.util
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import msgspec
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.axis.schema import AxisTables, Coordinate, whole
from jaxid.io.log_file import Columns
from jaxid.loop.controllers import Controller
from jaxid.loop.servo import Servo
from jaxid.model.system import System
from jaxid.motion.task import Task
from jaxid.motion.trajectory import uniform

PROGRAM = f"jaxid {version('jaxid')}"  # that wrote a result


class Axis(NamedTuple):
    """What a file says.

    Attributes:
        system: in the unit of its input.
        task: its limits in that unit too.
        servo: its sample period, encoder and delay.
        gain: unit of the input per unit of what is commanded.
        velocity_error: of the axis near a jump of δ, m/s or rad/s, that a design allows for.
        columns: of its logs, if the file says; the input converted by the gain.
        controller: that tracks a motion, if the file says; in the unit of the input.
        wanted: how small the errors of the parameters should be, in their units; inf where the
            file does not say.
        home: where it rests before it is moved to the start of a motion, m or rad.
        waiting: knot periods of rest at that start.
        digest: SHA-256 of the file, and of the module that it names.
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
        """What tracks a motion.

        Raises:
            ValueError: if the file has no controller.
        """
        if self.controller is None:
            raise ValueError("Argument `axis` must have a table [controller] to track a motion.")
        return self.controller

    def lasting(self, duration: float) -> "Axis":
        """The same axis with motions of another duration, s."""
        period = self.task.period
        axis = self._replace(task=self.task._replace(intervals=whole(duration, period, "a motion")))
        _require_logs(axis.task, axis.servo)
        return axis


def read_axis(path: Path, *, run_python: bool = False) -> Axis:
    """The axis in a file.

    Args:
        path: of the file.
        run_python: run the module that its entry `python` names, if it has one.

    Raises:
        ValueError: if the file is not one, in a sentence that names it and the entry.
    """
    data = path.read_bytes()
    try:
        tables = msgspec.toml.decode(data, type=AxisTables)
        system = _system(tables, path, run_python)
        return _axis(tables, system, hashlib.sha256(data + _code(tables, path)).hexdigest())
    except (msgspec.DecodeError, UnicodeDecodeError, ValueError) as error:
        raise ValueError(f"File {path}: {str(error).replace('`$.', '`')}") from None


def example(coordinate: Coordinate) -> str:
    """A file to begin with, its entries explained."""
    return (resources.files("jaxid.axis") / "templates" / f"{coordinate}.toml").read_text()


def _axis(tables: AxisTables, system: System, digest: str) -> Axis:
    limits, motion = tables.limits.of(system, tables.input), tables.motion
    task = Task(limits, motion.boundary(), motion.intervals, motion.knot_period)
    servo = Servo(tables.servo.period, tables.servo.resolution, tables.input.delay)
    _require_logs(task, servo)
    gain, log, law = tables.input.gain, tables.log, tables.controller
    return Axis(
        system,
        task,
        servo,
        gain,
        tables.servo.velocity_error,
        None if log is None else log.columns(tables.coordinate, gain),
        None if law is None else law.controller(system),
        tables.targets(system),
        motion.start if motion.home is None else motion.home,
        motion.waiting,
        digest,
    )


def _require_logs(task: Task, servo: Servo) -> None:
    """Refuse a servo that no log of a motion can be kept with."""
    at_rest = uniform(task.boundary.start, jnp.zeros(task.intervals), task.period)
    servo.ticks(at_rest)


def _system(tables: AxisTables, path: Path, run_python: bool) -> System:
    if tables.python is None:
        return tables.system()
    require(
        run_python,
        f"it names the Python code {tables.python}, which runs only if you allow it: --run-python.",
    )
    system = _named(tables.python, path.parent)
    said = (system.coordinate, system.input_unit)
    expected = (tables.coordinate, tables.input.unit)
    require(
        said == expected,
        f"the axis of {tables.python} must be {expected[0]} with an input in {expected[1]} like "
        f"the file, but is {said[0]} with one in {said[1]}.",
    )
    return system


def _code(tables: AxisTables, path: Path) -> bytes:
    """Of the module that a file names."""
    if tables.python is None:
        return b""
    return (path.parent / f"{tables.python.partition(':')[0]}.py").read_bytes()


def _named(name: str, folder: Path) -> System:
    """The system, or what a function without arguments returns, under a name module:object.

    Code that cannot be run is refused in a sentence like all that is wrong with a file.
    """
    module, _, attribute = name.partition(":")
    path = (folder / f"{module}.py").resolve()
    require(
        attribute and module.isidentifier() and path.exists(),
        f"`python` must name a module:object, the module beside the file, but is {name!r}.",
    )
    # under a name of its own: two axes may call theirs alike
    own = f"jaxid_axis_{hashlib.sha256(str(path).encode()).hexdigest()}"
    spec = importlib.util.spec_from_file_location(own, path)
    assert spec is not None
    assert spec.loader is not None
    loaded = sys.modules[own] = importlib.util.module_from_spec(spec)
    with _sentences(path):
        spec.loader.exec_module(loaded)
    require(
        hasattr(loaded, attribute),
        f"`python` must name a module:object, but {path} has no {attribute!r}.",
    )
    found = getattr(loaded, attribute)
    with _sentences(path):
        system: object = found if isinstance(found, System) or not callable(found) else found()
    if not isinstance(system, System):
        raise ValueError(
            f"`python` must name a jaxid.System, but {name} is a {type(system).__name__}."
        )
    with _sentences(path):  # functions of its own must take arrays, whose values are not known yet
        jax.eval_shape(system.regressors, *jnp.zeros((3, 2)))
        jax.eval_shape(system.disturbance_bound, *jnp.zeros((2, 2)))
    return system


@contextmanager
def _sentences(path: Path) -> Iterator[None]:
    """What somebody's code raises, with the last line of it that ran."""
    try:
        yield
    except (Exception, SystemExit) as error:
        lines = [
            f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)
        ]
        where = f" in line {lines[-1]}" if lines else ""
        raised = f"{type(error).__name__}: {error}"
        raise ValueError(
            f"`python`: {path} must run by itself, but{where} raises {raised}."
        ) from error
