"""Simulation of plant, controller and sensor as one `lax.scan`, with exact regression rows."""

import functools
import operator
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxid._types import Scalar, as_array
from jaxid.loop.controllers import Controller
from jaxid.loop.disturbances import Disturbance, Moment
from jaxid.loop.record import Record, Rows
from jaxid.loop.sensors import Sensor
from jaxid.model.system import System, require_parameters
from jaxid.motion.trajectory import States

# Ralston's second-order tableau. All weights b are positive, so that means over a sample period
# satisfy |Δ| ≤ δ too. The accuracy is limited by periods in which friction changes its sign: there
# the classical four stages are no better (both are within 1e-7 m of 40 steps per period) and take
# twice as long. The first stage is at the state that the controller uses, whose friction is known.
NODES = (0.0, 2 / 3)
WEIGHTS = (1 / 4, 3 / 4)


class Plant(eqx.Module):
    """The true axis of a simulation: a system with true parameters and a true disturbance.

    Attributes:
        system: model with prior box and disturbance bound δ.
        theta: true parameters θ, shape (m,), in the units of the parameters.
        disturbance: true disturbance Δ; the simulation clips it to |Δ| ≤ δ.
    """

    system: System
    theta: Float[Array, " m"] = eqx.field(converter=as_array("theta"))
    disturbance: Disturbance

    def __check_init__(self) -> None:
        require_parameters("theta", "a plant", self.theta, self.system)


class Signals(NamedTuple):
    """The signals of a simulated experiment over time.

    Attributes:
        time: start of the experiment and end of every Runge-Kutta step, s.
        position: true position at these times, m or rad.
        velocity: true velocity at these times, m/s or rad/s.
        input: input of each sample period, shape (n,). It is not clipped to any limit.
        reference: desired states at the n samples.
        controller: state of the controller after each sample.
    """

    time: Float[Array, " steps+1"]
    position: Float[Array, " steps+1"]
    velocity: Float[Array, " steps+1"]
    input: Float[Array, " n"]
    reference: States
    controller: Any

    @property
    def counted(self) -> Bool[Array, " n"]:
        """A mask of the samples that take time; the others are padding, shape (n,)."""
        steps = (self.time.size - 1) // self.input.size
        return jnp.diff(self.time[::steps]) > 0


class _Carry(NamedTuple):
    position: Scalar
    velocity: Scalar
    sensor: Any
    controller: Any


class _Tick(NamedTuple):
    positions: tuple[Scalar, ...]
    velocities: tuple[Scalar, ...]
    input: Scalar
    means: tuple[Scalar, ...]
    controller: Any


@eqx.filter_jit
def simulate(
    plant: Plant,
    controller: Controller,
    sensor: Sensor,
    reference: States,
    period: Scalar | float,
    substeps: int = 1,
) -> tuple[Record, Signals]:
    """Simulate the axis along a reference, from rest at the first position of the reference.

    Within a sample period the input is constant and (1) is integrated by Runge-Kutta steps. The
    rows of the record are the means of φ, δ and Δ over the sample period *as these steps form
    them*, so that u = φᵀθ + Δ holds to rounding in every row, at any sample period. (For the motor,
    one step per 0.2 ms gives an error of 1e-6 m.)

    Args:
        plant: true axis.
        controller: controller of the axis.
        sensor: sensor that the controller reads.
        reference: desired states, one per sample, n in all.
        period: sample period of the controller, s.
        substeps: number of Runge-Kutta steps per sample period.

    Returns:
        The exact regression rows with their inputs, and the signals.
    """
    ticks, period = reference.position.size, jnp.asarray(period)

    def tick(carry: _Carry, now: tuple[Array, States]) -> tuple[_Carry, _Tick]:
        index, desired = now
        y, v = carry.position, carry.velocity
        measured, memory = sensor.read(carry.sensor, y, v, period)
        u, state = controller.step(carry.controller, desired, measured, period)
        moment = Moment(index, index * period, y - desired.position, v - desired.velocity)
        ys, vs, means = _hold(plant, moment, y, v, u, period, substeps)
        return _Carry(ys[-1], vs[-1], memory, state), _Tick(ys, vs, u, means, state)

    start = reference.position[0]
    carry = _Carry(start, jnp.zeros_like(start), sensor.initial(start), controller.initial())
    _, after = jax.lax.scan(tick, carry, (jnp.arange(ticks), reference))
    *regressors, delta, disturbance = after.means
    measure = jnp.full(ticks, period)
    record = Record(Rows(tuple(regressors), delta, measure), after.input, disturbance)
    signals = Signals(
        jnp.arange(ticks * substeps + 1) * (period / substeps),
        jnp.append(start, jnp.stack(after.positions, axis=-1)),
        jnp.append(0.0, jnp.stack(after.velocities, axis=-1)),
        after.input,
        reference,
        after.controller,
    )
    return record, signals


def _hold(
    plant: Plant,
    moment: Moment,
    y: Scalar,
    v: Scalar,
    u: Scalar,
    period: Scalar,
    substeps: int,
) -> tuple[tuple[Scalar, ...], tuple[Scalar, ...], tuple[Scalar, ...]]:
    """Return the states after every step of one sample period, and the means of φ, δ, Δ."""
    step = period / substeps
    ys, vs, steps = [], [], []
    for k in range(substeps):
        start = moment._replace(time=moment.time + k * step)
        y, v, means = _runge_kutta(plant, start, y, v, u, step)
        ys.append(y)
        vs.append(v)
        steps.append(means)
    means = tuple(_total(column) / substeps for column in zip(*steps, strict=True))
    return tuple(ys), tuple(vs), means


def _runge_kutta(
    plant: Plant, moment: Moment, y: Scalar, v: Scalar, u: Scalar, step: Scalar
) -> tuple[Scalar, Scalar, tuple[Scalar, ...]]:
    speeds, stages = [], []
    rate, gain = jnp.zeros_like(v), jnp.zeros_like(v)
    for node in NODES:
        at = moment._replace(time=moment.time + node * step)
        # the state itself in the first stage: XLA then computes its friction once for the
        # controller and the plant
        stage_y, stage_v = (y + node * step * rate, v + node * step * gain) if node else (y, v)
        rows = _rows(plant, at, stage_y, stage_v, u)
        rate, gain = stage_v, rows[0]
        speeds.append(rate)
        stages.append(rows)
    means = tuple(_weighted(column) for column in zip(*stages, strict=True))
    return y + step * _weighted(speeds), v + step * means[0], means


def _rows(plant: Plant, moment: Moment, y: Scalar, v: Scalar, u: Scalar) -> tuple[Scalar, ...]:
    """Return φ, δ and Δ at one instant, with the acceleration that (1) gives for u."""
    delta = plant.system.disturbance_bound(y, v)
    disturbance = jnp.clip(plant.disturbance(moment, y, v, delta), -delta, delta)
    acceleration = plant.system.acceleration(y, v, u - disturbance, plant.theta)
    return (*plant.system.regressors(y, v, acceleration), delta, disturbance)


def _weighted(values: Sequence[Scalar]) -> Scalar:
    return _total([b * value for b, value in zip(WEIGHTS, values, strict=True)])


def _total(values: Sequence[Scalar]) -> Scalar:
    # not `sum`: its initial 0 would add one operation to every sample
    return functools.reduce(operator.add, values)
