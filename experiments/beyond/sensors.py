"""Predicted half-widths over encoder resolution and sample period, by three estimators."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Float
from tqdm import tqdm

from experiments.axes import linear_motor as motor
from experiments.paper.designs import HORIZON, ONE_MOTION, STUDIED, Cell, trajectory_path
from experiments.paper.figures import SYMBOLS
from jaxid._types import Scalar
from jaxid.design.nominal_log import nominal_log
from jaxid.identification.intervals import PASSES, narrowed
from jaxid.identification.modulating_functions import modulating
from jaxid.identification.regression_rows import RegressionRows, boxes, guaranteed_estimate, hats
from jaxid.identification.state_bounds import state_bounds
from jaxid.io import plots
from jaxid.io.files import Cell as Value
from jaxid.io.files import read_table, read_trajectory, write_table
from jaxid.loop.log import Log
from jaxid.loop.servo import Servo
from jaxid.model.system import System
from jaxid.regression.estimate import Estimate
from jaxid.regression.estimators import Filtered, LeastSquares
from jaxid.regression.lower_bound import lower_bound
from jaxid.runtime import configure

RESOLUTIONS = (0.05e-6, 0.5e-6, 5e-6, 50e-6)  # m
PERIODS = (0.0001, 0.0002, 0.0005, 0.001, 0.002)  # s
BANDWIDTHS = tuple(float(w) for w in np.geomspace(30.0, 10_000.0, 11).round())  # rad/s
COLUMNS = ("way", "period_s", "resolution_m", "parameter", "predicted", "lower_bound", "prior")


@dataclass(frozen=True)
class Sensors:
    """Predicted half-widths of one motion for many encoders and sample periods.

    Attributes:
        out: folder for sensors.csv and sensors.png.
        motions: folder with the trajectories of the study.
        redraw: draw the sensors.csv in `out` again instead of computing it.
        toy: use the motor's own sensor alone, only to show that everything works.
    """

    out: Path = Path("figures")
    motions: Path = Path("figures")
    redraw: bool = False
    toy: bool = False


class Way(NamedTuple):
    """A method that makes estimates with guaranteed bounds from a log.

    Attributes:
        rows: function that returns the regression rows of a log.
        estimates: function that returns estimates from the rows and the sample period in s.
    """

    rows: Callable[..., RegressionRows]
    estimates: Callable[[RegressionRows, Scalar], list[Estimate]]


def _filtered(order: int) -> Callable[[RegressionRows, Scalar], list[Estimate]]:
    """Return a function that makes least-squares estimates of filtered rows, one per bandwidth."""

    @eqx.filter_jit
    def one(logged: RegressionRows, w: Scalar, period: Scalar) -> Estimate:
        estimator = LeastSquares()
        for _ in range(order):
            estimator = Filtered(estimator, w, period)
        weights = estimator(logged.record.rows, logged.system.half_widths)
        return guaranteed_estimate(logged, weights)

    return lambda logged, period: [one(logged, jnp.asarray(w), period) for w in BANDWIDTHS]


def _modulated(logged: RegressionRows, period: Scalar) -> list[Estimate]:
    return [guaranteed_estimate(logged, modulating(logged, motor.system().half_widths))]


WAYS: Mapping[str, Way] = {
    "first_order_filter": Way(boxes, _filtered(1)),
    "second_order_filter": Way(hats, _filtered(2)),
    "modulating": Way(hats, _modulated),
}
_LABELS = {
    "first_order_filter": ("the paper's filter on differenced velocity, sampling counted", "x"),
    "second_order_filter": ("second-order filter on the position", "s"),
    "modulating": ("optimal modulating functions (jaxid)", "o"),
}


def main(options: Sensors) -> None:
    """Compute the predicted half-widths, and write and draw them."""
    prefix = "toy_" if options.toy else ""
    table = options.out / f"{prefix}sensors.csv"
    if not options.redraw:
        write_table(table, COLUMNS, list(costs(options)))
    rows = read_table(table)
    draw(options.out / f"{prefix}sensors.png", rows)


def costs(options: Sensors) -> Iterator[dict[str, Value]]:
    """Yield predicted half-widths by sensor, estimator and parameter, with the best bandwidth."""
    system, least = motor.system(), lower_bound(motor.system(), motor.limits()).value
    motion = read_trajectory(trajectory_path(options.motions, Cell(ONE_MOTION, HORIZON)))
    whole = [(period, resolution) for period in PERIODS for resolution in RESOLUTIONS]
    usual = [(motor.CONTROL_PERIOD, motor.ENCODER_RESOLUTION)]
    for period, resolution in tqdm(usual if options.toy else whole, "sensors"):
        log = nominal_log(system, motion, Servo(period, resolution))
        for name, way in WAYS.items():
            bounds = least_bounds(system, log, way)
            for k, parameter in enumerate(system.names):
                values = float(bounds[k]), float(least[k]), float(system.half_widths[k])
                sensor = name, period, resolution, parameter
                yield dict(zip(COLUMNS, (*sensor, *values), strict=True))


def least_bounds(system: System, log: Log, way: Way) -> Float[np.ndarray, " m"]:
    """Return the smallest bounds after two passes over a log, the second with a narrower box."""
    narrow, bounds = system, np.full(len(system.names), np.inf)
    for _ in range(PASSES):
        found = way.estimates(way.rows(narrow, log, state_bounds(narrow, log)), log.period)
        bounds = np.min([np.asarray(estimate.bound) for estimate in found], axis=0)
        for estimate in found:
            narrow = narrowed(narrow, estimate)
    return bounds


def draw(path: Path, rows: list[dict[str, str]]) -> None:
    """Draw the rows of sensors.csv, over encoder resolution above and over sample period below."""
    canvas, panels = plots.figure(2, len(STUDIED), (11.0, 7.0))
    sides = (
        ("resolution_m", "period_s", motor.CONTROL_PERIOD,
         "encoder resolution (µm)", 1e6, "sampled every 0.2 ms"),
        ("period_s", "resolution_m", motor.ENCODER_RESOLUTION,
         "sample period (ms)", 1e3, "encoder of 0.5 µm"),
    )  # fmt: skip
    for number, (along, fixed, value, label, factor, title) in enumerate(sides):
        for name, panel in zip(STUDIED, panels[number * len(STUDIED) :], strict=False):
            chosen = [r for r in rows if r["parameter"] == name and float(r[fixed]) == value]
            for colour, (way, (text, mark)) in zip(plots.CYCLE, _LABELS.items(), strict=False):
                own = [r for r in chosen if r["way"] == way]
                x = [factor * float(r[along]) for r in own]
                panel.loglog(x, _above(own, "predicted"), f"{mark}-", color=colour, label=text)
            for worthless in _above(chosen[:1], "prior"):
                panel.axhline(worthless, color=plots.GREY, linestyle="--", label="prior interval")
            panel.xaxis.set_major_formatter("{x:g}")
            panel.yaxis.set_major_formatter("{x:g}")
            side = "% above the lower bound" if name == STUDIED[0] else ""
            plots.label(panel, label, side, f"{SYMBOLS[name]}, {title}")
    handles, labels = panels[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=10)
    canvas.suptitle("Predicted guaranteed half-widths of one motion of 0.6 s", fontsize=12)
    plots.save(canvas, path)


def _above(rows: list[dict[str, str]], column: str) -> list[float]:
    return [100 * (float(r[column]) / float(r["lower_bound"]) - 1) for r in rows]


if __name__ == "__main__":
    configure()
    main(tyro.cli(Sensors))
