"""Least squares of a log: a first estimate with its residual, without any bound."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.loop.log import Log, padded
from jaxid.model.system import System

_LEAST = 5  # least samples of a mean, so that the noise of second differences is small
_PIECES = 10  # least number of means of a log of median length
_APART = 1e-3  # singular values of the normalised columns below this count as zero
_PART = 0.01  # least component of a parameter in their singular vectors


class LeastSquaresFit(NamedTuple):
    """A least-squares estimate from k rows, each the mean over some samples, with its residual.

    Attributes:
        theta: estimate, shape (m,), in the units of the parameters; it has no guaranteed bound.
        shift: largest change of the estimate by a disturbance as large as the largest residual,
            shape (m,), in the units of the parameters.
        time: time of each row since the first sample of the first log, without the gaps between
            logs, s, shape (k,).
        position: position of each row, m or rad, shape (k,).
        velocity: velocity of each row, m/s or rad/s, shape (k,).
        residual: residual u − φᵀθ of each row, in the unit of the input, shape (k,).
    """

    theta: Float[np.ndarray, " m"]
    shift: Float[np.ndarray, " m"]
    time: Float[np.ndarray, " k"]
    position: Float[np.ndarray, " k"]
    velocity: Float[np.ndarray, " k"]
    residual: Float[np.ndarray, " k"]


def fit_least_squares(system: System, logs: Sequence[Log], means: int = 2000) -> LeastSquaresFit:
    """Return the least-squares estimate of logs; the prior box is not used.

    Velocities and accelerations are differences of positions, with one stencil for all columns.

    Args:
        system: axis with its regressors.
        logs: logs of one axis.
        means: approximate number of rows for the fit, each the mean over some samples.

    Raises:
        ValueError: if there are too few rows, or some parameters are not separately identifiable.
    """
    logs = list(map(padded, logs))
    counts = [log.samples for log in logs]
    width = max(min(sum(counts) // means, int(np.median(counts)) // _PIECES), _LEAST)
    parts = [_means(system, log, n, width) for log, n in zip(logs, counts, strict=True)]
    phi, u, time, position, velocity = (np.concatenate(x) for x in zip(*parts, strict=True))
    require(
        len(u) > phi.shape[1],
        f"Argument `logs` must have more than {phi.shape[1] * width} consecutive samples for a "
        "least-squares fit.",
    )
    size = np.linalg.norm(phi, axis=0)
    scaled = phi / np.where(size > 0, size, 1.0)
    _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
    unseen = np.max(np.abs(directions[singular <= _APART]), axis=0, initial=0.0)
    mixed = [name for name, part in zip(system.names, unseen, strict=True) if part > _PART]
    require(
        not mixed,
        f"Argument `logs` does not identify {' and '.join(mixed)} separately: record a motion with "
        "several speeds and accelerations in both directions.",
    )
    weights = np.linalg.pinv(scaled) / size[:, None]
    theta = weights @ u
    rest = u - phi @ theta
    shift = np.abs(weights).sum(axis=1) * np.max(np.abs(rest))
    lengths = [float(log.period) * n for log, n in zip(logs, counts, strict=True)]
    since = np.repeat(np.cumsum([0.0, *lengths[:-1]]), [len(part[1]) for part in parts])
    return LeastSquaresFit(theta, shift, time + since, position, velocity, rest)


def _means(system: System, log: Log, n: int, width: int) -> tuple[np.ndarray, ...]:
    """Return regressors, input, time, position and velocity of n samples, one row per mean."""
    phi, *others = _columns(system, log)
    count = (n - 1) // width
    means = [
        np.asarray(c)[: count * width].reshape(count, width).mean(axis=1) for c in (*phi, *others)
    ]
    m = len(phi)
    return np.stack(means[:m], axis=1), *means[m:]


@eqx.filter_jit
def _columns(system: System, log: Log) -> tuple[tuple[Array, ...], Array, Array, Array, Array]:
    """Return regressors, input, time, position and velocity at the inner samples of a log."""
    h, y, u = log.period, log.position, log.input
    v = (y[2:] - y[:-2]) / (2 * h)
    phi = system.regressors(y[1:-1], v, jnp.diff(y, 2) / h**2)
    return phi, (u[1:] + u[:-1]) / 2, h * jnp.arange(1, u.size), y[1:-1], v
