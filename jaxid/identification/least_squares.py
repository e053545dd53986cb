"""Least squares of a log as it is: a first estimate and what it leaves, without any bound."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxid._checks import require
from jaxid.loop.log import Log
from jaxid.model.system import System

_LEAST = 5  # rows of a mean, so that the noise of second differences is small
_PIECES = 10  # means of a log of the usual length, at least
_APART = 1e-3  # a combination of columns of length one that is shorter is zero to a fit
_PART = 0.01  # of such a combination, from which a parameter counts as one of it


class LeastSquaresFit(NamedTuple):
    """Means over some ticks each, k in all.

    Attributes:
        theta: the estimate, shape (m,); no bound goes with it.
        shift: of it by a disturbance as large as the largest residual, at worst; shape (m,).
        time: s, since the first tick of the first log, gaps left out; shape (k,) as the others.
        position: m or rad.
        velocity: m/s or rad/s.
        residual: of the input, in its unit: u − φᵀθ.
    """

    theta: Float[np.ndarray, " m"]
    shift: Float[np.ndarray, " m"]
    time: Float[np.ndarray, " k"]
    position: Float[np.ndarray, " k"]
    velocity: Float[np.ndarray, " k"]
    residual: Float[np.ndarray, " k"]


def fit_least_squares(system: System, logs: Sequence[Log], means: int = 2000) -> LeastSquaresFit:
    """The θ of least squares, whatever the box.

    Velocities and accelerations are differences of positions, by the same stencil in all columns.

    Args:
        system: for its regressors.
        logs: of one axis.
        means: of rows, at most, that the fit is made of.

    Raises:
        ValueError: if there are too few rows, or they cannot tell all parameters apart.
    """
    counts = [int(log.took_place().sum()) for log in logs]
    width = max(min(sum(counts) // means, int(np.median(counts)) // _PIECES), _LEAST)
    parts = [_means(system, log, n, width) for log, n in zip(logs, counts, strict=True)]
    phi, u, time, position, velocity = (np.concatenate(x) for x in zip(*parts, strict=True))
    require(
        len(u) > phi.shape[1],
        f"Argument `logs` must have more than {phi.shape[1]} times {width} ticks on end for a fit.",
    )
    size = np.linalg.norm(phi, axis=0)
    scaled = phi / np.where(size > 0, size, 1.0)
    _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
    unseen = np.max(np.abs(directions[singular <= _APART]), axis=0, initial=0.0)
    mixed = [name for name, part in zip(system.names, unseen, strict=True) if part > _PART]
    require(
        not mixed,
        f"Argument `logs`: the motion does not tell {' and '.join(mixed)} apart.",
    )
    weights = np.linalg.pinv(scaled) / size[:, None]
    theta = weights @ u
    rest = u - phi @ theta
    shift = np.abs(weights).sum(axis=1) * np.max(np.abs(rest))
    lengths = [float(log.period) * n for log, n in zip(logs, counts, strict=True)]
    since = np.repeat(np.cumsum([0.0, *lengths[:-1]]), [len(part[1]) for part in parts])
    return LeastSquaresFit(theta, shift, time + since, position, velocity, rest)


def _means(system: System, log: Log, n: int, width: int) -> tuple[np.ndarray, ...]:
    """Regressors, input, time, position and velocity of n ticks, one row per mean."""
    h = float(log.period)
    y, u = log.position[: n + 1], log.input[:n]
    v = (y[2:] - y[:-2]) / (2 * h)
    forces = system.regressors(y[1:-1], v, jnp.diff(y, 2) / h**2)
    columns = (*forces, (u[1:] + u[:-1]) / 2, h * jnp.arange(1, n), y[1:-1], v)
    count = (n - 1) // width
    means = [np.asarray(c)[: count * width].reshape(count, width).mean(axis=1) for c in columns]
    m = len(forces)
    return np.stack(means[:m], axis=1), *means[m:]
