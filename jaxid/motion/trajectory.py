"""Motions y(t) with piecewise-constant jerk: exact states, exact extrema between the knots (16)."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxid._checks import is_concrete, require_at_least_zero, require_concrete, require_shape
from jaxid._folding import compiled_apart
from jaxid._types import Motion, Numbers, Scalar, as_array, as_known
from jaxid.motion.ticks import Ticks


class States(NamedTuple):
    """Position, velocity and acceleration at the same instants, in SI units of the axis.

    Attributes:
        position: y, m or rad.
        velocity: ẏ, m/s or rad/s.
        acceleration: ÿ, m/s² or rad/s².
    """

    position: Motion
    velocity: Motion
    acceleration: Motion


class Extrema(NamedTuple):
    """The lowest and highest values of a motion over all of its time, between the knots too.

    Attributes:
        position: (lowest, highest) position, m or rad.
        velocity: (lowest, highest) velocity, m/s or rad/s.
        acceleration: (lowest, highest) acceleration, m/s² or rad/s².
        jerk: (lowest, highest) jerk, m/s³ or rad/s³.
    """

    position: Float[Array, "2"]
    velocity: Float[Array, "2"]
    acceleration: Float[Array, "2"]
    jerk: Float[Array, "2"]


class JerkTrajectory(eqx.Module):
    """A motion given by its start state and a jerk that is constant on each of n intervals.

    Attributes:
        start: state [y, ẏ, ÿ] at t = 0, SI units.
        jerk: jerk of each interval, m/s³ or rad/s³.
        durations: duration of each interval, s. An interval of duration zero is padding and has
            no effect, so that motions of different length can share one shape and one compilation.

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
        require_at_least_zero("durations", "a trajectory", self.durations)

    @property
    def counted(self) -> Bool[Array, " n"]:
        """A mask of the intervals whose duration is not zero, i.e. that are not padding."""
        return self.durations > 0

    @property
    def duration(self) -> Scalar:
        """The duration t_f of the motion, s."""
        return jnp.sum(self.durations)

    def knot_times(self) -> Float[Array, " knots"]:
        """Return the n + 1 times at which an interval begins or ends, from 0 to t_f, in s."""
        return jnp.concatenate([jnp.zeros(1, self.durations.dtype), jnp.cumsum(self.durations)])

    def knot_states(self) -> States:
        """Return the states at the n + 1 knots, where an interval begins or ends."""
        j, T = self.jerk, self.durations
        a = _running(self.start[2], j * T)
        v = _running(self.start[1], a[:-1] * T + j * T**2 / 2)
        y = _running(self.start[0], v[:-1] * T + a[:-1] * T**2 / 2 + j * T**3 / 6)
        return States(y, v, a)

    def states(self, times: Float[Array, " k"]) -> States:
        """Return the states at any times.

        Args:
            times: instants, s, shape (k,); before 0 and after t_f the first or last state is
                returned.
        """
        times = jnp.clip(times, 0.0, self.duration)
        knots = self.knot_times()
        # "right" skips intervals of no duration
        i = jnp.clip(jnp.searchsorted(knots, times, side="right") - 1, 0, self.jerk.size - 1)
        y, v, a = (x[:-1][i] for x in self.knot_states())
        return _advance(y, v, a, self.jerk[i], times - knots[i])

    def inside(self, fractions: Float[Array, " q"]) -> States:
        """Return the states at the same q fractions of every interval, shape (n, q).

        Args:
            fractions: fractions of the duration of an interval, 0 to 1, shape (q,).
        """
        y, v, a = (x[:-1, None] for x in self.knot_states())
        return _advance(y, v, a, self.jerk[:, None], self.durations[:, None] * fractions[None, :])

    def midpoints(self, count: int) -> tuple[States, Float[Array, " nodes"]]:
        """Return a midpoint rule with `count` nodes per interval, for integrals over time.

        Returns:
            The states at the n·count nodes, and the weights of the nodes in s.
        """
        fractions = (jnp.arange(count) + 0.5) / count
        weights = jnp.repeat(self.durations / count, count)
        return States(*(x.ravel() for x in self.inside(fractions))), weights

    def extrema(self) -> Extrema:
        """Return the lowest and highest position, velocity, acceleration and jerk, in closed form.

        They are exact between the knots too: the ends of every interval are compared with the
        instants inside it at which ẏ or ÿ changes sign.
        """
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
        """Return the jerk of each interval; padding gets that of the first other interval."""
        return jnp.where(self.counted, self.jerk, self.jerk[jnp.argmax(self.counted)])


def uniform(start: Numbers, jerk: Numbers, period: float) -> JerkTrajectory:
    """Return a motion whose intervals of constant jerk all last `period` seconds.

    Args:
        start: state [y, ẏ, ÿ] at t = 0, SI units.
        jerk: jerk of each interval, m/s³ or rad/s³, shape (n,).
        period: duration of each interval, s.
    """
    jerk = as_array("jerk")(jerk)
    durations = np.full(jerk.shape, as_known("period")(period))  # known, even where jerk is traced
    return JerkTrajectory(jnp.asarray(start, jerk.dtype), jerk, durations)


