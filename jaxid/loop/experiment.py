"""One simulated experiment, from plant, controller, servo and motion to the log."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jaxid._checks import is_concrete, require_float64
from jaxid._folding import is_traced, one_kernel
from jaxid.loop.controllers import Controller, delayed
from jaxid.loop.log import Log
from jaxid.loop.record import Record
from jaxid.loop.sensors import Encoder, Sensor
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant, Signals, simulate
from jaxid.motion.trajectory import JerkTrajectory, reference

_ARRAYS = (jax.Array, np.ndarray, np.generic)


class Run(NamedTuple):
    """The result of one simulated experiment.

    Attributes:
        record: exact rows of u = φᵀθ + Δ, one per sample period, with their inputs.
        signals: true states of the axis, inputs and reference over time.
        log: log of inputs and encoder positions that the servo records.
    """

    record: Record
    signals: Signals
    log: Log


class _Numbers(NamedTuple):
    """The numbers of a servo, as arrays."""

    period: Any
    resolution: Any
    jitter: Any


class _Experiment(NamedTuple):
    """The arguments of `run` that JAX traces; without a sensor, it is the encoder of the servo."""

    plant: Plant
    controller: Controller
    sensor: Sensor | None
    trajectory: JerkTrajectory
    servo: _Numbers


class _Options(NamedTuple):
    """The arguments of `run` that are part of the compiled program.

    Attributes:
        ticks: number of samples of the motion, run once.
        repeats: number of times that the motion is run.
        substeps: number of Runge-Kutta steps per sample period.
        delay: number of sample periods from a command until it acts.
        exact: true if the resolution of the servo is zero, so that its log has a derivative.
        final: true if JAX does not trace the call, and so will not transform the program.
    """

    ticks: int
    repeats: int
    substeps: int
    delay: int
    exact: bool
    final: bool


@functools.partial(jax.jit, static_argnums=0)
def _run(
    static: tuple[Any, tuple[Any, ...], _Options], arrays: list[Array]
) -> tuple[Run, Int[Array, ""]]:
    """Return the result of an experiment, and the first sample whose input is not finite.

    Together they are one program, and one kernel where possible, since the start of each program
    takes as long as hundreds of samples.

    Args:
        static: structure of an `_Experiment`, its leaves that are no arrays, and the options.
        arrays: its other leaves.
    """
    structure, others, options = static
    remaining = iter(arrays)
    leaves = [next(remaining) if other is None else other for other in others]
    made: _Experiment = jax.tree.unflatten(structure, leaves)
    found = functools.partial(_found, options=options)
    return one_kernel(found, made) if options.final else found(made)


def _found(made: _Experiment, options: _Options) -> tuple[Run, Int[Array, ""]]:
    """Return the result of an experiment, and the first sample whose input is not finite."""
    period, resolution, jitter = made.servo
    encoder = Encoder(resolution)
    sensor = encoder if made.sensor is None else made.sensor
    controller = delayed(made.controller, options.delay)
    desired = reference(made.trajectory, period, options.ticks, options.repeats)
    record, signals = simulate(made.plant, controller, sensor, desired, period, options.substeps)
    position = signals.position[:: options.substeps]
    read = position if options.exact else encoder.quantise(position)
    log = Log(signals.input, read, period, resolution, jitter)
    count = signals.input.size
    wrong = jnp.where(jnp.isfinite(signals.input), count, jnp.arange(count))
    return Run(record, signals, log), jnp.min(wrong)


def _is_float64(leaf: Any) -> bool:
    """Return whether a leaf is surely no number of less than double precision."""
    return getattr(leaf, "dtype", None) == np.float64


def simulated(
    plant: Plant,
    controller: Controller,
    servo: Servo,
    trajectory: JerkTrajectory,
    sensor: Sensor | None,
    repeats: int,
    substeps: int,
) -> Run:
    """Return the result of `jaxid.run`, which describes the arguments."""
    # NumPy, since a Python float would be part of the program, and compiled anew for every value
    numbers = _Numbers(*map(np.asarray, (servo.period, servo.resolution, servo.jitter)))
    made = _Experiment(plant, controller, sensor, trajectory, numbers)
    leaves, structure = jax.tree.flatten(made)
    if not all(map(_is_float64, leaves)):
        require_float64(plant=plant, controller=controller, sensor=sensor, trajectory=trajectory)
    options = _Options(
        servo.ticks(trajectory),
        repeats,
        substeps,
        servo.delay,
        exact=servo.resolution == 0,
        final=not is_traced(),
    )
    # not `filter_jit`, which takes as long as 600 samples
    arrays = [leaf for leaf in leaves if isinstance(leaf, _ARRAYS)]
    others = tuple(None if isinstance(leaf, _ARRAYS) else leaf for leaf in leaves)
    found, lost = _run((structure, others, options), arrays)
    if is_concrete(lost) and lost < found.log.input.size:
        raise ValueError(
            "The closed loop diverges: its input is not finite from "
            f"{servo.period * int(lost):g} s on. Lower the gains of `controller`, or shorten the "
            "sample period."
        )
    return found
