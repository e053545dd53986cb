"""What leads to an experiment: a gentle move to its start, waiting, motions one after another."""

from itertools import pairwise
from math import ceil, sqrt

import jax.numpy as jnp
import numpy as np

from jaxid._checks import require
from jaxid.motion.limits import Limits
from jaxid.motion.trajectory import JerkTrajectory, uniform

_GENTLE = 0.5  # of speed, acceleration and jerk, chosen: nobody waits for an approach
_WHOLE = 1e-9  # intervals, by which rounding may miss a whole number of them


def approach(limits: Limits, home: float, start: float, period: float) -> JerkTrajectory:
    """From rest to rest with at most half of the speed, acceleration and jerk allowed.

    Seven phases of jerk J, 0, −J, 0, −J, 0, J: the shortest in continuous time, each rounded up to
    whole intervals. It stays on the way from one end to the other.

    Args:
        limits: kept.
        home: where it begins, m or rad.
        start: where it ends.
        period: of each interval of constant jerk, s.

    Raises:
        ValueError: if the axis cannot rest at both ends.
    """
    low, high = (float(end) for end in limits.position)
    for name, position in (("home", home), ("start", start)):
        require(
            low <= position <= high,
            f"Argument `{name}` must be between the limits {low:g} and {high:g} of the position, "
            f"but is {position:g}.",
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
    """Rest."""
    return uniform(jnp.array([position, 0.0, 0.0]), jnp.zeros(intervals), period)


def joined(*motions: JerkTrajectory) -> JerkTrajectory:
    """One after another: each begins in the state in which the one before ends.

    Raises:
        ValueError: if one does not, to a millionth.
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
    """Intervals of each phase of jerk, of steady acceleration and of steady velocity.

    The shortest in continuous time, then rounded up: with phases of t, s and c seconds the peaks
    are d/(t(t + s)(2t + s + c)) of the jerk, t times that of the acceleration, and t + s times that
    of the velocity.
    """

    def rounded(time: float) -> int:
        return ceil(time / period - _WHOLE)

    ramp = min(a / j, sqrt(v / j), (way / (2 * j)) ** (1 / 3))
    rise = min(v / (j * ramp), (sqrt(ramp**2 + 4 * way / (j * ramp)) - ramp) / 2)
    t, s = max(rounded(ramp), 1), rounded(rise - ramp)
    ramp, rise = t * period, (t + s) * period
    whole = max(way / v, way / (a * rise), way / (j * ramp * rise))
    return t, s, max(rounded(whole - ramp - rise), 0)
