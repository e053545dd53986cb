"""Monte Carlo simulation of an axis from a file along a motion: random plants of its prior box."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxid._checks import require
from jaxid._progress import Report, silent
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

SUBSTEPS = 5  # Runge-Kutta steps per period: limits are checked between samples too
DRAWN = 30
_RANDOM = 3  # first plant that is disturbed at random
_SIMULATED = 0.3  # share of the work that is done when all plants are simulated
_PUSH = 10.0  # 1/s: k₁ of the disturbances against tracking


class Simulated(NamedTuple):
    """A Monte Carlo simulation of random plants along a motion; it is evidence, not a proof.

    Attributes:
        axis: axis from a file.
        played: motion that the plants tracked, with the approach from home.
        seed: seed of the random θ and Δ.
        plants: number k of plants.
        excess: largest excess of each limit, by its name, in half-widths, shape (k,); below zero
            the limit is kept.
        drawn: signals of some plants, with plants along the first axis.
        half_widths: half-widths of the intervals from the logs of some plants, shape (logs, m).
        outside: number of these logs with a true parameter outside its interval.
        log: log of the first plant that is disturbed at random, or of the last identified one.
        theta: true parameters of this plant, shape (m,).
    """

    axis: Axis
    played: JerkTrajectory
    seed: int
    plants: int
    excess: dict[str, Float[np.ndarray, " k"]]
    drawn: Signals
    half_widths: Float[np.ndarray, "logs m"]
    outside: int
    log: Log
    theta: Float[np.ndarray, " m"]


def simulate_axis(
    axis: Axis,
    motion: JerkTrajectory,
    plants: int = 200,
    logs: int = 10,
    seed: int = 0,
    report: Report = silent,
) -> Simulated:
    """Simulate random plants of the prior box in closed loop along a motion.

    In turn they are undisturbed, disturbed by `AgainstTracking` with k₁ = 10 and −10 1/s, and
    disturbed at random.

    Args:
        axis: axis from a file with a controller.
        motion: motion to track, after an approach if it does not start at home.
        plants: number of plants.
        logs: number of plants whose logs are also identified.
        seed: seed of the random θ and Δ.
        report: function that is called as each step begins, with its name and the share of the
            work that is done.

    Raises:
        ValueError: if the axis has no controller, or `logs` is not between 1 and `plants`.
    """
    require(1 <= logs <= plants, f"--logs must be from 1 to --plants = {plants}, but is {logs}.")
    whole = played(axis, motion)
    loop = _loop(axis, whole)
    kinds = (NoDisturbance(), AgainstTracking(_PUSH), AgainstTracking(-_PUSH))
    key = jax.random.key(seed)
    scenarios = random_scenarios(key, axis.system, kinds, loop.ticks, plants)
    report(f"{plants} plants", 0.0)
    excess = np.asarray(plant_violations(loop, scenarios, axis.task.limits, whole))
    drawn = _signals(loop, scenarios[np.arange(min(max(logs, DRAWN), plants))], whole)
    kept, lengths, outside = [_log(axis, drawn, k) for k in range(logs)], [], 0
    for k, log in enumerate(kept):
        report(f"intervals from log {k + 1} of {logs}", _SIMULATED + (1 - _SIMULATED) * k / logs)
        found = guaranteed_intervals(axis.system, [log]).estimate
        theta = scenarios.theta[k]
        outside += not bool(jnp.all((found.lower <= theta) & (theta <= found.upper)))
        lengths.append(np.asarray(found.half_widths))
    sides = dict(zip(_sides(axis.task.limits), excess.T, strict=True))
    k = min(_RANDOM, logs - 1)
    one = kept[k], np.asarray(scenarios.theta[k])
    return Simulated(axis, whole, seed, plants, sides, drawn, np.stack(lengths), outside, *one)


def _loop(axis: Axis, motion: JerkTrajectory) -> ClosedLoop:
    return closed_loop(axis.tracking_controller, axis.servo, motion, substeps=SUBSTEPS)


@eqx.filter_jit
def _signals(loop: ClosedLoop, scenarios: Scenarios, motion: JerkTrajectory) -> Signals:
    return scenarios.map(lambda plant: loop(plant, motion)[1])


def _log(axis: Axis, signals: Signals, k: int) -> Log:
    """Return the log of plant k as its servo records it."""
    return axis.servo.log(jax.tree.map(lambda x: x[k], signals))


def _sides(limits: Limits) -> tuple[str, ...]:
    rate = () if limits.input_rate is None else ("input_rate",)
    return ("position", "velocity", "input", *rate)
