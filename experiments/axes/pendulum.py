"""An example of a user-defined axis and objective: a pendulum on the shaft of a motor.

    J q̈ + B q̇ + F_c S_f(q̇) + G sin(q) + Δ = u,     θ = [J, B, F_c, G]

All numbers are chosen: half a kilogram at the end of 40 cm, which hangs down at q = 0 and may swing
to 160° on both sides. Three motions are designed: for the predicted half-widths of all parameters,
for the least-squares error of J, and for that error together with little heat in the motor:
pendulum.csv and pendulum.png.
"""

from collections.abc import Mapping
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jax.tree_util import Partial

import jaxid as jd
from experiments._support.evaluations import WORTH, rows_of
from experiments._support.examples import (
    PROVED,
    Example,
    draw_intervals,
    interval_rows,
    save_table,
)
from jaxid._types import Scalar, dot
from jaxid.design.criteria import PlannedError
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.io import plots
from jaxid.loop.closed_loop import run
from jaxid.loop.disturbances import LowSpeedFriction
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.estimate import Estimate
from jaxid.regression.worst_case import infinity
from jaxid.runtime import configure
from jaxid.search.problem import Objective

ALL, ERROR, COOL = "all", "J", "cool"  # names of the motions
TRUE_PARAMETERS = (0.094, 0.035, 0.16, 1.92)  # kg m², N m s/rad, N m, N m
SERVO = jd.Servo(period=0.001, resolution=1e-5)
RATED = 1.5  # N m: continuous (rms) torque of the motor
PRICE = 0.2  # price of the heat at that torque, in units of the log of an error
COLUMNS = ("motion", *PROVED, *WORTH, "heat")


def system() -> jd.System:
    """Return the model of the pendulum, with its prior box and a disturbance bound of 0.1 N m."""
    return jd.System(
        terms=(
            jd.Term("J", "kg m²", (0.06, 0.14)),
            jd.Term("B", "N m s/rad", (0.0, 0.1), jd.Viscous()),
            jd.Term("Fc", "N m", (0.0, 0.4), jd.Coulomb(beta=100.0)),
            jd.Term("G", "N m", (1.5, 2.5), jd.Sine()),
        ),
        disturbance_bound=jd.ConstantBound(0.1),
        input_unit="N m",
        coordinate="rotary",
    )


def task() -> jd.Task:
    """Return the task: from rest to rest, hanging down, in 2.5 s, within hard limits."""
    box = {"position": (-2.8, 2.8), "velocity": (-9.0, 9.0), "input": (-7.0, 7.0)}
    acceleration = jd.acceleration_limit(system(), **box)
    limits = jd.Limits(acceleration=acceleration, jerk=(-400.0, 400.0), **box)
    rest = (0.0, 0.0, 0.0)
    ends = jd.Boundary(rest, (jd.through(rest, at=1.0),))
    return jd.Task(limits, ends, intervals=50, period=0.05)


def controller() -> jd.PDFeedforward:
    """Return a PD controller with feedforward, tuned by hand to a bandwidth of 30 rad/s.

    It knows the centre of the prior box but not the true parameters.
    """
    return jd.PDFeedforward(system(), system().centre, kp=90.0, kd=5.0)


def plant() -> jd.Plant:
    """Return the simulated pendulum, with 80 mN m of Stribeck friction at low speed."""
    return jd.Plant(system(), TRUE_PARAMETERS, LowSpeedFriction(amplitude=0.08, speed=0.3))


def error_and_heat(
    error: PlannedError, price: Scalar, motion: JerkTrajectory, smoothing: Scalar
) -> Scalar:
    """Return the log of an error plus a price on heat, planned at the centre of the prior box."""
    states, seconds = motion.midpoints(error.nodes)
    torque = dot(error.system.regressors(*states), error.system.centre)
    return error(motion, smoothing) + price * heat(torque, seconds)


