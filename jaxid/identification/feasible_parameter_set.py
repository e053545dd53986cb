"""After the experiment: every θ that the data leave possible, and whether they leave any.

For any weights g and any θ that can have left the data

    cᵀθ ≤ cᵀcentre + gᵀ(u − Φ·centre) + guaranteed error of g (`log_rows`).

This holds for all g at once, so they may be chosen with the data known: the smallest such upper end
is a linear program, and by its duality the largest cᵀθ of the feasible set (M. Milanese and A.
Vicino, "Optimal Estimation Theory for Dynamic Systems with Set Membership Uncertainty", 1991). Each
number is computed from its weights; no tolerance of a solver is in it.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy import sparse
from scipy.optimize import linprog

from jaxid._checks import require
from jaxid._types import Scalar
from jaxid.identification.joint import read_together
from jaxid.identification.modulating_functions import Knots, Program, pieces
from jaxid.identification.regression_rows import ROUNDED, Logged
from jaxid.loop.log import ContradictionError, Log
from jaxid.loop.record import Record
from jaxid.model.disturbance_bound import Scaled
from jaxid.model.system import System
from jaxid.regression.estimate import Estimate

_DIRECTIONS = 48  # of a projection
LEAST, MOST = 1e-3, 1e3  # factors of δ that are looked at
_CLOSE = 1e-3  # relative, of the smallest one
_COARSE = 1000  # knots, to begin with
_WIDER = 1.03  # times the factor that few knots find: all find 2 or 3 % more of the motor's
_TINY = 1e-6


class FeasibleSet(NamedTuple):
    """The smallest box around all θ that can have left the data.

    Attributes:
        lower: ends of the intervals, shape (m,).
        upper: shape (m,).
    """

    lower: Float[Array, " m"]
    upper: Float[Array, " m"]


def unlogged(system: System, record: Record) -> Logged:
    """A Record without errors of a sensor, for what takes a log: every row for itself."""
    return Logged(system, record, {})


def feasible_set(
    logged: Logged, others: Sequence[Estimate] = (), knots: Knots = None
) -> FeasibleSet:
    """All θ of the box that can have left the data, parameter by parameter.

    Args:
        logged: a log as rows, or a Record.
        others: estimates whose intervals are intersected as well: the set is never wider than any.
        knots: of the weights, at most; default all rows.

    Raises:
        ContradictionError: if nothing is left; `smallest_factor` says by how much δ is too small.
    """
    system = logged.system
    program, misfit = _program(logged, knots)
    needed = _needed(logged, program, misfit)
    require(
        needed <= 1.0,
        "Argument `logged`: no θ of the box can have left these data with |Δ| ≤ δ; δ, the box or "
        "the errors of the sensor are too small, or an input is not what was commanded. "
        "`smallest_factor` says what δ must be multiplied by.",
        ContradictionError,
    )
    axes = np.eye(len(system.names))
    upper = _ends(logged, program, misfit, axes)
    lower = -_ends(logged, program, misfit, -axes)
    # as an end of the box is computed from its centre, it may miss it by a last bit
    close = ROUNDED * system.half_widths
    lower = jnp.where(lower <= system.lower + close, system.lower, lower)
    upper = jnp.where(upper >= system.upper - close, system.upper, upper)
    for other in others:
        lower, upper = jnp.maximum(lower, other.lower), jnp.minimum(upper, other.upper)
    for name, low, high in zip(system.names, lower, upper, strict=True):
        require(
            float(low) <= float(high),
            f"Argument `others`: their intervals for {name} and what these data leave have nothing "
            f"in common ({float(low):.6g} is above {float(high):.6g}).",
            ContradictionError,
        )
    return FeasibleSet(lower, upper)


def blind(logged: Logged, knots: Knots = None) -> dict[str, Float[np.ndarray, " m"]]:
    """What the motion behind the data cannot tell apart, whatever the data say.

    Args:
        logged: rows that were made with the prior box.
        knots: of the weights, at most; default all rows.

    Returns:
        For each parameter whose prior interval may remain whole, its name and the simplest
        combination ν that goes unseen: centre + ν and centre − ν explain the same data, and they
        are at both ends of this interval.
    """
    program, _ = _program(logged, knots)
    found = {name: _unseen(program, k) for k, name in enumerate(logged.system.names)}
    return {name: combination for name, combination in found.items() if combination is not None}


def projection(
    logged: Logged, one: str, other: str, knots: Knots = None
) -> Float[np.ndarray, "directions 2"]:
    """Corners of a polygon that holds the feasible set seen in the plane of two parameters."""
    system = logged.system
    program, misfit = _program(logged, knots)
    pair = np.array([system.index(one), system.index(other)])
    size = np.asarray(system.half_widths)[pair]
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    functionals = np.zeros((_DIRECTIONS, len(system.names)))
    functionals[:, pair] = normals / size
    ends = np.asarray(_ends(logged, program, misfit, functionals))
    lines = np.stack([normals, np.roll(normals, -1, axis=0)], axis=1)
    corners = np.linalg.solve(lines, np.stack([ends, np.roll(ends, -1)], axis=1)[..., None])
    return corners[..., 0] * size


def smallest_factor(
    rows: Callable[[Scalar], Logged], knots: Knots = None, least: float = LEAST
) -> float:
    """The largest s for which s·δ is proved not to explain the data; a thousandth more may do.

    It is `MOST` if not even that does; then an input, a unit or a sign must be wrong.

    Args:
        rows: the data as rows, with δ multiplied by a factor; for a log its brackets depend on it.
        knots: of the weights, at most; default all rows.
        least: where the search begins, and what is returned if already it may explain them.
    """

    def needed(factor: float, count: Knots) -> float:
        """Of a multiple of δ once more; infinite where not even the brackets have room."""
        try:
            logged = rows(jnp.asarray(factor))
        except ContradictionError:
            return np.inf
        return _needed(logged, *_program(logged, count))

    few = min(_COARSE, knots) if isinstance(knots, int) else knots or _COARSE
    low, high, n_low = least, least, np.inf
    for count in dict.fromkeys((few, knots)):  # what few see, all would see
        while (n_high := needed(high, count)) > 1.0:
            if high == MOST:
                return MOST
            low, n_low = high, n_high
            high = min(high * max(n_high, _WIDER), MOST)
        low, high = _closed_in(partial(needed, count=count), (low, n_low), (high, n_high))
    return low


def explaining_factor(
    system: System, logs: Sequence[Log], knots: Knots = None, least: float = LEAST
) -> float:
    """`smallest_factor` of the δ of a system, for logs of it: above 1 they contradict it.

    Args:
        system: its box and δ.
        logs: of one axis.
        knots: of the weights, at most, for each log; default all rows.
        least: what is returned if already it may explain them.
    """
    return smallest_factor(lambda s: read_together(louder(system, s), logs), knots, least)


def _closed_in(
    needed: Callable[[float], float], low: tuple[float, float], high: tuple[float, float]
) -> tuple[float, float]:
    """Factors a thousandth apart, of which one does not explain the data and the other may.

    By turns: a false position on logarithms, a step next to it, and a bisection.

    Args:
        needed: of a factor, how much more of δ it would take.
        low: a factor that does not, and what it would take.
        high: a factor that does, likewise.
    """
    step, moved = 0, high
    while high[0] > low[0] * (1 + _CLOSE):
        at = float(np.sqrt(low[0] * high[0]))
        if step % 3 == 0 and np.isfinite(low[1]):
            up, down = np.log(low[1]), -np.log(max(high[1], _TINY))
            at = low[0] * (high[0] / low[0]) ** float(np.clip(up / (up + down), 0.01, 0.99))
        elif step % 3 == 1:
            at = high[0] / (1 + _CLOSE) if moved is high else low[0] * (1 + _CLOSE)
        moved = at, needed(at)
        low, high = (low, moved) if moved[1] <= 1.0 else (moved, high)
        step += 1
    return low[0], high[0]


def louder(system: System, factor: Scalar | float) -> System:
    """The system with s·δ for its disturbance bound."""
    bound = Scaled(system.disturbance_bound, factor)
    return eqx.tree_at(lambda s: s.disturbance_bound, system, bound)


def _program(logged: Logged, knots: Knots) -> tuple[Program, Float[np.ndarray, " n"]]:
    """What `modulating` solves, and u − Φ·centre."""
    rows, system = logged.record.rows, logged.system
    channel = logged.channels.get("quantised ÿ")
    delta = np.asarray(rows.delta)
    noise = np.zeros(delta.size + 2) if channel is None else np.asarray(channel.bound)
    phi, box = np.asarray(rows.regressors), np.asarray(system.half_widths)
    program = Program(phi, delta, noise, box, knots, pieces(rows.measure))
    return program, np.asarray(logged.record.input) - phi @ np.asarray(system.centre)


def _ends(
    logged: Logged,
    program: Program,
    misfit: Float[np.ndarray, " n"],
    functionals: Float[np.ndarray, "k m"],
) -> Float[Array, " k"]:
    """Upper ends for Cθ; the box's own where the program finds none."""
    weights = np.stack([program.least(c, misfit)[0] for c in functionals])
    return _upper(logged, jnp.asarray(weights), jnp.asarray(misfit), jnp.asarray(functionals))[0]


