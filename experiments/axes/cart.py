"""A cart on a linear motor: its cogging is part of δ, or a term with two unknown amplitudes.

    M ÿ + B ẏ + F_c S_f(ẏ) [+ C_s sin(2πy/pitch) + C_c cos(2πy/pitch)] + Δ = u

All numbers are chosen. A data sheet would state that the cogging repeats every 30 mm and is at most
6 N, and both models rest on that: the first one includes the cogging in δ, the second one has its
two amplitudes as parameters. A motion is designed for each model, and each model identifies the
parameters from the logs of both motions: cart.csv and cart.png.
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
COGGING, REST = 6.0, 1.5  # N, bounds on the cogging and on the residual disturbance
IN_DELTA, KNOWN = "in_delta", "known"  # the models and the motions designed for them
DELTA = {IN_DELTA: COGGING + REST, KNOWN: REST}  # N
TRUE_PARAMETERS = (3.8, 11.0, 7.5, 4.0, 3.0)  # kg, N s/m, N, N, N
SHARED = 3  # the first parameters, which both models have
SERVO = jd.Servo(period=0.0005, resolution=1e-7)
KNOTS = 300  # weights for the smallest δ; with one per row it is 1 to 3 % larger
COLUMNS = ("motion_for", "model", "delta_N", "smallest_delta_N", *PROVED, *WORTH)

Pair = tuple[str, str]  # the model of a motion's design, and the model that reads its log
SHOWN: dict[str, Pair] = {
    "cogging in δ": (IN_DELTA, IN_DELTA),
    "known, same motion": (IN_DELTA, KNOWN),
    "known, its own motion": (KNOWN, KNOWN),
}


def in_delta(delta: float = DELTA[IN_DELTA]) -> jd.System:
    """Return the model of the cart whose disturbance bound δ, in N, includes the cogging."""
    return jd.System(_shared(), jd.ConstantBound(delta), "N")


def known() -> jd.System:
    """Return the model of the cart with two unknown cogging amplitudes; δ bounds the residual."""
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
    """Return the task of both models: from rest to rest at 50 mm in 1.2 s.

    The acceleration limit is that of the second model, whose cogging takes a part of the input.
    """
    box = {"position": (0.0, 0.3), "velocity": (-1.2, 1.2), "input": (-160.0, 160.0)}
    acceleration = jd.acceleration_limit(known(), **box)
    limits = jd.Limits(acceleration=acceleration, jerk=(-600.0, 600.0), **box)
    rest = (0.05, 0.0, 0.0)
    ends = jd.Boundary(rest, (jd.through(rest, at=1.0),))
    return jd.Task(limits, ends, intervals=60, period=0.02)


def controller() -> jd.PDFeedforward:
    """Return a PD controller with feedforward, tuned by hand to a bandwidth of 60 rad/s.

    It knows the centre of the prior box, and nothing of the cogging.
    """
    return jd.PDFeedforward(in_delta(), in_delta().centre, kp=14_400.0, kd=340.0)


def plant() -> jd.Plant:
    """Return the simulated plant, with cogging, a third harmonic of it, and Stribeck friction.

    The cogging is 5 N. The residual is the third harmonic of 0.4 N and the friction of 0.9 N,
    together below 1.5 N.
    """
    harmonic = Cogging(PITCH, harmonics=[3.0], amplitudes=[0.4])
    friction = LowSpeedFriction(amplitude=0.9, speed=0.05)
    return jd.Plant(known(), TRUE_PARAMETERS, Mixture((harmonic, friction), [1.0, 1.0]))


class Reading(NamedTuple):
    """The results of one model from one log.

    Attributes:
        smallest: lower bound on the δ that explains the log, N.
        worth: evaluation of the motion before it is run.
        proved: estimate with guaranteed intervals from the log.
    """

    smallest: float
    worth: Evaluation
    proved: Estimate


def main(options: Example) -> None:
    """Design the motions, run them, identify the parameters, and write and print the results."""
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
    """Return the motion that is optimal for the predicted half-widths of the shared parameters."""
    shared = jnp.arange(len(axis.names)) < SHARED
    targets = jnp.where(shared, least.value, jnp.inf)
    key, effort = jax.random.key(options.seed), options.quick
    criterion = jd.PredictedError(axis, targets, SERVO)
    return jd.optimal_motion(task(), criterion, key, effort=effort).trajectory


def rows_read(motion_for: str, model: str, axis: jd.System, reading: Reading) -> list[Row]:
    """Return the table rows of one log and one model, one per parameter."""
    of_all: Row = {
        "motion_for": motion_for,
        "delta_N": DELTA[model],
        "smallest_delta_N": reading.smallest,
    }
    worth = rows_of({model: reading.worth}, "model", axis.names)
    ends = interval_rows(axis, TRUE_PARAMETERS[: len(axis.names)], reading.proved)
    return [of_all | one | other for one, other in zip(worth, ends, strict=True)]


def said(readings: Mapping[Pair, Reading]) -> list[str]:
    """Return the results as sentences."""
    plain, same, own = (readings[pair] for pair in SHOWN.values())
    before, *after = (np.asarray(x.proved.half_widths)[:SHARED] for x in (plain, same, own))
    shares = [", ".join(f"{share:.0%}" for share in length / before) for length in after]
    names = ", ".join(in_delta().names)
    return [
        f"As a known term, the cogging reduces δ from {COGGING + REST:g} N to {REST:g} N. The "
        f"intervals of {names} are then {shares[0]} as long from the same log, and {shares[1]} as "
        "long from the log of the motion designed for this model.",
        f"A model without cogging needs a δ of at least {plain.smallest:.3g} N for that log, "
        f"{plain.smallest / REST:.2g} times {REST:g} N: with {REST:g} N it is inconsistent.",
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
