"""Closed-loop and open-loop experiments on the simulated motor, and their evaluation."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from experiments._support.measured_records import differenced_record, printed_record
from experiments._support.pulses import pulses
from experiments.axes import linear_motor as motor
from jaxid._batches import map_in_batches
from jaxid.loop.closed_loop import run
from jaxid.loop.controllers import OpenLoop
from jaxid.loop.disturbances import Sequence
from jaxid.loop.record import Record
from jaxid.loop.sensors import Encoder, IdealSensor
from jaxid.loop.simulate import Plant, Signals, simulate
from jaxid.motion.trajectory import JerkTrajectory, States, reference
from jaxid.regression.estimate import Estimate, least_squares_estimate
from jaxid.regression.filtered_least_squares import filtered_least_squares
from jaxid.regression.filters import adjoint, filtered, low_pass
from jaxid.regression.worst_case import least_squares

PERIODS = 3  # repetitions of the motion, from rest; the regression uses all of them
BANDWIDTHS = (30.0, 50.0, 100.0, 200.0, 300.0, 500.0, 1000.0, 2000.0, 3000.0, 5000.0)  # rad/s
AMPLITUDES = (0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)  # V


class Pulses(NamedTuple):
    """The shape of the open-loop input ±A; chosen, because the paper does not give its impulses."""

    width: float = 0.15  # s
    pause: float = 0.05  # s
    duration: float = 4.0  # s
    start: float = 0.2  # m


class ClosedLoopRun(NamedTuple):
    """One experiment of Section III on the desired motion of one parameter."""

    record: Record
    signals: Signals
    estimate: Estimate


class Sweep(NamedTuple):
    """J_f as a function of the bandwidth w of H_f; every array has one row per bandwidth.

    Attributes:
        exact: J_f of every parameter from exact signals.
        measured: J_f of every parameter from quantised positions and their differences.
        noise: rms value of the first term of (30), H_f applied to ÿ − ÿ*, from exact signals over
            the last repetition of the motion, m/s².
        measured_noise: rms value of the same term with the measured acceleration, m/s².
        lag: rms value of the second term of (30), (H_f − 1) ÿ*, over the last repetition, m/s².
    """

    exact: Float[Array, "w m"]
    measured: Float[Array, "w m"]
    noise: Float[Array, " w"]
    measured_noise: Float[Array, " w"]
    lag: Float[Array, " w"]


class OpenLoopRun(NamedTuple):
    """One experiment with open-loop pulses."""

    signals: Signals
    estimate: Estimate


def closed_loop(trajectory: JerkTrajectory) -> ClosedLoopRun:
    """Return a run of ARC with the encoder; its estimate uses the exact signals, as Table II."""
    record, signals, _ = run(
        motor.plant(), motor.controller(), motor.servo(), trajectory, repeats=PERIODS
    )
    estimate = filtered_least_squares(record, motor.system(), motor.BANDWIDTH, motor.CONTROL_PERIOD)
    return ClosedLoopRun(record, signals, estimate)


def measured(record: Record, signals: Signals) -> Record:
    """Return the record of the same experiment that the positions of the encoder give."""
    position = Encoder(motor.ENCODER_RESOLUTION).quantise(signals.position)
    return differenced_record(motor.system(), record.input, position, motor.CONTROL_PERIOD)


@eqx.filter_jit
def sweep(loop: ClosedLoopRun) -> Sweep:
    """Return J_f for every bandwidth, from one simulation."""
    system, period = motor.system(), motor.CONTROL_PERIOD
    logged = measured(loop.record, loop.signals)
    wanted = loop.signals.reference.acceleration
    last = slice(-(wanted.size // PERIODS), None)

    def rms(signal: Float[Array, " n"]) -> Float[Array, ""]:
        return jnp.sqrt(jnp.mean(signal[last] ** 2))

    def one(w: Float[Array, ""]) -> Sweep:
        exact = least_squares_estimate(filtered(loop.record, w, period), system)
        seen = least_squares_estimate(filtered(logged, w, period), system)
        passed = low_pass(wanted, w, period)
        return Sweep(
            exact.bound,
            seen.bound,
            rms(low_pass(loop.record.rows.columns[0], w, period) - passed),
            rms(low_pass(logged.rows.columns[0], w, period) - passed),
            rms(passed - wanted),
        )

    return jax.vmap(one)(jnp.asarray(BANDWIDTHS))


class Misses(NamedTuple):
    """The number of experiments with θ outside θ̂ ± J_f, for each parameter.

    Attributes:
        exact: number with exact signals, shape (m,).
        printed: number with an encoder and (28) as printed, shape (m,).
        measured: number with an encoder and differences of equal lag in all columns, shape (m,).
        experiments: number of all experiments.
    """

    exact: Int[Array, " m"]
    printed: Int[Array, " m"]
    measured: Int[Array, " m"]
    experiments: int


def misses(
    loop: ClosedLoopRun, trajectory: JerkTrajectory, index: int, count: int, seed: int
) -> Misses:
    """Return how often (29) fails for random plants under a worst-case disturbance.

    The plants are drawn from Ω_θ, and the disturbance is the worst one for parameter `index`.
    """
    keys = jax.random.split(jax.random.key(seed), count)
    return Misses(*_misses(loop.record, trajectory, index, keys), count)


@eqx.filter_jit
def _misses(
    record: Record, trajectory: JerkTrajectory, index: int, keys: Array
) -> tuple[Array, Array, Array]:
    system, period, w = motor.system(), motor.CONTROL_PERIOD, motor.BANDWIDTH
    desired = reference(trajectory, period, record.input.size // PERIODS, PERIODS)
    weights = least_squares(filtered(record, w, period).rows)[index]
    adversary = Sequence(jnp.sign(adjoint(weights, w, period)))

    def one(key: Array) -> Array:
        theta = jax.random.uniform(
            key, system.lower.shape, minval=system.lower, maxval=system.upper
        )
        plant = Plant(system, theta, adversary)
        sensor = Encoder(motor.ENCODER_RESOLUTION)
        found, signals = simulate(plant, motor.controller(), sensor, desired, period)
        position = sensor.quantise(signals.position)
        records = (
            filtered(found, w, period),
            printed_record(system, found.input, position, w, period),
            filtered(measured(found, signals), w, period),
        )
        estimates = [least_squares_estimate(record, system) for record in records]
        # rounding errors of θ̂ do not count as a miss
        outside = [~(jnp.abs(e.theta - theta) <= e.bound * (1 + 1e-9)) for e in estimates]
        return jnp.stack(outside)

    exact, printed, seen = jnp.sum(map_in_batches(one, keys), axis=0)
    return exact, printed, seen


def open_loop(amplitude: float, shape: Pulses = Pulses()) -> OpenLoopRun:
    """Return a run of ±A pulses from mid-travel, with filter and estimator of the closed loop."""
    period = motor.CONTROL_PERIOD
    input = pulses(amplitude, shape.width, shape.pause, shape.duration, period)
    rest = States(jnp.full(input.shape, shape.start), *(jnp.zeros(input.shape),) * 2)
    record, signals = simulate(motor.plant(), OpenLoop(input), IdealSensor(), rest, period)
    return OpenLoopRun(
        signals, filtered_least_squares(record, motor.system(), motor.BANDWIDTH, period)
    )
