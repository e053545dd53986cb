"""Motions y(t) with piecewise-constant jerk: exact states, exact extrema between the knots (16)."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxid._checks import require, require_concrete, require_shape
from jaxid._types import Motion, Numbers, Scalar, as_array, as_known
from jaxid.motion.ticks import Ticks


class States(NamedTuple):
    """Position, velocity and acceleration at the same instants, in SI units of the axis."""

    position: Motion
    velocity: Motion
    acceleration: Motion


class Extrema(NamedTuple):
    """(lowest, highest) value that a motion takes at any time, knots and in-between."""

    position: Float[Array, "2"]
    velocity: Float[Array, "2"]
    acceleration: Float[Array, "2"]
    jerk: Float[Array, "2"]


class JerkTrajectory(eqx.Module):
    """A motion from `start` under a jerk that is constant on each of n intervals.

    Attributes:
        start: [y, ẏ, ÿ] at t = 0.
        jerk: one value per interval, m/s³ or rad/s³.
        durations: of the intervals, s. An interval of duration zero does nothing: motions of
            different length share one shape, and one compilation, by padding with such intervals.

    Example:
        >>> signs = jnp.array([1.0, -1.0, 0.0, -1.0, 1.0, -1.0, 1.0, 0.0, 1.0, -1.0])
        >>> start, jerk = jnp.array([0.1, 0.0, 0.0]), jnp.repeat(120.0 * signs, 6)
        >>> motion = jd.JerkTrajectory(start, jerk, jnp.full(60, 0.01))
        >>> motion.extrema().velocity.round(3).tolist()  # m/s
        [-0.432, 0.432]
    """

    start: Float[Array, "3"] = eqx.field(converter=as_array("start"))
    jerk: Float[Array, " n"] = eqx.field(converter=as_array("jerk"))
    durations: Float[Array, " n"] = eqx.field(converter=as_array("durations"))

    def __check_init__(self) -> None:
        require_shape("start", "a trajectory", self.start, (3,), "position, velocity, acceleration")
        intervals = jnp.shape(self.jerk)[:1]
        require_shape("jerk", "a trajectory", self.jerk, intervals or (1,), "one per interval")
        require_shape("durations", "a trajectory", self.durations, intervals, "one per interval")

    @property
    def counted(self) -> Bool[Array, " n"]:
        """Which intervals last: the others say nothing of the motion, whatever their jerk."""
        return self.durations > 0

    @property
    def duration(self) -> Scalar:
        """t_f in s."""
        return jnp.sum(self.durations)

    def knot_times(self) -> Float[Array, " knots"]:
        """When the jerk changes, from 0 to t_f."""
        return jnp.concatenate([jnp.zeros(1, self.durations.dtype), jnp.cumsum(self.durations)])

    def knot_states(self) -> States:
        """States at the n + 1 knots: a triple integrator advanced by running sums."""
        j, T = self.jerk, self.durations
        a = _running(self.start[2], j * T)
        v = _running(self.start[1], a[:-1] * T + j * T**2 / 2)
        y = _running(self.start[0], v[:-1] * T + a[:-1] * T**2 / 2 + j * T**3 / 6)
        return States(y, v, a)

    def states(self, times: Float[Array, " k"]) -> States:
        """States at any times; before 0 and after t_f those of the nearest end."""
        times = jnp.clip(times, 0.0, self.duration)
        knots = self.knot_times()
        # "right" skips intervals of no duration
        i = jnp.clip(jnp.searchsorted(knots, times, side="right") - 1, 0, self.jerk.size - 1)
        y, v, a = (x[:-1][i] for x in self.knot_states())
        return _advance(y, v, a, self.jerk[i], times - knots[i])

    def inside(self, fractions: Float[Array, " q"]) -> States:
        """States at the same fractions (0 to 1) of every interval, each of shape (n, q)."""
        y, v, a = (x[:-1, None] for x in self.knot_states())
        return _advance(y, v, a, self.jerk[:, None], self.durations[:, None] * fractions[None, :])

    def midpoints(self, count: int) -> tuple[States, Float[Array, " nodes"]]:
        """A midpoint rule with `count` nodes per interval: states, and weights in s."""
        fractions = (jnp.arange(count) + 0.5) / count
        weights = jnp.repeat(self.durations / count, count)
        return States(*(x.ravel() for x in self.inside(fractions))), weights

    def extrema(self) -> Extrema:
        """Closed form: the ends of every interval, and where ẏ or ÿ changes sign inside it."""
        y, v, a = self.knot_states()
        start, j, T = (y[:-1], v[:-1], a[:-1]), self.jerk, self.durations
        turns = [
            jnp.clip(t, 0.0, T) for t in (_zero_of_line(a[:-1], j), *_zeros(a[:-1], v[:-1], j))
        ]
        inner = [_advance(*start, j, t) for t in turns]
        return Extrema(
            _span(y, *(s.position for s in inner)),
            _span(v, inner[0].velocity),
            _span(a),
            _span(self._lasting_jerk()),
        )

    def _lasting_jerk(self) -> Float[Array, " n"]:
        """The jerk, that of the first interval that lasts for those that do not."""
        return jnp.where(self.counted, self.jerk, self.jerk[jnp.argmax(self.counted)])


def uniform(start: Numbers, jerk: Numbers, period: float) -> JerkTrajectory:
    """A trajectory whose intervals all last `period` seconds."""
    jerk = as_array("jerk")(jerk)
    durations = np.full(jerk.shape, as_known("period")(period))  # known, even where jerk is traced
    return JerkTrajectory(jnp.asarray(start, jerk.dtype), jerk, durations)


def ticks(trajectory: JerkTrajectory, period: float) -> int:
    """How many controller ticks of `period` seconds a motion lasts: a whole number, or refused."""
    require_concrete(
        "the number of sample periods",
        "Trace the jerk alone, or a `jaxid.loop.closed_loop.closed_loop` made before.",
        durations=trajectory.durations,
        period=period,
    )
    # not in jax, where even known numbers are traced under `jit`
    duration = float(np.sum(np.asarray(trajectory.durations)))
    exact = duration / period
    require(
        abs(exact - round(exact)) < 1e-6,
        f"Argument `period` must divide the duration {duration:g} s of the motion, "
        f"but {period:g} s goes into it {exact:.6g} times.",
    )
    return round(exact)


def reference(
    trajectory: JerkTrajectory, period: Scalar | float, ticks: int, repeats: int = 1
) -> States:
    """The states at every controller tick of the motion repeated back to back, as in Section III.

    Args:
        trajectory: should end in the state it starts from, or the reference jumps.
        period: of the controller, s.
        ticks: of one motion, see `ticks`. Of a shorter one the repeats follow one another as soon,
            and after the last one the axis is left where it is.
        repeats: how many times the motion is run.
    """
    once = trajectory.states(jnp.arange(ticks) * period)
    return States(*map(ticks_of(trajectory, period, ticks, repeats).repeated, once))


def ticks_of(
    trajectory: JerkTrajectory, period: Scalar | float, most: int, repeats: int = 1
) -> Ticks:
    """Which of so many ticks are those of a motion; unlike for `ticks` it may be traced."""
    return Ticks.of(trajectory.duration, period, most, repeats)


def _running(first: Scalar, increments: Float[Array, " n"]) -> Float[Array, " n+1"]:
    return jnp.concatenate([first[None], first + jnp.cumsum(increments)])


def _advance(y: Any, v: Any, a: Any, j: Any, t: Any) -> States:
    """The states after t under the jerk j, for shapes that broadcast."""
    return States(
        y + t * (v + t * (a / 2 + t * j / 6)),
        v + t * (a + t * j / 2),
        a + t * j,
    )


def _zero_of_line(constant: Motion, slope: Motion) -> Motion:
    """Where constant + slope·t = 0; 0 where it never is."""
    flat = slope == 0
    return jnp.where(flat, 0.0, -constant / jnp.where(flat, 1.0, slope))


def _zeros(a: Motion, v: Motion, j: Motion) -> tuple[Motion, Motion]:
    """Both roots of v + a·t + j·t²/2 in the form that cancels nothing; 0 where there is none."""
    discriminant = a**2 - 2 * j * v
    q = -(a + jnp.where(a >= 0, 1.0, -1.0) * jnp.sqrt(jnp.maximum(discriminant, 0.0)))
    real = discriminant >= 0
    return (
        jnp.where(real & (j != 0), q / jnp.where(j != 0, j, 1.0), 0.0),
        jnp.where(real & (q != 0), 2 * v / jnp.where(q != 0, q, 1.0), 0.0),
    )


def _span(*values: Float[Array, "..."]) -> Float[Array, "2"]:
    return jnp.stack(
        [
            jnp.min(jnp.stack([jnp.min(x) for x in values])),
            jnp.max(jnp.stack([jnp.max(x) for x in values])),
        ]
    )


def padded(trajectory: JerkTrajectory, size: int) -> JerkTrajectory:
    """The same motion with intervals of no duration appended, up to `size` in all."""
    extra = size - trajectory.jerk.size
    return JerkTrajectory(
        trajectory.start,
        jnp.pad(trajectory.jerk, (0, extra)),
        jnp.pad(trajectory.durations, (0, extra)),
    )


def trimmed(trajectory: JerkTrajectory) -> JerkTrajectory:
    """The same motion without its intervals of no duration."""
    keep = np.flatnonzero(np.asarray(trajectory.durations) > 0)
    return JerkTrajectory(trajectory.start, trajectory.jerk[keep], trajectory.durations[keep])
