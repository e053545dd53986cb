"""Logs that random motors leave along the designs of the study, disturbed in every way."""

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
# nothing, the motor's own, an independent force at every tick, and at the bound δ two adversaries:
# one of the loop, one of the estimate of one parameter
KINDS = ("none", "cogging and friction", "random", "against the loop", "against an estimate")
SUBSTEPS = 10  # of the plant in a servo period


class Scenario(NamedTuple):
    """One motor on one motion.

    Attributes:
        motion: its place in `MOTIONS`.
        kind: of disturbance, its place in `KINDS`.
        target: the parameter whose estimate the last kind works against.
        theta: the truth, shape (m,).
        key: of the random force.
    """

    motion: Int[Array, ""]
    kind: Int[Array, ""]
    target: Int[Array, ""]
    theta: Float[Array, " m"]
    key: PRNGKeyArray


class Motions(NamedTuple):
    """The motions, stacked; for each the worst share of ±δ for the weights that it foresees."""

    trajectories: JerkTrajectory
    against: Float[Array, "motions m ticks"]


def paths(folder: Path) -> list[Path]:
    """The files of `MOTIONS`."""
    return [trajectory_path(folder, Cell(name, HORIZON)) for name in MOTIONS]


@functools.cache
def read_motions(folder: Path) -> Motions:
    """Those of `MOTIONS`, from the files of the study; read once by a process."""
    motions = [read_trajectory(path) for path in paths(folder)]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *motions)
    return Motions(stacked, jnp.stack([_against(motion) for motion in motions]))


def _against(motion: JerkTrajectory) -> Float[Array, "m ticks"]:
    system = motor.system()
    log = nominal_log(system, motion, motor.servo())
    weights = modulating(guaranteed_intervals(system, [log]).rows, system.half_widths)
    return jnp.sign(jnp.concatenate([weights[:, :1], weights], axis=1))


def mixed(seed: int, number: int) -> Scenario:
    """One of a series: all motions and kinds in turn, θ anywhere in the box."""
    system = motor.system()
    where, force = jax.random.split(jax.random.fold_in(jax.random.key(seed), number))
    share = jax.random.uniform(where, (len(system.names),))
    theta = system.lower + share * (system.upper - system.lower)
    motion, rest = number % len(MOTIONS), number // len(MOTIONS)
    kind, target = rest % len(KINDS), rest // len(KINDS) % len(system.names)
    return Scenario(jnp.asarray(motion), jnp.asarray(kind), jnp.asarray(target), theta, force)


def usual(seed: int, number: int) -> Scenario:
    """The one motion under cogging and friction, θ anywhere in the box."""
    scenario = mixed(seed, number)
    kind = jnp.asarray(KINDS.index("cogging and friction"))
    return scenario._replace(motion=jnp.zeros_like(scenario.motion), kind=kind)


def logs(motions: Motions, scenarios: list[Scenario]) -> list[Log]:
    """What the servo keeps of each; simulated together."""
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

    return jax.vmap(one)(scenarios)