def objective(price: float) -> Objective:
    """Return the user-defined objective: the log of the worst-case error of J plus a price on heat.

    All prices share one compilation.
    """
    only = infinity(jnp.array([1.0, jnp.inf, jnp.inf, jnp.inf]))
    error = PlannedError(system(), only, speed=task().limits.velocity[1])
    return Partial(error_and_heat, error, jnp.asarray(price))


def heat(torque: jax.Array, seconds: jax.Array | None = None) -> Scalar:
    """Return the heat in the windings, relative to that at the continuous torque of the motor."""
    return jnp.average(torque**2, weights=seconds) / RATED**2


def main(options: Example) -> None:
    """Design the motions, evaluate and run them, identify, and write and print the results."""
    axis, law, truth = system(), controller(), plant()
    least = jd.lower_bound(axis, task().limits)
    key, effort = jax.random.key(options.seed), options.quick

    def for_all() -> JerkTrajectory:
        criterion = jd.PredictedError(axis, least.value, SERVO)
        return jd.optimal_motion(task(), criterion, key, effort=effort).trajectory

    def own(price: float) -> JerkTrajectory:
        return jd.optimal_motion(task(), objective(price), key, effort=effort).trajectory

    searches = {ALL: for_all, ERROR: lambda: own(0.0), COOL: lambda: own(PRICE)}
    motions = options.motions("pendulum", searches, axis.coordinate)
    worth = {name: jd.evaluate(axis, motion, SERVO, least) for name, motion in motions.items()}
    logs = {name: run(truth, law, SERVO, motion).log for name, motion in motions.items()}
    proved = {name: guaranteed_intervals(axis, [log]).estimate for name, log in logs.items()}
    heats = {name: float(heat(log.input)) for name, log in logs.items()}
    found = [
        row | {"heat": heats[name]}
        for name, one in proved.items()
        for row in interval_rows(axis, TRUE_PARAMETERS, one)
    ]
    rows = [a | b for a, b in zip(rows_of(worth, "motion", axis.names), found, strict=True)]
    save_table(options.named("pendulum.csv"), COLUMNS, rows)
    rise = float(worth[COOL].least_squares[0] / worth[ERROR].least_squares[0]) - 1
    print(
        f"With a price on heat, the least-squares error of J is {rise:.1%} higher, and the heat is "
        f"{heats[COOL]:.2f} instead of {heats[ERROR]:.2f} times that at the continuous torque.\n"
    )
    print("These intervals hold provided that:", *jd.assumptions(axis, logs[ALL]), sep="\n  ")
    draw(options.named("pendulum.png"), logs, proved)


def draw(path: Path, logs: Mapping[str, jd.Log], proved: Mapping[str, Estimate]) -> None:
    """Draw the motions, their torques, and the guaranteed intervals of each log."""
    canvas, (left, middle, right) = plots.figure(1, 3, (14.0, 4.8))
    limits, labels = task().limits, {
        ALL: "motion for all", ERROR: "motion for J", COOL: "motion for J and low heat",
    }  # fmt: skip
    for log, colour in zip(logs.values(), plots.CYCLE, strict=False):
        time = np.arange(log.position.size) * SERVO.period
        left.plot(time, log.position, color=colour, linewidth=1.8)
        middle.plot(time[:-1], log.input, color=colour, linewidth=1.2)
    plots.limit_lines(left, limits.position.tolist())
    plots.limit_lines(middle, limits.input.tolist())
    plots.label(left, "time (s)", "position (rad)", "Three motions (limits dashed)")
    plots.label(middle, "time (s)", "torque (N m)", "Torque (limits dashed)")
    bars = {labels[name]: found for name, found in proved.items()}
    draw_intervals(canvas, right, axis=system(), found=bars, truth=TRUE_PARAMETERS)
    plots.save(canvas, path)


if __name__ == "__main__":
    configure()
    main(tyro.cli(Example, description=__doc__))
