"""Starts of a search: random motions, rearranged good ones, and longer copies of shorter ones.

Good motions hold a few speeds for some time. Gradients change these times only slowly, since moving
a pulse in time means changing every jerk of it. Moving a piece from one phase of constant speed to
another is one step in that direction.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from jaxid.motion.motion_space import MotionSpace

Jerk = Float[np.ndarray, " n"]
Knots = Float[np.ndarray, " knots"]

# scale of |a|/a_max for nearly constant speeds; most intervals per move; most moves per start
_DWELL, _PIECE, _MOVES = 0.05, 6, 3
# random change of a rearranged start, in normalised coordinates
_SPREAD = 0.1


def random_starts(key: PRNGKeyArray, space: MotionSpace, count: int) -> Float[Array, "count d"]:
    """Return random coordinates of motions, independent standard normal, one row per motion.

    They contain all frequencies, at about the size of the limits.

    Args:
        key: JAX key of the random numbers.
        space: coordinates of the motions.
        count: number of motions.
    """
    return jnp.asarray(_generator(key).normal(size=(count, space.basis.shape[1])))


def rearranged(
    key: PRNGKeyArray,
    space: MotionSpace,
    parents: Sequence[Float[Array | np.ndarray, " n"]],
    period: float,
    acceleration: float,
    count: int,
) -> Float[Array, "count d"]:
    """Return each parent and variations of it with pieces moved between phases of constant speed.

    Args:
        key: JAX key of the random choices.
        space: coordinates of the motions.
        parents: jerks of the parents without padding, all of one length.
        period: duration of an interval, s.
        acceleration: acceleration limit, m/s² or rad/s²; a phase of constant speed has much less.
        count: number of starts in all, a multiple of the number of parents.

    Returns:
        Coordinates in `space`, one row per start.
    """
    rng = _generator(key)
    jerks, spread = [], []
    for parent in parents:
        for k in range(count // len(parents)):
            jerk = np.asarray(parent)
            for _ in range(int(rng.integers(1, _MOVES + 1)) if k else 0):
                jerk = _move(rng, jerk, period, acceleration)
            jerks.append(jerk)
            spread.append(_SPREAD if k else 0.0)
    return _coordinates(rng, space, jerks, spread)


def grown(
    key: PRNGKeyArray,
    space: MotionSpace,
    parents: Sequence[Float[Array | np.ndarray, " n"]],
    intervals: int,
    count: int,
) -> Float[Array, "count d"]:
    """Return longer copies of shorter motions, with intervals of zero jerk inserted at random.

    Args:
        key: JAX key of the random choices.
        space: coordinates of the longer motions.
        parents: jerks of the shorter motions without padding.
        intervals: number of intervals of the longer motions.
        count: number of starts in all.

    Returns:
        Coordinates in `space`, one row per start.
    """
    rng = _generator(key)
    jerks = []
    for k in range(count):
        jerk = np.asarray(parents[k % len(parents)])
        while jerk.size < intervals:
            piece = int(rng.integers(1, intervals - jerk.size + 1))
            jerk = np.insert(jerk, int(rng.integers(0, jerk.size + 1)), np.zeros(piece))
        jerks.append(jerk)
    return _coordinates(rng, space, jerks, [_SPREAD] * count)


def _move(rng: np.random.Generator, jerk: Jerk, period: float, acceleration: float) -> Jerk:
    piece = int(rng.integers(1, min(_PIECE, jerk.size - 1) + 1))
    busy = _business(jerk, period, acceleration)
    windows = np.lib.stride_tricks.sliding_window_view(busy, piece + 1).max(axis=1)
    cut = int(rng.choice(windows.size, p=_preferring_calm(windows)))
    rest = np.delete(jerk, slice(cut, cut + piece))
    busy = _business(rest, period, acceleration)
    place = int(rng.choice(busy.size, p=_preferring_calm(busy)))
    return np.insert(rest, place, np.zeros(piece))


def _business(jerk: Jerk, period: float, acceleration: float) -> Knots:
    """Return |a|/a_max at the knots of a motion that starts with zero acceleration."""
    return np.abs(np.append(0.0, np.cumsum(jerk) * period)) / acceleration


def _preferring_calm(business: Knots) -> Knots:
    chances = np.exp(-business / _DWELL) + 1e-12
    return chances / chances.sum()


def _coordinates(
    rng: np.random.Generator, space: MotionSpace, jerks: Sequence[Jerk], spread: Sequence[float]
) -> Float[Array, "count d"]:
    own = np.zeros((len(jerks), space.offset.size))
    for row, jerk in zip(own, jerks, strict=True):
        row[: jerk.size] = jerk
    z = (own - np.asarray(space.offset)) @ np.asarray(space.inverse).T
    return jnp.asarray(z + rng.normal(size=z.shape) * np.asarray(spread)[:, None])


def _generator(key: PRNGKeyArray) -> np.random.Generator:
    return np.random.default_rng(np.asarray(jax.random.key_data(key)))
