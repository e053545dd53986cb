"""Residuals of logs, and their largest values that are consistent with δ and measurement errors."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.optimize import linprog

from jaxid.identification.regression_rows import RegressionRows, hats
from jaxid.identification.state_bounds import state_bounds
from jaxid.loop.log import Log, padded
from jaxid.model.system import System

_MEANS = 2000  # approximate number of means of all logs together, at most
_FEWEST = 20  # means of a log, about
_SHARE = 0.5  # limit of the measurement error of a mean, relative to δ


class Residuals(NamedTuple):
    """The residuals u − φᵀθ of k means over some samples, at one θ of the prior box.

    θ is the parameter vector whose largest residual is the smallest, relative to its bound. If the
    logs are consistent with the system, no residual exceeds its bound.

    Attributes:
        theta: θ, shape (m,), in the units of the parameters.
        time: time of each mean since the first sample of the first log, without the gaps between
            logs, s, shape (k,).
        position: position of each mean, m or rad, shape (k,).
        velocity: velocity of each mean, m/s or rad/s, shape (k,).
        residual: residual of each mean, in the unit of the input, shape (k,).
        bound: largest |residual| that |Δ| ≤ δ and the errors of the measurement allow, in the unit
            of the input, shape (k,).
        half_width: number of samples from the centre of a mean to its end; it is triangular.
    """

    theta: Float[np.ndarray, " m"]
    time: Float[np.ndarray, " k"]
    position: Float[np.ndarray, " k"]
    velocity: Float[np.ndarray, " k"]
    residual: Float[np.ndarray, " k"]
    bound: Float[np.ndarray, " k"]
    half_width: int

    @property
    def ratio(self) -> Float[np.ndarray, " k"]:
        """The residuals relative to their bounds; above 1 in magnitude they are inconsistent."""
        return self.residual / self.bound


def residuals(system: System, logs: Sequence[Log], factor: float = 1.0) -> Residuals:
    """Return the residuals of logs, at the θ of the prior box that explains them best.

    Args:
        system: axis with its prior box and disturbance bound δ.
        logs: logs of one axis.
        factor: multiple of δ, at least 1, that explains the logs, for the bounds of their states.

    Raises:
        InconsistentLogError: if no plant of the system can have produced one of the logs with the
            multiple of δ.
    """
    logs = list(map(padded, logs))
    known, wider = (system.with_scaled_disturbance(s) for s in (1.0, factor))
    rows = [hats(known, log, state_bounds(wider, log)) for log in logs]
    longest = max(range(len(logs)), key=lambda k: logs[k].samples)
    half_width = _half_width(rows[longest], logs[longest].samples)
    total = sum(log.samples for log in logs)
    step = max(half_width // 2, total // _MEANS, 1)
    starts = np.cumsum([0.0, *(log.samples * float(log.period) for log in logs)])
    parts = [
        _means(one, log, triangles(log.samples - 1, half_width, step, one), start)
        for one, log, start in zip(rows, logs, starts, strict=False)
    ]
    phi, input, bound, time, y, v = (np.concatenate(x) for x in zip(*parts, strict=True))
    theta = _best(phi / bound[:, None], input / bound, system)
    return Residuals(theta, time, y, v, input - phi @ theta, bound, half_width)


def triangles(count: int, half_width: int, step: int, logged: RegressionRows) -> sparse.csr_array:
    """Return weights of triangular means of the first `count` rows, one mean per row.

    A triangle suppresses the errors of second differences by the square of its width.

    Args:
        count: number of rows that are part of the log.
        half_width: number w of rows from the centre of a triangle to its end; its weights are
            (w − |j|)/w².
        step: number of rows from one centre to the next.
        logged: regression rows, with padding after those of the log.
    """
    centres = np.arange(half_width - 1, count - half_width + 1, step)
    offsets = np.arange(1 - half_width, half_width)
    weights = np.tile((half_width - np.abs(offsets)) / half_width**2, centres.size)
    columns = (centres[:, None] + offsets).ravel()
    rows = np.repeat(np.arange(centres.size), offsets.size)
    shape = centres.size, logged.record.rows.delta.size
    return sparse.csr_array((weights, (rows, columns)), shape=shape)


def _half_width(logged: RegressionRows, samples: int) -> int:
    """Return the half-width of means whose measurement error is small beside δ, or the largest."""
    width, most = 1, max((samples - 1) // _FEWEST, 1)
    while 2 * width <= most:
        weights = triangles(samples - 1, width, width, logged)
        delta = weights @ np.asarray(logged.record.rows.delta)
        if np.median(_shared(logged, weights)) <= _SHARE * np.median(delta):
            break
        width *= 2
    return width


def _shared(logged: RegressionRows, weights: sparse.csr_array) -> Float[np.ndarray, " k"]:
    """Return the largest error of each mean by the errors that several rows share."""
    count, rows = weights.shape
    bound = np.zeros(count)
    for channel in logged.channels.values():
        stencil = np.asarray(channel.stencil)
        shifted = sparse.diags_array(
            stencil,
            offsets=np.arange(stencil.size),  # pyright: ignore[reportArgumentType]
            shape=(rows, rows + stencil.size - 1),
        )
        bound += abs(weights @ shifted) @ np.asarray(channel.bound)
    return bound


def _means(
    logged: RegressionRows, log: Log, weights: sparse.csr_array, start: float
) -> tuple[Float[np.ndarray, "..."], ...]:
    """Return regressors, input, bound, time, position and velocity of the means of one log."""
    h, y, rows = float(log.period), np.asarray(log.position), logged.record.rows
    time = start + h * np.arange(1, y.size - 1)
    states = time, y[1:-1], (y[2:] - y[:-2]) / (2 * h)
    bound = weights @ np.asarray(rows.delta) + _shared(logged, weights)
    columns = np.asarray(rows.regressors), np.asarray(logged.record.input)
    phi, input = (weights @ x for x in columns)
    return phi, input, bound, *(weights @ x for x in states)


def _best(
    phi: Float[np.ndarray, "k m"], input: Float[np.ndarray, " k"], system: System
) -> Float[np.ndarray, " m"]:
    """Return the θ of the prior box with the smallest largest |input − φᵀθ|."""
    lower, upper, centre, half = (
        np.asarray(x) for x in (system.lower, system.upper, system.centre, system.half_widths)
    )
    misfit, scaled = input - phi @ centre, phi * half
    size = max(float(np.max(np.abs(misfit), initial=0.0)), 1.0)
    ones = np.ones((len(input), 1))
    solution = linprog(
        np.append(np.zeros(half.size), 1.0),
        A_ub=np.vstack([np.hstack([-scaled / size, -ones]), np.hstack([scaled / size, -ones])]),
        b_ub=np.concatenate([-misfit, misfit]) / size,
        bounds=[(-1.0, 1.0)] * half.size + [(0.0, None)],
        method="highs",
    )
    if solution.x is None:
        return centre
    return np.clip(centre + half * solution.x[:-1], lower, upper)
