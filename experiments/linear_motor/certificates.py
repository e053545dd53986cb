"""How good the designs are, and what one experiment proves: guaranteed errors, floor, set of θ."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid import linear_motor as motor
from jaxid.bound import affine_worst_case_error
from jaxid.estimators import ESTIMATORS
from jaxid.experiment import STEPS, design_guaranteed, log_of, run
from jaxid.feasible_set import FeasibleSet, feasible_set, projection
from jaxid.floor import floor
from jaxid.guarantee import Guarantee, assumptions, foreseen, identify_log
from jaxid.objective import planned_error
from jaxid.problem import Task
from jaxid.record import rows_of
from jaxid.sensing import Encoder
from jaxid.trajectory import JerkTrajectory

HORIZON = 30
# of the floor: what one motion may guarantee for each parameter at the same time
ALLOWED = (1.06, 1.015, 1.02, 1.01)
KNOTS = 150  # of a feasible set; twice as many leave 3 % less of it
PLANES = (("M", "B"), ("M", "Fc"), ("B", "Fc"), ("Fc", "dbar"))
_NODES = 256  # per interval, of the errors of the estimators: twice as many change less than 1e-3


class Worth(NamedTuple):
    """What a motion is worth for each parameter, shape (m,) each.

    Attributes:
        errors: worst-case errors on the desired motion, by estimator.
        guaranteed: what the log of the axis can be expected to prove, servo and encoder included.
    """

    errors: Mapping[str, Float[Array, " m"]]
    guaranteed: Float[Array, " m"]


class Proof(NamedTuple):
    """What the log of one experiment proves.

    Attributes:
        assumptions: that all of it rests on.
        guarantee: by the weights that were best before the data.
        left: all that the data leave possible.
        projections: of the same, by pair of parameters.
    """

    assumptions: tuple[str, ...]
    guarantee: Guarantee
    left: FeasibleSet
    projections: Mapping[tuple[str, str], Float[np.ndarray, "corners 2"]]


def motion_path(folder: Path) -> Path:
    """Where the one motion for all parameters is kept."""
    return folder / "trajectory_minimax.csv"


def certified_floor() -> Float[Array, " m"]:
    """Of the motor under its limits."""
    return floor(motor.system(), motor.limits()).value


def one_motion(
    start: JerkTrajectory, least: Float[Array, " m"], steps: int = STEPS
) -> JerkTrajectory:
    """Good for all parameters at once, from the motion that is best for least squares."""
    task = Task(motor.limits(), motor.boundary(), start.jerk.size, motor.KNOT_PERIOD)
    servo = motor.CONTROL_PERIOD, motor.ENCODER_RESOLUTION
    targets = jnp.asarray(ALLOWED) * least
    return design_guaranteed(motor.system(), task, targets, start, *servo, steps=steps)


def worth(motion: JerkTrajectory) -> Worth:
    """Before the experiment."""
    system = motor.system()
    log = foreseen(system, motion, motor.CONTROL_PERIOD, motor.ENCODER_RESOLUTION)
    errors = {"least_squares": planned_error(system, motion), **_errors(motion)}
    return Worth(errors, identify_log(system, log).estimate.half_length)


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
    """One run of the motion on the simulated motor, with its encoder, cogging and friction."""
    system, encoder = motor.system(), Encoder(motor.ENCODER_RESOLUTION)
    _, signals = run(motor.plant(), motor.controller(), encoder, motion, motor.CONTROL_PERIOD)
    log = log_of(signals, encoder, motor.CONTROL_PERIOD)
    found = identify_log(system, log)
    left = feasible_set(found.logged, [found.estimate], KNOTS)
    seen = {pair: projection(found.logged, *pair, KNOTS) for pair in PLANES}
    return Proof(assumptions(system, log), found, left, seen)
