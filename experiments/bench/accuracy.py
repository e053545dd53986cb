"""The accuracy of one integration step per sample period, and its number of arctangents."""

import jax.numpy as jnp

from experiments.axes import linear_motor as motor
from experiments.bench.answers import AT_MOST, Answer
from experiments.bench.closed_loop import TICKS
from experiments.bench.loop_against_c import MOTION
from jaxid.io.files import read_trajectory
from jaxid.loop.record import Record
from jaxid.loop.sensors import IdealSensor
from jaxid.loop.simulate import NODES, Signals, simulate
from jaxid.motion.trajectory import reference
from jaxid.regression.filters import filtered
from jaxid.regression.worst_case import least_squares, worst_case_error

QUESTION = "accuracy"
FINE = 10  # integration steps per sample period


def ask() -> list[Answer]:
    """Return the errors of one step per sample period, compared with ten.

    The plant is the simulated motor with its cogging and friction, with an exact sensor.
    """
    (coarse, seen), (fine, truth) = run(1), run(FINE)
    errors = [error(record) for record in (coarse, fine)]
    far = jnp.max(jnp.abs(seen.position - truth.position[::FINE]))
    case = f"1 step per tick against {FINE}"
    return [
        Answer(QUESTION, case, "largest error of position, m", float(far), None, (AT_MOST, 1e-6)),
        Answer(QUESTION, case, "relative error of J_f", float(abs(errors[0] / errors[1] - 1))),
        Answer(QUESTION, "1 step per tick", "arctangents", float(len(NODES))),
    ]


def run(substeps: int) -> tuple[Record, Signals]:
    """Return the record and signals of three repetitions of a motion, as in the study."""
    desired = reference(read_trajectory(MOTION), motor.CONTROL_PERIOD, TICKS, 3)
    controller, sensor = motor.controller(), IdealSensor()
    return simulate(motor.plant(), controller, sensor, desired, motor.CONTROL_PERIOD, substeps)


def error(record: Record) -> float:
    """Return J_f of the first parameter."""
    rows = filtered(record, motor.BANDWIDTH, motor.CONTROL_PERIOD).rows
    return float(worst_case_error(least_squares(rows), rows.delta)[0])
