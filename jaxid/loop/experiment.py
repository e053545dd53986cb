"""Run a motion in closed loop, and identify from what it left as the paper does."""

from jaxid._checks import require_float64
from jaxid.loop.controllers import Controller
from jaxid.loop.log import Log
from jaxid.loop.record import Record
from jaxid.loop.sensors import Encoder, Sensor
from jaxid.loop.simulate import Plant, Signals, simulate
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory, reference, ticks
from jaxid.regression.estimate import Estimate, least_squares_estimate
from jaxid.regression.filters import filtered
from jaxid.regression.worst_case import require_informative


def run(
    plant: Plant,
    controller: Controller,
    sensor: Sensor,
    trajectory: JerkTrajectory,
    period: float,
    repeats: int = 1,
) -> tuple[Record, Signals]:
    """Track a motion, repeated back to back, with a controller of the given period (s)."""
    desired = reference(trajectory, period, ticks(trajectory, period), repeats)
    return simulate(plant, controller, sensor, desired, period)


def log_of(signals: Signals, encoder: Encoder, period: float) -> Log:
    """What the servo would have kept of a simulated experiment."""
    n = signals.input.size
    read = encoder.quantise(signals.position[:: (signals.position.size - 1) // n])
    return Log(signals.input, read, period, encoder.resolution)


def identify(record: Record, system: System, bandwidth: float, period: float) -> Estimate:
    """(28)-(29): filter the record with H_f and estimate by least squares.

    Args:
        record: with exact rows for the bound to hold.
        system: for its prior box.
        bandwidth: w of H_f in rad/s.
        period: of the record's ticks, s.
    """
    require_float64("record", record)
    passed = filtered(record, bandwidth, period)
    require_informative(passed.rows, system.names, system.half_widths)
    return least_squares_estimate(passed, system)
