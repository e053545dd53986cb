"""The limits of the axis itself for a small change of its motion.

What the axis adds to its motion, tracking errors and feedback effort, hardly changes with the
motion. Taken as fixed it turns the limits of the axis into limits of the motion that need no
simulation: exact where it was frozen, and who takes a step looks again.
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

_GROUPS = 4  # of ticks per interval of the motion, about: the worst of each gives a condition
_BLEND = 0.02  # of the top speed: friction jumps faster than a step of a search can follow


class FrozenLoop(Prediction):
    """The axis adds to any motion what it was seen to add to one.

    Attributes:
        model: for what a motion asks of the input, its jumps spread.
        added: to what the motion asks for, tick by tick.
    """

    model: System
    added: Envelope

    @property
    def system(self) -> System:
        return self.model

    def __call__(self, trajectory: JerkTrajectory) -> Envelope:
        asked = _asked(self.model, trajectory, self.added.input.lower.size)
        return Envelope(*(a + b for a, b in zip(asked, self.added, strict=True)))


def freeze(axis: Prediction, limits: Limits, trajectory: JerkTrajectory) -> FrozenLoop:
    """What an axis adds to this motion, to be added to others near to it."""
    found = axis(trajectory)
    model = smoothed(axis.system, _BLEND * jnp.max(jnp.abs(limits.velocity)))
    asked = _asked(model, trajectory, found.input.lower.size)
    added = jax.tree.map(lambda whole, part: whole - part, found, asked)
    return FrozenLoop(model, added)


def fixed_margins(
    system: System, ticks: int, margins: tuple[float, float, float, float]
) -> FrozenLoop:
    """An axis that follows its motion but for given margins: plan by the input limit, not by (18).

    Args:
        system: whose δ and box say what a motion may ask of the input.
        ticks: at which the limits are looked at, a multiple of the intervals of the motion.
        margins: of position, velocity, input and input rate, in their units.
    """
    widths = [jnp.full(ticks, margin) for margin in margins]
    return FrozenLoop(system, Envelope(*(around(width) for width in widths)))


def axis_conditions(
    planned: Inequalities, limits: Limits, axis: FrozenLoop, trajectory: JerkTrajectory
) -> Inequalities:
    """The conditions of a motion and, linearised there, those of the axis.

    Args:
        planned: of the motion, for its jerk in `planned.unit`.
        limits: of the axis.
        axis: frozen at the motion.
        trajectory: the motion, without padding.
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
    """The worst of each group of ticks for each limit, and its slopes over the jerk."""

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
    """What a motion itself asks for: its states after, and the input at the start of each tick."""
    period = trajectory.duration / ticks
    states = trajectory.states(jnp.arange(ticks + 1) * period)
    position, velocity = (exactly(x[1:]) for x in (states.position, states.velocity))
    demand = jax.tree.map(lambda x: x[:-1], input_demand(system, states))
    rate = jax.tree.map(lambda x: jnp.diff(x, prepend=x[:1]) / period, demand)
    return Envelope(position, velocity, demand, rate)
