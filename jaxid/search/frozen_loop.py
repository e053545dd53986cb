"""The limits of the axis itself, for a small change of its motion.

Tracking errors and feedback effort of the axis hardly change with the motion. Taken as fixed, they
turn the limits of the axis into limits of the motion that need no simulation. They are exact for
the motion at which they were fixed, so the search fixes them anew after every step.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid.model.interval_arithmetic import around, exactly
from jaxid.model.system import System, smoothed
from jaxid.motion.acceleration_limit import input_demand
from jaxid.motion.inequalities import Inequalities
from jaxid.motion.limits import Limits
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.motion.violation import Envelope, Prediction, axis_violations

_GROUPS = 4  # groups of samples per interval, each with one condition (its largest violation)
_BLEND = 0.02  # of the velocity limit: smoothing of jumps of friction, for linearisation


class FrozenLoop(Prediction):
    """A prediction of the axis that adds fixed deviations to what the motion itself requires.

    Attributes:
        model: system that gives the input of the motion itself, with its jumps smoothed.
        added: deviations of position, velocity, input and input rate, one per sample.
    """

    model: System
    added: Envelope

    @property
    def system(self) -> System:
        """The system that gives the input of the motion itself."""
        return self.model

    def __call__(self, trajectory: JerkTrajectory) -> Envelope:
        asked = _asked(self.model, trajectory, self.added.input.lower.size)
        return Envelope(*(a + b for a, b in zip(asked, self.added, strict=True)))


def freeze(axis: Prediction, limits: Limits, trajectory: JerkTrajectory) -> FrozenLoop:
    """Return a prediction that keeps the axis' deviations from one motion for nearby motions.

    Args:
        axis: prediction of the axis, evaluated once.
        limits: limits of the axis; the velocity limit scales the smoothing of the system.
        trajectory: motion at which the result equals `axis`.
    """
    found = axis(trajectory)
    model = smoothed(axis.system, _BLEND * jnp.max(jnp.abs(limits.velocity)))
    asked = _asked(model, trajectory, found.input.lower.size)
    added = jax.tree.map(lambda whole, part: whole - part, found, asked)
    return FrozenLoop(model, added)


def fixed_margins(
    system: System, ticks: int, margins: tuple[float, float, float, float]
) -> FrozenLoop:
    """Return a prediction of an axis that follows its motion within given margins.

    With it, a motion is planned by the input limit itself, not by (18).

    Args:
        system: system whose prior box and δ give the input that a motion requires.
        ticks: number of instants at which the limits are checked, a multiple of the number of
            intervals of the motion.
        margins: margins of position, velocity, input and input rate, SI units and unit of the
            input.
    """
    widths = [jnp.full(ticks, margin) for margin in margins]
    return FrozenLoop(system, Envelope(*(around(width) for width in widths)))


def axis_conditions(
    planned: Inequalities, limits: Limits, axis: FrozenLoop, trajectory: JerkTrajectory
) -> Inequalities:
    """Return the linear conditions of a motion, together with the linearised ones of the axis.

    Args:
        planned: linear conditions of the motion on its jerk, in `planned.unit`.
        limits: limits of the axis.
        axis: prediction of the axis, fixed at the motion.
        trajectory: motion at which the limits are linearised, without padding.
    """
    excess, slopes = map(np.asarray, _linearised(limits, axis, trajectory))
    rows = slopes * planned.unit
    upper = rows @ (np.asarray(trajectory.jerk) / planned.unit) - excess
    return Inequalities(
        np.concatenate([planned.rows, rows]),
        np.concatenate([planned.lower, np.full(len(upper), -np.inf)]),
        np.concatenate([planned.upper, upper]),
        planned.jerk,
        planned.unit,
    )


@eqx.filter_jit
def _linearised(
    limits: Limits, axis: FrozenLoop, trajectory: JerkTrajectory
) -> tuple[Float[Array, " conditions"], Float[Array, "conditions n"]]:
    """Return the largest violation per group of samples and limit, and its gradient by the jerk."""

    def excess(jerk: Float[Array, " n"]) -> Float[Array, " conditions"]:
        moved = eqx.tree_at(lambda t: t.jerk, trajectory, jerk)
        sides = axis_violations(limits, axis(moved))
        return jnp.concatenate([_worst_of_groups(side, _GROUPS * jerk.size) for side in sides])

    return excess(trajectory.jerk), jax.jacfwd(excess)(trajectory.jerk)


def _worst_of_groups(side: Float[Array, " ticks"], count: int) -> Float[Array, " groups"]:
    length = -(-side.size // count)
    padding = jnp.full(-side.size % length, -jnp.inf)
    return jnp.max(jnp.append(side, padding).reshape(-1, length), axis=1)


def _asked(system: System, trajectory: JerkTrajectory, ticks: int) -> Envelope:
    """Return the states of a motion at the end of each sample, and the input at its start."""
    period = trajectory.duration / ticks
    states = trajectory.states(jnp.arange(ticks + 1) * period)
    position, velocity = (exactly(x[1:]) for x in (states.position, states.velocity))
    demand = jax.tree.map(lambda x: x[:-1], input_demand(system, states))
    rate = jax.tree.map(lambda x: jnp.diff(x, prepend=x[:1]) / period, demand)
    return Envelope(position, velocity, demand, rate)
