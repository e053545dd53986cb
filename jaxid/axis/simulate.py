"""What an axis of a file will do along a motion: random plants of its box, in its closed loop."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.axis.design import played
from jaxid.axis.file import PROGRAM, Axis
from jaxid.identification.intervals import assumptions, identify_log
from jaxid.io import plots
from jaxid.io.files import UNITS, write_json
from jaxid.loop.closed_loop import Loop, plant_violations
from jaxid.loop.disturbances import AgainstTracking, NoDisturbance
from jaxid.loop.log import Log
from jaxid.loop.scenarios import Scenarios, random_scenarios
from jaxid.loop.sensors import Encoder
from jaxid.loop.simulate import Signals
from jaxid.motion.limits import Limits
from jaxid.motion.trajectory import JerkTrajectory, ticks

FILES = ("simulation.json", "simulation.png")
_SUBSTEPS = 5  # Runge-Kutta steps per period: what happens between ticks counts
_DRAWN = 30
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
    drawn = _signals(loop, scenarios[np.arange(min(max(logs, _DRAWN), plants))], whole)
    kept, lengths, outside = [_log(axis, drawn, k) for k in range(logs)], [], 0
    for k, log in enumerate(kept):
        tell(f"what log {k + 1} of {logs} proves")
        found = identify_log(axis.system, log).estimate
        theta = scenarios.theta[k]
        outside += not bool(jnp.all((found.lower <= theta) & (theta <= found.upper)))
        lengths.append(np.asarray(found.half_length))
    sides = dict(zip(_sides(axis.task.limits), excess.T, strict=True))
    return Simulated(axis, whole, seed, plants, sides, drawn, np.stack(lengths), outside, kept[0])


def _loop(axis: Axis, motion: JerkTrajectory) -> Loop:
    period = axis.servo.period
    return Loop(axis.law, axis.sensor, period, ticks(motion, period), substeps=_SUBSTEPS)


@eqx.filter_jit
def _signals(loop: Loop, scenarios: Scenarios, motion: JerkTrajectory) -> Signals:
    return scenarios.map(lambda plant: loop(plant, motion)[1])


def _log(axis: Axis, signals: Signals, k: int) -> Log:
    """Of plant k, as its servo would keep it."""
    resolution = axis.servo.resolution
    read = Encoder(resolution).quantise(signals.position[k, ::_SUBSTEPS])
    return Log(signals.input[k], read, axis.servo.period, resolution)


def _sides(limits: Limits) -> tuple[str, ...]:
    rate = () if limits.input_rate is None else ("input_rate",)
    return ("position", "velocity", "input", *rate)


def write_simulated(folder: Path, found: Simulated) -> None:
    """Write `FILES`."""
    write_json(folder / FILES[0], summary(found))
    page(folder / FILES[1], found)


def summary(found: Simulated) -> dict[str, Any]:
    """For other programs."""
    system = found.axis.system
    lengths = np.median(found.half_lengths, axis=0), np.max(found.half_lengths, axis=0)
    return {
        "program": PROGRAM,
        "axis_sha256": found.axis.digest,
        "seed": found.seed,
        "plants": found.plants,
        "limits": {
            name: {"beyond": int(np.sum(worst > 0)), "least_margin": -float(np.max(worst))}
            for name, worst in found.excess.items()
        },
        "logs": len(found.half_lengths),
        "logs_with_a_truth_outside": found.outside,
        "half_length": {
            name: {"unit": unit, "median": float(median), "most": float(most)}
            for name, unit, median, most in zip(system.names, system.units, *lengths, strict=True)
        },
        "rests_on": list(assumptions(system, found.log, delay=found.axis.delay)),
    }


def text(found: Simulated) -> str:
    """For people."""
    said, logs = summary(found), len(found.half_lengths)
    margins = [(name, one["beyond"], one["least_margin"]) for name, one in said["limits"].items()]
    lengths = [(name, *one.values()) for name, one in said["half_length"].items()]
    title = f"Half of the intervals that {logs} logs prove; outside of them: {found.outside} truths"
    return "\n".join(
        (
            f"{found.plants} axes, seed {found.seed}: evidence, no proof",
            plots.text_table(("limit", "axes beyond it", "least margin"), margins),
            plots.text_table(("parameter", "unit", "median", "most"), lengths, title),
            "They rest on:",
            *(f"  {sentence}" for sentence in said["rests_on"]),
        )
    )


def page(path: Path, found: Simulated) -> None:
    """Tracking error, velocity and input of some plants."""
    axis, drawn = found.axis, found.drawn
    unit, limits = UNITS[axis.system.coordinate], axis.task.limits
    canvas, panels = plots.figure(1, 3, (12.0, 4.2))
    instants = np.asarray(drawn.time[0])
    error = drawn.position - found.played.states(drawn.time[0]).position[None]
    ticks_at = instants[:-1:_SUBSTEPS]
    views: tuple[tuple[str, np.ndarray, Array, Array | None], ...] = (
        (f"position less the motion's ({unit})", instants, error, None),
        (f"velocity ({unit}/s)", instants, drawn.velocity, limits.velocity),
        (f"input ({axis.system.input_unit})", ticks_at, drawn.input, limits.input),
    )
    for panel, (name, time, values, interval) in zip(panels, views, strict=True):
        panel.plot(time, np.asarray(values[:_DRAWN]).T, linewidth=0.7, alpha=0.7)
        if interval is not None:
            plots.limit_lines(panel, interval.tolist())
        plots.label(panel, "time (s)", name)
    plots.save(canvas, path)
