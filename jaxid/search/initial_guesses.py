"""Where a search begins: random motions, rearranged good ones, and longer copies of shorter ones.

Good motions dwell: at top speed, just above a threshold of δ, at rest. How long they dwell where is
a valley that gradients follow badly, since moving a pulse in time means changing every jerk of it.
Cutting a piece out of one dwell and putting it into another is one step along that valley.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from jaxid.motion.motion_space import MotionSpace

Jerk = Float[np.ndarray, " n"]
Knots = Float[np.ndarray, " knots"]

# |a|/a_max up to about this counts as dwelling; most intervals moved at once, and moves per start
_DWELL, _PIECE, _MOVES = 0.05, 6, 3
# disturbance of a rearranged start, in normalised trajectory
_SPREAD = 0.1


def random_starts(key: PRNGKeyArray, space: MotionSpace, count: int) -> Float[Array, "count d"]:
    """Normal coordinates: all frequencies, at about the size of the limits."""
    return jax.random.normal(key, (count, space.basis.shape[1]))


def rearranged(
    key: PRNGKeyArray,
    space: MotionSpace,
    parents: Sequence[Float[Array, " n"]],
    period: float,
    acceleration: float,
    count: int,
) -> Float[Array, "count d"]:
    """Each parent itself and variations of it, with pieces moved from dwell to dwell.

    Args:
        key: of the random choices.
        space: of the motions.
        parents: jerks without padding, all of one length.
        period: of an interval, s.
        acceleration: the limit that a dwell is small against.
        count: how many starts in all, a multiple of the number of parents.
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
    parents: Sequence[Float[Array, " n"]],
    intervals: int,
    count: int,
) -> Float[Array, "count d"]:
    """Longer copies of shorter motions, with intervals of no jerk put in at random places.

    Args:
        key: of the random choices.
        space: of the longer motions.
        parents: jerks without padding, shorter than `intervals`.
        intervals: of the longer motions.
        count: how many starts in all.
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
    """|a|/a_max at the knots of a motion that starts without acceleration."""
    return np.abs(np.append(0.0, np.cumsum(jerk) * period)) / acceleration


def _preferring_calm(business: Knots) -> Knots:
    chances = np.exp(-business / _DWELL) + 1e-12
    return chances / chances.sum()


def _coordinates(
    rng: np.random.Generator, space: MotionSpace, jerks: Sequence[Jerk], spread: Sequence[float]
) -> Float[Array, "count d"]:
    z = jnp.stack([space.coordinates(jnp.asarray(jerk)) for jerk in jerks])
    return z + jnp.asarray(rng.normal(size=z.shape) * np.asarray(spread)[:, None])


def _generator(key: PRNGKeyArray) -> np.random.Generator:
    return np.random.default_rng(np.asarray(jax.random.key_data(key)))
