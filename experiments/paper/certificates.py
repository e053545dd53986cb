"""The evaluation of designs, and the guaranteed results of one run: intervals and feasible set."""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from experiments.axes import linear_motor as motor
from jaxid.design.evaluation import Evaluation, evaluate
from jaxid.identification.assumptions import assumptions
from jaxid.identification.feasible_parameter_set import FeasibleSet, feasible_set, projection
from jaxid.identification.intervals import GuaranteedIntervals, guaranteed_intervals
from jaxid.identification.regression_rows import guaranteed_estimate
from jaxid.loop.closed_loop import run
from jaxid.loop.record import rows_of
from jaxid.motion.trajectory import JerkTrajectory, padded
from jaxid.regression.estimators import ESTIMATORS
from jaxid.regression.lower_bound import LowerBound
from jaxid.regression.worst_case import affine_worst_case_error

KNOTS = 150  # weights per feasible set; twice as many make it 3 % smaller
PLANES = (("M", "B"), ("M", "Fc"), ("B", "Fc"), ("Fc", "dbar"))
_NODES = 256  # per interval, for errors of estimators: twice as many change them less than 1e-3


class Worth(NamedTuple):
    """The evaluation of a motion for each parameter.

    Attributes:
        evaluation: least-squares errors, predicted half-widths and lower bounds.
        errors: worst-case errors of other estimators on the desired motion, shape (m,) each.
    """

    evaluation: Evaluation
    errors: Mapping[str, Float[Array, " m"]]


class Proof(NamedTuple):
    """The guaranteed results from the log of one experiment.

    Attributes:
        assumptions: sentences that state the assumptions of all these intervals.
        guarantee: guaranteed intervals, with weights that were chosen before the data were known.
        left: intervals of the feasible parameter set.
        projections: projections of the feasible parameter set, by pair of parameters.
    """

    assumptions: tuple[str, ...]
    guarantee: GuaranteedIntervals
    left: FeasibleSet
    projections: Mapping[tuple[str, str], Float[np.ndarray, "corners 2"]]


def worth(motion: JerkTrajectory, least: LowerBound) -> Worth:
    """Return the evaluation of a motion before the experiment."""
    longest = padded(motion, 2 * max(motor.HORIZONS))  # one compilation for all horizons
    return Worth(evaluate(motor.system(), motion, motor.servo(), least), _errors(longest))


@eqx.filter_jit
def _errors(motion: JerkTrajectory) -> dict[str, Float[Array, " m"]]:
    system = motor.system()
    rows, box = rows_of(system, *motion.midpoints(_NODES)), system.half_widths
    return {
        name: affine_worst_case_error(estimator(rows, box), rows, box)
        for name, estimator in ESTIMATORS.items()
        if name != "least_squares"
    }


def experiment(motion: JerkTrajectory) -> Proof:
    """Return the guaranteed results of one run on the simulated motor, from its encoder log."""
    system = motor.system()
    log = run(motor.plant(), motor.controller(), motor.servo(), motion).log
    found = guaranteed_intervals(system, [log])
    rows, box = found.rows.record.rows, system.half_widths
    others = [
        guaranteed_estimate(found.rows, estimator(rows, box)) for estimator in ESTIMATORS.values()
    ]
    left = feasible_set(found.rows, [found.estimate, *others], KNOTS)
    seen = {pair: projection(found.rows, *pair, KNOTS) for pair in PLANES}
    return Proof(assumptions(system, log), found, left, seen)
