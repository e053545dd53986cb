"""A first prior box Ω_θ and δ from a log of any motion, such as a jog: Remark 1 of the paper.

"Ω_θ can be obtained by some simple identification methods which may not be very accurate … can be
very conservative." The proposal follows a rule and is no guarantee: only a user who knows the axis
can judge whether larger values occur.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxid._checks import require
from jaxid._progress import Report, silent
from jaxid._text import at_least, at_most
from jaxid.axis.file import Axis
from jaxid.identification.batches import knots_by_length
from jaxid.identification.falsification import MOST, smallest_disturbance_factor
from jaxid.identification.least_squares import fit_least_squares
from jaxid.identification.state_bounds import UnboundedVelocityError
from jaxid.io.recorded import Recorded
from jaxid.io.segments import steady_segments
from jaxid.io.text_tables import text_table
from jaxid.loop.log import Log
from jaxid.model.disturbance_bound import ConstantBound
from jaxid.model.regressors import Coulomb, OneWay, Sign, Viscous
from jaxid.model.system import System, Term

_SHARE = 0.5  # half-width of an interval, relative to the estimate
_LEAST_INERTIA = 0.1  # lower end of its interval, relative to the estimate
MARGIN = 1.25
_KNOTS = 6000  # of all logs together: with fewer, δ is underestimated
RULE = (
    f"Each interval is the least-squares estimate, plus and minus {_SHARE:.0%} of it, or what a "
    "disturbance as large as the largest residual can shift it by, if that is more; inertia stays "
    "above a tenth of its estimate, friction above zero.",
    f"δ is {MARGIN:g} times the smallest one with which some θ of that box explains the log.",
    "This is a heuristic, not a guarantee: only you can judge whether disturbances larger than "
    "those in this log occur.",
)


class Proposal(NamedTuple):
    """A proposed prior box and disturbance bound δ, by the rule `RULE`.

    Attributes:
        axis: axis that the proposal is for.
        theta: least-squares estimate, shape (m,), in the units of the parameters.
        lower: lower ends of the proposed box, shape (m,), in the units of the parameters.
        upper: upper ends of the proposed box, shape (m,), in the units of the parameters.
        delta: proposed constant δ, in the unit of the input.
    """

    axis: Axis
    theta: Float[np.ndarray, " m"]
    lower: Float[np.ndarray, " m"]
    upper: Float[np.ndarray, " m"]
    delta: float

    def text(self) -> str:
        """Return the proposal as text: a table of intervals, δ, and the rule."""
        system = self.axis.system
        rows = [
            (name, unit, theta, at_least(low, 4), at_most(high, 4))
            for name, unit, theta, low, high in zip(
                system.names, system.units, self.theta.tolist(), self.lower, self.upper, strict=True
            )
        ]
        return "\n".join(
            (
                text_table(("parameter", "unit", "least squares", "from", "to"), rows),
                f"δ: level = {at_most(self.delta, 4)} {system.input_unit}",
                "The rule of this proposal (jaxid guide delta):",
                *(f"  {sentence}" for sentence in RULE),
            )
        )


def propose(axis: Axis, recorded: Recorded, report: Report = silent) -> Proposal:
    """Propose a prior box and δ for the terms of an axis, from a log.

    The prior box and the δ of the axis file are not used.

    Args:
        axis: axis from a file.
        recorded: log of any motion that identifies its parameters separately.
        report: function that is called as each step begins, with its name and the share of the
            work that is done.

    Raises:
        ValueError: if the log does not identify the parameters separately, its estimate of an
            inertia or a friction is below zero, or no δ explains it.
    """
    servo, system = axis.servo, axis.system
    pieces = steady_segments(recorded, servo.period, servo.resolution, axis.servo.delay)
    logs = [piece.log for piece in pieces]
    report("least squares", 0.0)
    found = fit_least_squares(system, logs)
    require(
        found.theta[0] > 0,
        f"Argument `recorded`: least squares give {system.names[0]} = {found.theta[0]:.4g} "
        f"{system.units[0]}, but an inertia must be positive. The input or the position may have "
        "the wrong sign: check `input.gain`, `log.input_unit` and `log.position_unit`.",
    )
    half = np.maximum(_SHARE * np.abs(found.theta), found.shift)
    lower, upper = found.theta - half, found.theta + half
    least = [_least(term, k, found.theta[k]) for k, term in enumerate(system.terms)]
    lower = np.maximum(lower, least)
    for name, unit, low, high in zip(system.names, system.units, lower, upper, strict=True):
        require(
            low < high,
            f"Argument `recorded`: the least-squares interval of {name} ends at {high:.4g} {unit}, "
            "but a friction must be positive. A term may be missing from the model, or a sign may "
            "be wrong.",
        )
    known = system.with_box(jnp.asarray(lower), jnp.asarray(upper))
    report("smallest consistent disturbance bound", 0.1)
    try:
        delta = MARGIN * _smallest(known, logs, found.residual)
    except UnboundedVelocityError:  # the encoder error makes the intervals wide
        raise ValueError(
            "Argument `recorded`: the encoder is too coarse for a fit of this log. It gives "
            f"{system.names[0]} = {found.theta[0]:.3g} ± {half[0]:.2g} {system.units[0]}, from "
            "which no δ follows. Log a faster motion, or take prior intervals and δ from the data "
            "sheet: `jaxid identify` needs no fit."
        ) from None
    return Proposal(axis, found.theta, lower, upper, delta)


def _least(term: Term, k: int, estimate: float) -> float:
    """Return the lower limit of a proposed interval."""
    regressor = term.regressor
    if isinstance(regressor, OneWay):
        regressor = regressor.regressor
    if k == 0:
        return _LEAST_INERTIA * estimate
    return 0.0 if isinstance(regressor, Viscous | Coulomb | Sign) else -np.inf


def _smallest(system: System, logs: list[Log], residual: Float[np.ndarray, " k"]) -> float:
    """Return the smallest constant δ that may explain the logs."""
    level = float(np.sqrt(np.mean(residual**2))) or 1.0
    unit = system.with_disturbance_bound(ConstantBound(level))
    factor = smallest_disturbance_factor(unit, logs, knots_by_length(_KNOTS, logs))
    require(
        factor < MOST,
        f"Argument `recorded`: no δ up to {MOST:g} times the RMS residual of least squares "
        "explains the log. Check units, signs, `input.delay` and the terms of the model.",
    )
    return level * factor
