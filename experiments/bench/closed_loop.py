"""What the benchmarks compute: log J_f (29) of the motor's closed loop on a desired motion."""

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

# what a design through the closed loop would use half-way: corners of (29), and jumps in m/s
SMOOTHING, BLEND = 0.001, 0.002
TARGET = "M"
PER_INTERVAL = round(motor.KNOT_PERIOD / motor.CONTROL_PERIOD)  # ticks
INTERVALS = 60  # of the motion that is timed: N = 30
TICKS = INTERVALS * PER_INTERVAL


def loop_error(
    jerk: Float[Array, " n"], theta: Float[Array, " m"], repeats: int
) -> Float[Array, ""]:
    """The library's objective: log of the smoothed J_f of TARGET, `repeats` motions back to back.

    Args:
        jerk: of each interval of the desired motion, m/s³, from rest at zero.
        theta: true parameters; there is no disturbance.
        repeats: how often the motion is run.
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


def numbers(repeats: int, intervals: int = INTERVALS) -> Numbers:
    """Of the motor and its controller, and of a motion of so many intervals."""
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
    """The parameters of the simulated axis where they do not matter: the centre of the box."""
    return motor.system().centre