def _needed(logged: Logged, program: Program, misfit: Float[np.ndarray, " n"]) -> float:
    """What δ must be multiplied by, at least, proved by one row of weights."""
    weights = jnp.asarray(program.contradicting(misfit))[None]
    nothing = jnp.zeros((1, program.half_widths.size))
    end, disturbed = _upper(logged, weights, jnp.asarray(misfit), nothing)
    # 0 ≤ end + (s − 1)·disturbed for every s that explains the data
    return 1.0 - float(end[0] / disturbed[0]) if disturbed[0] > 0 else 0.0


@eqx.filter_jit
def _upper(
    logged: Logged,
    weights: Float[Array, "k n"],
    misfit: Float[Array, " n"],
    functionals: Float[Array, "k m"],
) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Of Cθ by rows of weights, at most that of the box; and what is due to δ in it."""
    rows, system = logged.record.rows, logged.system
    taken = jnp.stack([weights @ column for column in rows.columns], axis=1)
    disturbed = jnp.abs(weights) @ rows.delta
    biased = jnp.abs(functionals - taken) @ system.half_widths
    error = (disturbed + logged.shared(weights) + biased) * (1 + ROUNDED)
    box = jnp.abs(functionals) @ system.half_widths
    about = functionals @ system.centre
    # without a functional there is no box to fall back to
    least = jnp.where(box > 0, jnp.minimum(weights @ misfit + error, box), weights @ misfit + error)
    return about + least, disturbed


def _unseen(program: Program, index: int) -> Float[np.ndarray, " m"] | None:
    """The simplest ν with ν_i = b_i that all weights leave possible; None if there is none.

    In half-widths: |momentsᵀν − Sᵀe| ≤ 1 at every knot for some errors |e| ≤ 1 of the sensor.
    """
    (m, count), noisy = program.moments.shape, program.spread.shape[0]
    rows = sparse.hstack([program.moments.T, -program.moments.T, program.spread.T])
    unit = np.zeros((1, 2 * m + noisy))
    unit[0, index], unit[0, m + index] = 1.0, -1.0
    solution = linprog(
        np.concatenate([np.ones(2 * m), np.zeros(noisy)]),
        A_ub=sparse.vstack([rows, -rows]),
        b_ub=np.ones(2 * count),
        A_eq=unit,
        b_eq=[1.0],
        bounds=[(0.0, 1.0)] * (2 * m) + [(-1.0, 1.0)] * noisy,
        method="highs",
    )
    if solution.x is None:
        return None
    return (solution.x[:m] - solution.x[m : 2 * m]) * program.half_widths
