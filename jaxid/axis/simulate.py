"""What an axis of a file will do along a motion: random plants of its box, in its closed loop."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxid._checks import require
from jaxid.axis.design import played
from jaxid.axis.file import Axis
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.loop.closed_loop import ClosedLoop, closed_loop, plant_violations
from jaxid.loop.disturbances import AgainstTracking, NoDisturbance
from jaxid.loop.log import Log
from jaxid.loop.scenarios import Scenarios, random_scenarios
from jaxid.loop.simulate import Signals
from jaxid.motion.limits import Limits
from jaxid.motion.trajectory import JerkTrajectory

SUBSTEPS = 5  # Runge-Kutta steps per period: what happens between ticks counts
DRAWN = 30
_PUSH = 10.0  # 1/s: how fast the adversary's position error counts beside its velocity error


class Simulated(NamedTuple):
    """Evidence, no proof: what some plants did.

    Attributes:
        axis: of the file.
        played: what they tracked, from home on.
        seed: of θ and Δ.
        plants: how many.
        excess: beyond each limit at worst, in half-widths; below zero it is kept. Shape (k, sides).
        drawn: signals of some, plants along the first axis.
        half_lengths: of the intervals that the logs of some prove, shape (logs, m).
        outside: how many of them a truth was outside of.
        log: one of them.
    """

    axis: Axis
    played: JerkTrajectory
    seed: int
    plants: int
    excess: dict[str, Float[np.ndarray, " k"]]
    drawn: Signals
    half_lengths: Float[np.ndarray, "logs m"]
    outside: int
    log: Log


def simulate_axis(
    axis: Axis,
    motion: JerkTrajectory,
    plants: int = 200,
    logs: int = 10,
    seed: int = 0,
    tell: Callable[[str], None] = lambda message: None,
) -> Simulated:
    """Random θ of the box, undisturbed, pushed against its tracking, and by random forces in turn.

    Args:
        axis: from a file with a controller.
        motion: to track, after an approach if the axis is elsewhere at home.
        plants: how many.
        logs: of how many what their logs prove is found too.
        seed: of θ and Δ.
        tell: told what goes on.

    Raises:
        ValueError: if the axis has no controller, or there are fewer plants than logs.
    """
    require(1 <= logs <= plants, f"Argument `logs` must be 1 to {plants}, but is {logs}.")
    whole = played(axis, motion)
    loop = _loop(axis, whole)
    kinds = (NoDisturbance(), AgainstTracking(_PUSH), AgainstTracking(-_PUSH))
    key = jax.random.key(seed)
    scenarios = random_scenarios(key, axis.system, kinds, loop.ticks, plants)
    tell(f"{plants} plants")
    excess = np.asarray(plant_violations(loop, scenarios, axis.task.limits, whole))
    drawn = _signals(loop, scenarios[np.arange(min(max(logs, DRAWN), plants))], whole)
    kept, lengths, outside = [_log(axis, drawn, k) for k in range(logs)], [], 0
    for k, log in enumerate(kept):
        tell(f"what log {k + 1} of {logs} proves")
        found = guaranteed_intervals(axis.system, [log]).estimate
        theta = scenarios.theta[k]
        outside += not bool(jnp.all((found.lower <= theta) & (theta <= found.upper)))
        lengths.append(np.asarray(found.half_length))
    sides = dict(zip(_sides(axis.task.limits), excess.T, strict=True))
    return Simulated(axis, whole, seed, plants, sides, drawn, np.stack(lengths), outside, kept[0])


def _loop(axis: Axis, motion: JerkTrajectory) -> ClosedLoop:
    return closed_loop(axis.tracking_controller, axis.servo, motion, substeps=SUBSTEPS)


@eqx.filter_jit
def _signals(loop: ClosedLoop, scenarios: Scenarios, motion: JerkTrajectory) -> Signals:
    return scenarios.map(lambda plant: loop(plant, motion)[1])


def _log(axis: Axis, signals: Signals, k: int) -> Log:
    """Of plant k, as its servo would keep it."""
    return axis.servo.log(jax.tree.map(lambda x: x[k], signals))


def _sides(limits: Limits) -> tuple[str, ...]:
    rate = () if limits.input_rate is None else ("input_rate",)
    return ("position", "velocity", "input", *rate)
