"""Simulated logs of random motors on the motions of the study, with several disturbances."""

import functools
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from experiments.axes import linear_motor as motor
from experiments.paper.designs import (
    HORIZON,
    INFINITY,
    ONE_MOTION,
    STUDIED,
    Cell,
    trajectory_path,
)
from jaxid._batches import map_in_batches
from jaxid.design.nominal_log import nominal_log
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.identification.modulating_functions import modulating
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import ClosedLoop
from jaxid.loop.disturbances import AgainstTracking, Mixture, Sequence, random_shares
from jaxid.loop.log import Log
from jaxid.loop.simulate import Plant
from jaxid.motion.trajectory import JerkTrajectory, ticks

MOTIONS = (ONE_MOTION, *STUDIED, INFINITY)
# no disturbance, that of the motor, an independent force in every sample period, and two worst-case
# disturbances of magnitude δ: one against tracking, one against the estimate of one parameter
KINDS = ("none", "cogging and friction", "random", "against the loop", "against an estimate")
SUBSTEPS = 10  # Runge-Kutta steps of the plant per sample period


class Scenario(NamedTuple):
    """One simulated motor on one motion.

    Attributes:
        motion: index of the motion in `MOTIONS`.
        kind: index of the kind of disturbance in `KINDS`.
        target: index of the parameter whose estimate the last kind of disturbance acts against.
        theta: true parameters, shape (m,).
        key: JAX key of the random force.
    """

    motion: Int[Array, ""]
    kind: Int[Array, ""]
    target: Int[Array, ""]
    theta: Float[Array, " m"]
    key: PRNGKeyArray


class Motions(NamedTuple):
    """The motions of `MOTIONS`, with the disturbances that are worst for the estimates from them.

    Attributes:
        trajectories: motions, stacked.
        against: worst-case disturbance as a share ±1 of δ, one per sample, for the estimator
            weights that are computed before the log.
    """

    trajectories: JerkTrajectory
    against: Float[Array, "motions m ticks"]


def paths(folder: Path) -> list[Path]:
    """Return the files of the motions in `MOTIONS`."""
    return [trajectory_path(folder, Cell(name, HORIZON)) for name in MOTIONS]


@functools.cache
def read_motions(folder: Path) -> Motions:
    """Return the motions of `MOTIONS` from the files of the study; a process reads them once."""
    motions = [read_trajectory(path) for path in paths(folder)]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *motions)
    return Motions(stacked, jnp.stack([_against(motion) for motion in motions]))


def _against(motion: JerkTrajectory) -> Float[Array, "m ticks"]:
    system = motor.system()
    log = nominal_log(system, motion, motor.servo())
    weights = modulating(guaranteed_intervals(system, [log]).rows, system.half_widths)
    return jnp.sign(jnp.concatenate([weights[:, :1], weights], axis=1))


def mixed(seed: int, number: int) -> Scenario:
    """Return one scenario of a series: motions and kinds in turn, and random θ in the prior box."""
    system = motor.system()
    where, force = jax.random.split(jax.random.fold_in(jax.random.key(seed), number))
    share = jax.random.uniform(where, (len(system.names),))
    theta = system.lower + share * (system.upper - system.lower)
    motion, rest = number % len(MOTIONS), number // len(MOTIONS)
    kind, target = rest % len(KINDS), rest // len(KINDS) % len(system.names)
    return Scenario(jnp.asarray(motion), jnp.asarray(kind), jnp.asarray(target), theta, force)


def usual(seed: int, number: int) -> Scenario:
    """Return one scenario of the motion for all parameters: cogging, friction, random θ."""
    scenario = mixed(seed, number)
    kind = jnp.asarray(KINDS.index("cogging and friction"))
    return scenario._replace(motion=jnp.zeros_like(scenario.motion), kind=kind)


def logs(motions: Motions, scenarios: list[Scenario]) -> list[Log]:
    """Return the logs of some scenarios, which are simulated together."""
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *scenarios)
    count = ticks(jax.tree.map(lambda x: x[0], motions.trajectories), motor.CONTROL_PERIOD)
    found = _logs(motions, stacked, count)
    return [jax.tree.map(lambda x, k=k: x[k], found) for k in range(len(scenarios))]


@eqx.filter_jit
def _logs(motions: Motions, scenarios: Scenario, count: int) -> Log:
    servo, controller = motor.servo(), motor.controller()
    loop = ClosedLoop(controller, servo.sensor, servo.period, count, substeps=SUBSTEPS)

    def one(scenario: Scenario) -> Log:
        motion, against = jax.tree.map(lambda x: x[scenario.motion], motions)
        parts = (
            motor.plant().disturbance,
            random_shares(scenario.key, count),
            AgainstTracking(controller.k1),
            Sequence(against[scenario.target]),
        )
        shares = (jnp.arange(1, len(KINDS)) == scenario.kind).astype(float)
        plant = Plant(motor.system(), scenario.theta, Mixture(parts, shares))
        _, signals = loop(plant, motion)
        return jax.tree.map(jnp.asarray, servo.log(signals))

    return map_in_batches(one, scenarios)
