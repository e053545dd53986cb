"""What the benchmarks compute: log J_f (29) of the motor's closed loop on a desired motion."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid import linear_motor as motor
from jaxid.bound import individual, least_squares, smooth_worst_case_error
from jaxid.disturbance import NoDisturbance
from jaxid.filters import filtered
from jaxid.sensing import IdealSensor
from jaxid.simulate import Plant, simulate
from jaxid.system import Coulomb, Scalar, SpeedBand, System, softened
from jaxid.trajectory import reference, uniform

# what a design through the closed loop would use half-way: corners of (29), and jumps in m/s
SMOOTHING, BLEND = 0.001, 0.002
TARGET = "M"
INTERVALS = 60  # N = 30
TICKS = round(INTERVALS * motor.KNOT_PERIOD / motor.CONTROL_PERIOD)


def softened_system() -> System:
    """The motor with jumps spread over BLEND: the axis and the controller's model of it."""
    return softened(motor.system(), jnp.asarray(BLEND))


def loop_error(
    jerk: Float[Array, " n"], theta: Float[Array, " m"], repeats: int
) -> Float[Array, ""]:
    """Log of the smoothed J_f of the parameter TARGET, after `repeats` motions back to back.

    Args:
        jerk: of the desired motion of INTERVALS intervals, from rest at zero.
        theta: true parameters; there is no disturbance.
        repeats: how often the motion is run.
    """
    system, period = softened_system(), motor.CONTROL_PERIOD
    trajectory = uniform(motor.boundary().start, jerk, motor.KNOT_PERIOD)
    plant = Plant(system, theta, NoDisturbance())
    controller = eqx.tree_at(lambda c: c.system, motor.controller(), system)
    desired = reference(trajectory, period, TICKS, repeats)
    record, _ = simulate(plant, controller, IdealSensor(), desired, period)
    rows = filtered(record, motor.BANDWIDTH, period).rows
    weights = least_squares(rows, individual(system.index(TARGET), len(system.names)))
    return jnp.log(_first(smooth_worst_case_error(weights, rows, jnp.asarray(SMOOTHING))))


class Numbers(NamedTuple):
    """The same loop for those who write it out: C and CasADi. Names as in loop.c."""

    beta: float
    slow: float
    fast: float
    threshold: float
    blend: float
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    k1: float
    k2: float
    epsilon: float
    gamma: tuple[float, ...]
    period: float
    keep: float
    knot_period: float
    smoothing: float
    target: int
    intervals: int
    per_interval: int
    repeats: int


def numbers(repeats: int) -> Numbers:
    """Of the motor and its controller."""
    system, arc = motor.system(), motor.controller()
    friction, delta = system.terms[2].regressor, system.disturbance_bound
    assert isinstance(friction, Coulomb)
    assert isinstance(delta, SpeedBand)
    period = motor.CONTROL_PERIOD
    return Numbers(
        beta=float(friction.beta),
        slow=float(delta.slow),
        fast=float(delta.fast),
        threshold=float(delta.threshold),
        blend=BLEND,
        lower=tuple(system.lower.tolist()),
        upper=tuple(system.upper.tolist()),
        k1=float(arc.k1),
        k2=float(arc.k2),
        epsilon=float(arc.epsilon),
        gamma=tuple(arc.gamma.tolist()),
        period=period,
        keep=float(np.exp(-motor.BANDWIDTH * period)),
        knot_period=motor.KNOT_PERIOD,
        smoothing=SMOOTHING,
        target=system.index(TARGET),
        intervals=INTERVALS,
        per_interval=round(motor.KNOT_PERIOD / period),
        repeats=repeats,
    )


def nominal() -> Float[Array, " m"]:
    """The parameters of the simulated axis where they do not matter: the centre of the box."""
    return motor.system().centre


def _first(errors: Float[Array, "1"]) -> Scalar:
    return errors[0]
