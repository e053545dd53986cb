"""The benchmarked function: log J_f (29) of the motor's closed loop on a desired motion."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.axes import linear_motor as motor
from jaxid.design.criteria import FilteredError, ThroughLoop
from jaxid.loop.closed_loop import ClosedLoop
from jaxid.loop.disturbances import NoDisturbance
from jaxid.loop.scenarios import Scenarios
from jaxid.loop.sensors import IdealSensor
from jaxid.model.disturbance_bound import SpeedBand
from jaxid.model.regressors import Coulomb
from jaxid.motion.trajectory import uniform
from jaxid.regression.worst_case import individual

# smoothing as half-way in a design through the closed loop: of corners of (29); of jumps, m/s
SMOOTHING, BLEND = 0.001, 0.002
TARGET = "M"
PER_INTERVAL = round(motor.KNOT_PERIOD / motor.CONTROL_PERIOD)  # sample periods
INTERVALS = 60  # intervals of the motion that is timed: N = 30
TICKS = INTERVALS * PER_INTERVAL


def loop_error(
    jerk: Float[Array, " n"], theta: Float[Array, " m"], repeats: int
) -> Float[Array, ""]:
    """Return the log of the smoothed J_f of TARGET, for `repeats` motions back to back.

    Args:
        jerk: jerk of each interval of the desired motion, m/s³; it starts from rest at zero.
        theta: true parameters; there is no disturbance.
        repeats: number of times that the motion is run.
    """
    system, period = motor.system(), motor.CONTROL_PERIOD
    ticks = jerk.size * PER_INTERVAL
    objective = ThroughLoop(
        ClosedLoop(motor.controller(), IdealSensor(), period, ticks, repeats),
        Scenarios(system, theta[None], NoDisturbance()),
        FilteredError(individual(system.index(TARGET), len(system.names)), motor.BANDWIDTH, period),
        speed=0.0,
        blend=BLEND,
    )
    trajectory = uniform(motor.boundary().start, jerk, motor.KNOT_PERIOD)
    return objective(trajectory, jnp.asarray(SMOOTHING / 2))


class Numbers(NamedTuple):
    """The constants of the same closed loop for C and CasADi, with the names of loop.c."""

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


def numbers(repeats: int, intervals: int = INTERVALS) -> Numbers:
    """Return the constants of the motor, its controller, and a motion of so many intervals."""
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
        intervals=intervals,
        per_interval=PER_INTERVAL,
        repeats=repeats,
    )


def nominal() -> Float[Array, " m"]:
    """Return the centre of the prior box as the true parameters, where they do not matter."""
    return motor.system().centre
