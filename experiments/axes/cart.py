"""A cart on a linear motor with cogging: inside δ, or known but for its amplitude and phase.

    M ÿ + B ẏ + F_c S_f(ẏ) [+ C_s sin(2πy/pitch) + C_c cos(2πy/pitch)] + Δ = u

All numbers are chosen. A data sheet would say of the cogging that it repeats every 30 mm and is 6 N
at most, and both models rest on that: the first counts it to δ, the second has two amplitudes in
its box. Each gets a motion of its own, and each reads the logs of both: cart.csv and cart.png.
"""

import math
from collections.abc import Mapping
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro

import jaxid as jd
from experiments._support.evaluations import WORTH, Row, rows_of
from experiments._support.examples import (
    PROVED,
    Example,
    draw_intervals,
    interval_rows,
    save_table,
)
from jaxid.design.evaluation import Evaluation
from jaxid.identification.falsification import smallest_disturbance_factor
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.identification.least_squares import fit_least_squares
from jaxid.io import plots
from jaxid.loop.closed_loop import run
from jaxid.loop.disturbances import Cogging, LowSpeedFriction, Mixture
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.estimate import Estimate
from jaxid.regression.lower_bound import LowerBound
from jaxid.runtime import configure

PITCH = 0.03  # m
COGGING, REST = 6.0, 1.5  # N, at most
IN_DELTA, KNOWN = "in_delta", "known"  # the models, and the motions that are designed for them
DELTA = {IN_DELTA: COGGING + REST, KNOWN: REST}  # N
TRUE_PARAMETERS = (3.8, 11.0, 7.5, 4.0, 3.0)  # kg, N s/m, N, N, N
SHARED = 3  # parameters of both models
SERVO = jd.Servo(period=0.0005, resolution=1e-7)
KNOTS = 300  # of the weights that refute a δ; on all rows they refute 1 to 3 % more
COLUMNS = ("motion_for", "model", "delta_N", "smallest_delta_N", *PROVED, *WORTH)

Pair = tuple[str, str]  # what a motion is for, and the model that reads its log
SHOWN: dict[str, Pair] = {
    "cogging in δ": (IN_DELTA, IN_DELTA),
    "known, same motion": (IN_DELTA, KNOWN),
    "known, its own motion": (KNOWN, KNOWN),
}


def in_delta(delta: float = DELTA[IN_DELTA]) -> jd.System:
    """The cart whose cogging is part of δ, N."""
    return jd.System(_shared(), jd.ConstantBound(delta), "N")


def known() -> jd.System:
    """The cart whose cogging has two unknown parameters; δ is what else there is."""
    amplitude = (-COGGING, COGGING)
    cogging = (
        jd.Term("Cs", "N", amplitude, jd.Sine(pitch=PITCH)),
        jd.Term("Cc", "N", amplitude, jd.Sine(math.pi / 2, PITCH)),
    )
    return jd.System((*_shared(), *cogging), jd.ConstantBound(DELTA[KNOWN]), "N")


def _shared() -> tuple[jd.Term, ...]:
    return (
        jd.Term("M", "kg", (3.0, 5.0)),
        jd.Term("B", "N s/m", (0.0, 40.0), jd.Viscous()),
        jd.Term("Fc", "N", (0.0, 20.0), jd.Coulomb(beta=500.0)),
    )


def task() -> jd.Task:
    """From rest to rest at 50 mm in 1.2 s; the same for both, by the input that cogging leaves."""
    box = {"position": (0.0, 0.3), "velocity": (-1.2, 1.2), "input": (-160.0, 160.0)}
    acceleration = jd.acceleration_limit(known(), **box)
    limits = jd.Limits(acceleration=acceleration, jerk=(-600.0, 600.0), **box)
    rest = (0.05, 0.0, 0.0)
    ends = jd.Boundary(rest, (jd.through(rest, at=1.0),))
    return jd.Task(limits, ends, intervals=60, period=0.02)


def controller() -> jd.PDFeedforward:
    """Gains by hand, 60 rad/s; it knows the box, and nothing of the cogging."""
    return jd.PDFeedforward(in_delta(), in_delta().centre, kp=14_400.0, kd=340.0)


def plant() -> jd.Plant:
    """The simulated truth: 5 N of cogging, and in the rest a third harmonic and Stribeck friction.

    That rest is 0.4 N and 0.9 N, together below 1.5 N.
    """
    harmonic = Cogging(PITCH, harmonics=[3.0], amplitudes=[0.4])
    friction = LowSpeedFriction(amplitude=0.9, speed=0.05)
    return jd.Plant(known(), TRUE_PARAMETERS, Mixture((harmonic, friction), [1.0, 1.0]))


class Reading(NamedTuple):
    """Of one log by one model.

    Attributes:
        smallest: δ that explains it, N.
        worth: of its motion, before that was run.
        proved: by the log.
    """

    smallest: float
    worth: Evaluation
    proved: Estimate


