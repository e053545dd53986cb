"""Motions before an experiment: a slow move to its start, waiting, and joined motions."""

from itertools import pairwise
from math import ceil, sqrt

import jax.numpy as jnp
import numpy as np

from jaxid._checks import require
from jaxid.motion.limits import Limits
from jaxid.motion.trajectory import JerkTrajectory, uniform

_GENTLE = 0.5  # of the limits of speed, acceleration and jerk
_WHOLE = 1e-9  # intervals: tolerance for rounding of a whole number of them


def approach(limits: Limits, home: float, start: float, period: float) -> JerkTrajectory:
    """Return a rest-to-rest motion with at most half of the permitted speed, acceleration and jerk.

    Its seven phases have the jerk J, 0, −J, 0, −J, 0, J. They are the shortest in continuous time,
    each rounded up to whole intervals. The motion does not overshoot.

    Args:
        limits: limits of the axis.
        home: position at the beginning, m or rad.
        start: position at the end, where the experiment starts, m or rad.
        period: duration of each interval of constant jerk, s.

    Raises:
        ValueError: if `home` or `start` is outside the position limits.
    """
    low, high = (float(end) for end in limits.position)
    for name, position in (("start", start), ("home", home)):
        require(
            low <= position <= high,
            f"Argument `{name}` = {position:g} is outside the position limits [{low:g}, {high:g}].",
        )
    if home == start:
        return wait(home, 0, period)
    way, motion = start - home, (limits.velocity, limits.acceleration, limits.jerk)
    v, a, j = (_GENTLE * float(jnp.min(jnp.abs(ends))) for ends in motion)
    ramp, steady, cruise = _phases(abs(way), v, a, j, period)
    rise = ramp + steady
    jerk = way / (ramp * rise * (rise + ramp + cruise) * period**3)
    signs = np.repeat([1, 0, -1, 0, -1, 0, 1], [ramp, steady, ramp, cruise, ramp, steady, ramp])
    return uniform(jnp.array([home, 0.0, 0.0]), jnp.asarray(jerk * signs), period)


def wait(position: float, intervals: int, period: float) -> JerkTrajectory:
    """Return a motion at rest.

    Args:
        position: position, m or rad.
        intervals: number of intervals.
        period: duration of each interval, s.
    """
    return uniform(jnp.array([position, 0.0, 0.0]), jnp.zeros(intervals), period)


def joined(*motions: JerkTrajectory) -> JerkTrajectory:
    """Return several motions as one, in sequence.

    Raises:
        ValueError: if a motion does not begin in the state in which the one before it ends, to
            1e-6.
    """
    for one, other in pairwise(motions):
        end = jnp.stack([x[-1] for x in one.knot_states()])
        require(
            jnp.allclose(end, other.start, rtol=1e-6, atol=1e-6),
            f"Argument `motions`: one ends in {end.tolist()} and the next begins in "
            f"{other.start.tolist()}.",
        )
    jerk, durations = (
        jnp.concatenate([getattr(motion, name) for motion in motions])
        for name in ("jerk", "durations")
    )
    return JerkTrajectory(motions[0].start, jerk, durations)


def _phases(way: float, v: float, a: float, j: float, period: float) -> tuple[int, int, int]:
    """Return the number of intervals of a jerk phase, a steady acceleration and a steady velocity.

    They are the shortest in continuous time, then rounded up. With phases of t, s and c seconds,
    the peak jerk is d/(t(t + s)(2t + s + c)), the peak acceleration t times that, and the peak
    velocity t + s times the peak acceleration.
    """

    def rounded(time: float) -> int:
        return ceil(time / period - _WHOLE)

    ramp = min(a / j, sqrt(v / j), (way / (2 * j)) ** (1 / 3))
    rise = min(v / (j * ramp), (sqrt(ramp**2 + 4 * way / (j * ramp)) - ramp) / 2)
    t, s = max(rounded(ramp), 1), rounded(rise - ramp)
    ramp, rise = t * period, (t + s) * period
    whole = max(way / v, way / (a * rise), way / (j * ramp * rise))
    return t, s, max(rounded(whole - ramp - rise), 0)
