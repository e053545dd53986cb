"""A test of the guaranteed intervals by thousands of simulated logs: honest.csv.

It counts how often the true parameters are outside the intervals.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Array, Bool, Float

from experiments._support import simulated_logs
from experiments._support.measured_records import differenced_record, printed_record
from experiments._support.pieces import Pieces
from experiments._support.simulated_logs import Motions
from experiments.axes import linear_motor as motor
from jaxid.identification.assumptions import assumptions
from jaxid.identification.feasible_parameter_set import feasible_set
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.identification.regression_rows import boxes, guaranteed_estimate, hats
from jaxid.identification.state_bounds import state_bounds
from jaxid.io.files import write_table
from jaxid.io.text_tables import text_table
from jaxid.loop.log import Log
from jaxid.regression.estimate import Estimate, least_squares_estimate
from jaxid.regression.estimators import ESTIMATORS, Filtered, LeastSquares
from jaxid.regression.filters import filtered
from jaxid.regression.lower_bound import lower_bound
from jaxid.runtime import configure

PROMISED = (
    "modulating", *ESTIMATORS, "second_order_filter", "first_order_filter", "feasible_set",
)  # fmt: skip
BARE = ("bare_as_printed", "bare_with_differences")  # (29) applied to a log: no guarantee
COLUMNS = (
    "intervals", "parameter", "logs", "outside", "half_width_median", "half_width_most",
    "median_over_lower_bound", "most_over_lower_bound",
)  # fmt: skip
USUAL = 500  # logs of the motion for all parameters, with cogging and friction

Intervals = Mapping[str, tuple[Float[Array, " m"], Float[Array, " m"]]]


@dataclass(frozen=True)
class Honest:
    """Intervals by every estimator from logs of random motors; a stopped run continues.

    Attributes:
        out: folder for honest.csv, and for blocks of logs during the run.
        motions: folder with the trajectories of the study.
        logs: number of logs; the first 500 are of the motion for all parameters, with cogging and
            friction.
        seed: seed of the random plants and forces.
        processes: number of processes that share the work; the results do not depend on it.
        knots: largest number of weights of the modulating functions.
        block: number of logs that are saved together.
    """

    out: Path = Path("figures")
    motions: Path = Path("figures")
    logs: int = 10_000
    seed: int = 0
    processes: int = 2
    knots: int = 150
    block: int = 50

    @property
    def pieces(self) -> Pieces:
        """The finished blocks of an unfinished run."""
        asked = self.logs, self.seed, self.knots, self.block
        return Pieces.of(self.out / "honest.csv", asked, simulated_logs.paths(self.motions))

    @property
    def blocks(self) -> list[str]:
        """The numbers of all blocks, as text."""
        return [str(number) for number in range(-(-self.logs // self.block))]

    def members(self, number: int) -> range:
        """Return the numbers of the logs of a block."""
        return range(number * self.block, min((number + 1) * self.block, self.logs))


class Found(NamedTuple):
    """The true parameters of n logs, and the intervals of every kind.

    Attributes:
        usual: whether a log is of the motion for all parameters with cogging and friction, shape
            (n,).
        theta: true parameters, shape (n, m).
        lower: lower ends of the intervals, shape (n, kinds, m).
        upper: upper ends of the intervals, shape (n, kinds, m).
    """

    usual: Bool[np.ndarray, " n"]
    theta: Float[np.ndarray, "n m"]
    lower: Float[np.ndarray, "n kinds m"]
    upper: Float[np.ndarray, "n kinds m"]


def main(options: Honest) -> None:
    """Simulate the missing logs, count intervals without the true value, and print the table."""
    found = found_by(options)
    rows = list(table(found))
    write_table(options.out / "honest.csv", COLUMNS, rows)
    options.pieces.discard()
    shown = [[row[name] for name in COLUMNS] for row in rows]
    print(text_table(COLUMNS, shown, f"{options.logs} simulated logs, seed {options.seed}"))
    kept = Log(jnp.zeros(1), jnp.zeros(2), motor.CONTROL_PERIOD, motor.ENCODER_RESOLUTION)
    rests_on = assumptions(motor.system(), kept)
    print("All intervals except the bare ones hold provided that:", *rests_on, sep="\n  ")


def found_by(options: Honest) -> Found:
    """Return the results of all logs in order; finished blocks are not simulated again."""
    make = partial(block_of, options)
    parts = options.pieces.complete(options.blocks, make, options.processes, "blocks of logs")
    return Found(*(np.concatenate([part[name] for part in parts]) for name in Found._fields))


def block_of(options: Honest, number: str) -> dict[str, np.ndarray]:
    """Return the results of the logs of one block, which are simulated."""
    motions = simulated_logs.read_motions(options.motions)
    return judged(options, motions, options.members(int(number)))._asdict()


def judged(options: Honest, motions: Motions, members: range) -> Found:
    """Return the true parameters and the intervals by every estimator, for some logs."""
    usual = [number < USUAL for number in members]
    scenarios = [
        (simulated_logs.usual if typical else simulated_logs.mixed)(options.seed, number)
        for number, typical in zip(members, usual, strict=True)
    ]
    found = [intervals(log, options.knots) for log in simulated_logs.logs(motions, scenarios)]
    ends = [
        np.array([[one[name][side] for name in (*PROMISED, *BARE)] for one in found])
        for side in (0, 1)
    ]
    theta = np.array([scenario.theta for scenario in scenarios])
    return Found(np.array(usual), theta, *ends)


def intervals(log: Log, knots: int) -> Intervals:
    """Return the intervals from one log by all estimators of `PROMISED` and of `BARE`.

    Each is θ̂ ± bound, without the prior box, so that the box cannot be the reason that it contains
    the true value. Only the feasible parameter set has no meaning without the box.
    """
    found = guaranteed_intervals(motor.system(), [log], knots)
    left = feasible_set(found.rows, [found.estimate], knots)
    estimates = {"modulating": found.estimate, **_others(log)}
    ends = {name: (e.theta - e.bound, e.theta + e.bound) for name, e in estimates.items()}
    return ends | {"feasible_set": (left.lower, left.upper)}


@eqx.filter_jit
def _others(log: Log) -> dict[str, Estimate]:
    """Return the estimates that need no linear program, from one pass over the log."""
    system, w, h = motor.system(), motor.BANDWIDTH, motor.CONTROL_PERIOD
    found, low_pass = state_bounds(system, log), Filtered(LeastSquares(), w, h)
    rows = hats(system, log, found)
    ways = {name: (rows, estimator) for name, estimator in ESTIMATORS.items()}
    ways["second_order_filter"] = (rows, Filtered(low_pass, w, h))
    ways["first_order_filter"] = (boxes(system, log, found), low_pass)
    promised = {
        name: guaranteed_estimate(logged, estimator(logged.record.rows, system.half_widths))
        for name, (logged, estimator) in ways.items()
    }
    records = (
        printed_record(system, log.input, log.position, w, h),
        filtered(differenced_record(system, log.input, log.position, h), w, h),
    )
    bare = [least_squares_estimate(record, system) for record in records]
    return promised | dict(zip(BARE, bare, strict=True))


def table(found: Found) -> Iterator[dict[str, str | float | int]]:
    """Yield counts and half-widths by estimator and parameter; first those of the usual logs."""
    least = np.asarray(lower_bound(motor.system(), motor.limits()).value)
    theta = found.theta[:, None]
    outside = (theta < found.lower) | (theta > found.upper)
    half = (found.upper - found.lower) / 2
    everything = np.ones_like(found.usual)
    groups = [(name, kind, everything) for kind, name in enumerate((*PROMISED, *BARE))]
    groups.insert(0, ("modulating_usual_logs", 0, found.usual))
    for label, kind, logs in groups:
        for k, name in enumerate(motor.system().names):
            lengths = half[logs, kind, k]
            yield {
                "intervals": label,
                "parameter": name,
                "logs": len(lengths),
                "outside": int(outside[logs, kind, k].sum()),
                "half_width_median": float(np.median(lengths)),
                "half_width_most": float(lengths.max()),
                "median_over_lower_bound": float(np.median(lengths) / least[k]),
                "most_over_lower_bound": float(lengths.max() / least[k]),
            }


if __name__ == "__main__":
    configure()
    main(tyro.cli(Honest))