def main(options: Example) -> None:
    """Search, run, read, save, draw, print."""
    models = {IN_DELTA: in_delta(), KNOWN: known()}
    floors = {name: jd.lower_bound(axis, task().limits) for name, axis in models.items()}
    searches = {
        name: partial(searched, options, axis, floors[name]) for name, axis in models.items()
    }
    motions = options.motions("cart", searches, "linear")
    logs = {name: run(plant(), controller(), SERVO, motion).log for name, motion in motions.items()}
    readings = {}
    for motion, (model, axis) in product(motions, models.items()):
        smallest = DELTA[model] * smallest_disturbance_factor(axis, [logs[motion]], KNOTS)
        worth = jd.evaluate(axis, motions[motion], SERVO, floors[model])
        proved = guaranteed_intervals(axis, [logs[motion]]).estimate
        readings[motion, model] = Reading(smallest, worth, proved)
    rows = [
        row
        for (motion, model), reading in readings.items()
        for row in rows_read(motion, model, models[model], reading)
    ]
    save_table(options.named("cart.csv"), COLUMNS, rows)
    print(*said(readings), sep="\n")
    for axis in models.values():
        print(
            "\nThese intervals hold provided that:", *jd.assumptions(axis, logs[KNOWN]), sep="\n  "
        )
    draw(options.named("cart.png"), motions, logs[IN_DELTA], readings)


def searched(options: Example, axis: jd.System, least: LowerBound) -> JerkTrajectory:
    """For what a log can prove of the parameters that both models have."""
    shared = jnp.arange(len(axis.names)) < SHARED
    targets = jnp.where(shared, least.value, jnp.inf)
    key, effort = jax.random.key(options.seed), options.quick
    criterion = jd.PredictedError(axis, targets, SERVO)
    return jd.optimal_motion(task(), criterion, key, effort=effort).trajectory


def rows_read(motion_for: str, model: str, axis: jd.System, reading: Reading) -> list[Row]:
    """For the table."""
    of_all: Row = {
        "motion_for": motion_for,
        "delta_N": DELTA[model],
        "smallest_delta_N": reading.smallest,
    }
    worth = rows_of({model: reading.worth}, "model", axis.names)
    ends = interval_rows(axis, TRUE_PARAMETERS[: len(axis.names)], reading.proved)
    return [of_all | one | other for one, other in zip(worth, ends, strict=True)]


def said(readings: Mapping[Pair, Reading]) -> list[str]:
    """What was found, in sentences."""
    plain, same, own = (readings[pair] for pair in SHOWN.values())
    before, *after = (np.asarray(x.proved.half_widths)[:SHARED] for x in (plain, same, own))
    shares = [", ".join(f"{share:.0%}" for share in length / before) for length in after]
    names = ", ".join(in_delta().names)
    return [
        f"Known, the cogging leaves {REST:g} N of {COGGING + REST:g} N to δ, and intervals of "
        f"{names} that are {shares[0]} as long from the same log, {shares[1]} from its own.",
        f"Not known, it takes a δ of {plain.smallest:.3g} N at least to explain that log, "
        f"{plain.smallest / REST:.2g} times {REST:g} N: a model that left it out would be refused.",
    ]


def draw(
    path: Path,
    motions: Mapping[str, JerkTrajectory],
    log: jd.Log,
    readings: Mapping[Pair, Reading],
) -> None:
    """Draw both motions, the residual of each model for one log, and the intervals."""
    canvas, (left, middle, right) = plots.figure(1, 3, (14.0, 4.8))
    for motion, colour in zip(motions.values(), (plots.BLUE, plots.GREEN), strict=True):
        time = np.linspace(0.0, float(motion.duration), 1000)
        velocity = np.asarray(motion.states(jnp.asarray(time)).velocity)
        left.plot(time, velocity, color=colour, linewidth=1.8)
    plots.limit_lines(left, task().limits.velocity.tolist())
    plots.label(left, "time (s)", "velocity (m/s)", "One motion for each model (limits dashed)")
    for axis, colour in ((in_delta(), plots.BLUE), (known(), plots.RED)):
        found = fit_least_squares(axis, [log])
        middle.plot(1000 * found.position, found.residual, ".", color=colour, markersize=3)
    plots.limit_lines(middle, (-REST, REST))
    title = f"Least-squares residual, and ±{REST:g} N (dashed)"
    plots.label(middle, "position (mm)", "residual of the input (N)", title)
    bars = {label: readings[pair].proved for label, pair in SHOWN.items()}
    draw_intervals(canvas, right, in_delta(), bars, TRUE_PARAMETERS)
    plots.save(canvas, path)


if __name__ == "__main__":
    configure()
    main(tyro.cli(Example, description=__doc__))