@eqx.filter_jit
def states_at(trajectory: JerkTrajectory, times: Float[Array, " k"]) -> States:
    """Return the states at any times, by one compiled function.

    Outside of other compiled functions, the method `states` compiles each of its operations alone,
    which takes 0.7 s.

    Args:
        trajectory: motion.
        times: instants, s, shape (k,).
    """
    return trajectory.states(times)


@eqx.filter_jit
def extrema_of(trajectory: JerkTrajectory) -> Extrema:
    """Return the lowest and highest values of a motion, by one compiled function: see `states_at`.

    Args:
        trajectory: motion.
    """
    return trajectory.extrema()


def ticks(trajectory: JerkTrajectory, period: float) -> int:
    """Return the number of sample periods that a motion lasts.

    Args:
        trajectory: motion.
        period: sample period of the controller, s.

    Raises:
        ValueError: if the motion does not last a whole number of sample periods.
    """
    durations = trajectory.durations
    if not is_concrete((durations, period)):
        require_concrete(
            "the number of sample periods",
            "Trace the jerk alone, or a `jaxid.loop.closed_loop.closed_loop` made before.",
            durations=durations,
            period=period,
        )
    # not in jax, where even known numbers are traced under `jit`
    duration = float(np.asarray(durations).sum())
    exact = duration / period
    if abs(exact - round(exact)) >= 1e-6:
        raise ValueError(
            f"Argument `period` = {period:g} s must divide the duration of the motion, "
            f"{duration:g} s, which is {exact:.6g} periods."
        )
    return round(exact)


def reference(
    trajectory: JerkTrajectory, period: Scalar | float, ticks: int, repeats: int = 1
) -> States:
    """Return the states at every sample instant of a motion that is repeated back to back.

    This is the reference of Section III. Its arrays have shape (repeats·ticks,).

    Args:
        trajectory: motion; it should end in its start state, otherwise the reference jumps.
        period: sample period of the controller, s.
        ticks: number of sample instants of one motion, see `ticks`. If the motion is shorter, the
            repeats still follow one another without a pause, and the last state is held at the end.
        repeats: number of times that the motion is run.
    """
    return _reference(trajectory, jnp.asarray(period), ticks, repeats)


@eqx.filter_jit
def _reference(trajectory: JerkTrajectory, period: Scalar, ticks: int, repeats: int) -> States:
    times = jnp.arange(ticks) * period
    # compiled apart: otherwise the repeats would be computed one by one, with other last bits
    once = compiled_apart(JerkTrajectory.states)(trajectory, times)
    return States(*map(ticks_of(trajectory, period, ticks, repeats).repeated, once))


def ticks_of(
    trajectory: JerkTrajectory, period: Scalar | float, most: int, repeats: int = 1
) -> Ticks:
    """Return the sample instants of a motion in arrays of fixed length, for JAX transformations.

    In contrast to `ticks`, the duration of the motion may be traced and is not checked.

    Args:
        trajectory: motion.
        period: sample period of the controller, s.
        most: largest number of sample instants of one motion.
        repeats: number of times that the motion is run.
    """
    return Ticks.of(trajectory.duration, period, most, repeats)


def _running(first: Scalar, increments: Float[Array, " n"]) -> Float[Array, " n+1"]:
    return jnp.concatenate([first[None], first + jnp.cumsum(increments)])


def _advance(y: Any, v: Any, a: Any, j: Any, t: Any) -> States:
    """Return the states after a time t under the jerk j, for shapes that broadcast."""
    return States(
        y + t * (v + t * (a / 2 + t * j / 6)),
        v + t * (a + t * j / 2),
        a + t * j,
    )


def _zero_of_line(constant: Motion, slope: Motion) -> Motion:
    """Return the t where constant + slope·t = 0; 0 where the slope is zero."""
    flat = slope == 0
    return jnp.where(flat, 0.0, -constant / jnp.where(flat, 1.0, slope))


def _zeros(a: Motion, v: Motion, j: Motion) -> tuple[Motion, Motion]:
    """Return both roots t of v + a·t + j·t²/2, without cancellation; 0 where there is none."""
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
    """Return the same motion with intervals of duration zero appended, `size` intervals in all."""
    extra = size - trajectory.jerk.size
    return JerkTrajectory(
        trajectory.start,
        jnp.pad(trajectory.jerk, (0, extra)),
        jnp.pad(trajectory.durations, (0, extra)),
    )


def trimmed(trajectory: JerkTrajectory) -> JerkTrajectory:
    """Return the same motion without its intervals of duration zero."""
    keep = np.flatnonzero(np.asarray(trajectory.durations) > 0)
    return JerkTrajectory(trajectory.start, trajectory.jerk[keep], trajectory.durations[keep])
