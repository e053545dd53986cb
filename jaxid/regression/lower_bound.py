"""A proved lower bound on the error that any experiment and any estimator can guarantee.

Let ν be in the prior box with |φ(y, ẏ, ÿ)ᵀν| ≤ δ(y, ẏ) at every state within the limits. Then
u = Φ·centre may come from θ = centre + ν and from centre − ν, for every motion, and any estimate
has an error of at least cᵀν for one of the two (C. A. Micchelli and T. J. Rivlin, "A Survey of
Optimal Recovery", 1977). The largest such cᵀν is a linear program with as many conditions as there
are states.

It is solved on a few states, and where its ν violates a condition most, a state is added. The
result does not depend on those states: the excess s = max |φᵀν|/δ over all states is bounded by
interval arithmetic on ever smaller cells, and ν/s keeps every condition.

The limits are those of the planned motion. If the closed loop exceeds them, or if the data are more
favourable than the worst ones, the intervals from a log can be narrower, even many times; no design
can rely on either.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.optimize import linprog

from jaxid._checks import require_concrete, require_float64
from jaxid.model.interval_arithmetic import Range, exactly
from jaxid.model.system import System
from jaxid.motion.limits import Limits
from jaxid.regression.worst_case import Norm

_TOLERANCE = 1e-4  # relative, between the proved lower bound and its upper limit
_ROUNDED = 1e-9  # relative, subtracted from a lower bound: far more than rounding of its sums
_ROUNDS = 40  # rounds in which states are added
_CHUNK = 2048  # cells that are evaluated together: one compilation
_STATES = 256  # states likewise; the first grid has 81, and a round adds up to eight
_MOST = 200_000  # cells; with more the proof stops at a larger s

Cells = Float[np.ndarray, "cells 4"]
PerCell = Float[np.ndarray, " cells"]
Vector = Float[np.ndarray, " m"]


class LowerBound(NamedTuple):
    """Lower bounds on the worst-case errors of k functionals of θ, with their proofs.

    Attributes:
        value: proved lower bound of each worst-case error, shape (k,): before the data are known,
            no motion within the limits and no estimator can promise less.
        above: upper limit of what this proof can give, shape (k,).
        dual: parameter deviations ν that prove the bounds, shape (k, m).
        estimated: names of parameters with user-defined regressors without slope bounds; if there
            are any, the lower bound is an estimate.
        limits: limits within which no motion can promise less.
    """

    value: Float[Array, " k"]
    above: Float[Array, " k"]
    dual: Float[Array, "k m"]
    estimated: tuple[str, ...]
    limits: Limits


def lower_bound(system: System, limits: Limits, norm: Norm | None = None) -> LowerBound:
    """Return a proved lower bound on the worst-case error of any motion and any estimator.

    It holds before the data are known: no experiment within the limits can promise less. The data
    of one may still happen to prove a narrower interval.

    Args:
        system: axis with its regressors, disturbance bound δ and prior box.
        limits: limits of position, velocity and acceleration; the other limits are not used.
        norm: functionals of θ to bound; default the m parameters themselves.

    Raises:
        ValueError: if the system is not float64.

    Example:
        >>> least = jd.lower_bound(slide, limits)
        >>> [round(x, 1) for x in least.value.tolist()]
        [0.7, 12.6, 6.7]
    """
    require_float64(system=system, limits=limits, norm=norm)
    require_concrete(
        "the lower bound, a linear program,",
        "Trace `jaxid.planned_error`, the error of one motion.",
        system=system,
        limits=limits,
        norm=norm,
    )
    functionals = np.eye(len(system.names)) if norm is None else np.asarray(norm.functionals)
    found = [_of_one(system, limits, c) for c in functionals]
    value, above, dual = (jnp.asarray(np.stack(column)) for column in zip(*found, strict=True))
    return LowerBound(value, above, dual, system.estimated, limits)


def _of_one(system: System, limits: Limits, functional: Vector) -> tuple[float, float, Vector]:
    states = _corners(limits)
    value, above, best = 0.0, np.inf, np.zeros_like(functional)
    for _ in range(_ROUNDS):
        nu = _on_states(system, limits, functional, states)
        above = float(functional @ nu)
        excess, worst = _excess(system, limits, nu)
        if above / excess > value:
            value, best = above / excess, nu / excess
        if value >= (1 - _TOLERANCE) * above or not len(worst):
            break
        states = np.concatenate([states, worst])
    return value * (1 - _ROUNDED), above, best


def _corners(limits: Limits) -> Float[np.ndarray, "states 2"]:
    """Return the first positions and velocities: a 9 × 9 grid within the limits."""
    ends = (np.asarray(x) for x in (limits.position, limits.velocity))
    y, v = (np.linspace(low, high, 9) for low, high in ends)
    return np.stack([x.ravel() for x in np.meshgrid(y, v)], axis=1)


def _on_states(
    system: System, limits: Limits, functional: Vector, states: Float[np.ndarray, "states 2"]
) -> Vector:
    """Return the best ν for some states, each with both extreme accelerations."""
    padded = np.concatenate([states, np.repeat(states[-1:], -len(states) % _STATES, axis=0)])
    forces = np.asarray(_forces(system, jnp.asarray(padded.T)))[:, : len(states)]
    phi = np.concatenate(
        [
            np.stack([np.full(len(states), a) / forces[0], *forces[1:]], axis=1)
            for a in np.asarray(limits.acceleration)
        ]
    )
    box = np.asarray(system.half_widths)
    scaled_rows = phi * box
    solution = linprog(
        -functional * box,
        A_ub=np.concatenate([scaled_rows, -scaled_rows]),
        b_ub=np.ones(2 * len(phi)),
        bounds=(-1.0, 1.0),
        method="highs",
    )
    assert solution.x is not None  # ν = 0 keeps all conditions, and the box is bounded
    # the solver satisfies bounds only up to a tolerance
    return np.clip(solution.x, -1.0, 1.0) * box


@eqx.filter_jit
def _forces(system: System, states: Float[Array, "2 states"]) -> Float[Array, "m states"]:
    """Return δ, and the regressors other than the acceleration relative to it, for each state."""
    y, v = states
    delta = system.disturbance_bound(y, v)
    return jnp.stack([delta, *(force / delta for force in system.regressor_values(y, v))])


def _excess(
    system: System, limits: Limits, nu: Vector
) -> tuple[float, Float[np.ndarray, "states 2"]]:
    """Return an upper bound of max |φᵀν|/δ over all states, at least 1, and the worst states."""
    (y0, y1), (v0, v1) = np.asarray(limits.position), np.asarray(limits.velocity)
    cells = np.array([[y0, y1, v0, v1]])
    reached, proved, seen = 1.0, 1.0, [np.zeros((0, 3))]
    while len(cells):
        look = _looked_at(system, limits, nu, cells)
        centres = np.stack([cells[:, :2].mean(axis=1), cells[:, 2:].mean(axis=1)], axis=1)
        seen.append(np.column_stack([look.middle, centres])[np.argsort(-look.middle)[:4]])
        reached = max(
            reached, float(np.max(look.middle, where=np.isfinite(look.middle), initial=1.0))
        )
        undecided = look.upper > reached * (1 + _TOLERANCE / 4)
        if 2 * np.sum(undecided) > _MOST:
            undecided[:] = False
        proved = max(proved, float(np.max(look.upper[~undecided], initial=0.0)))
        cells = _halved(cells[undecided], (look.without_y < look.without_v)[undecided])
    worst = np.concatenate(seen)
    worst = worst[np.argsort(-worst[:, 0])]
    breaking = (worst[:, 0] > 1.0) & np.isfinite(worst[:, 0])
    return proved, worst[breaking][:8, 1:]


class _Look(NamedTuple):
    """Bounds of |φᵀν|/δ per cell, its value at the centre, and bounds with fixed y or fixed ẏ."""

    upper: PerCell
    middle: PerCell
    without_y: PerCell
    without_v: PerCell


def _looked_at(system: System, limits: Limits, nu: Vector, cells: Cells) -> _Look:
    """Return the bounds of all cells, in chunks of one size for a single compilation."""
    padded = np.concatenate([cells, np.repeat(cells[-1:], -len(cells) % _CHUNK, axis=0)])
    parts = [
        _ratios(system, limits, jnp.asarray(nu), jnp.asarray(padded[k : k + _CHUNK].T))
        for k in range(0, len(padded), _CHUNK)
    ]
    return _Look(*np.concatenate([np.asarray(x) for x in parts], axis=1)[:, : len(cells)])


@eqx.filter_jit
def _ratios(
    system: System, limits: Limits, nu: Float[Array, " m"], cells: Float[Array, "4 cells"]
) -> Float[Array, "4 cells"]:
    y, v = Range(cells[0], cells[1]), Range(cells[2], cells[3])
    a = Range(*(jnp.broadcast_to(end, cells[0].shape) for end in limits.acceleration))
    y_middle, v_middle = exactly(y.middle), exactly(v.middle)
    pairs = ((y, v), (y_middle, v_middle), (y_middle, v), (y, v_middle))
    return jnp.stack([_ratio(system, nu, a, *pair) for pair in pairs])


def _ratio(
    system: System, nu: Float[Array, " m"], acceleration: Range, position: Range, velocity: Range
) -> Float[Array, " cells"]:
    """Return an upper bound of |φᵀν|/δ over ranges of the state."""
    forces = system.regressor_ranges(position, velocity)
    total = sum((n * f for n, f in zip(nu[1:], forces, strict=True)), start=nu[0] * acceleration)
    ratio = abs(total).upper / system.disturbance_bound.range(position, velocity).lower
    return jnp.where(jnp.isnan(ratio), jnp.inf, ratio)  # NaN bounds nothing


def _halved(cells: Cells, across_y: Bool[np.ndarray, " cells"]) -> Float[np.ndarray, "halves 4"]:
    """Return both halves of each cell, cut where the bound is wider: position or velocity."""
    first, last = np.where(across_y, 0, 2), np.where(across_y, 1, 3)
    row = np.arange(len(cells))
    middle = (cells[row, first] + cells[row, last]) / 2
    low, high = cells.copy(), cells.copy()
    low[row, last] = middle
    high[row, first] = middle
    return np.concatenate([low, high])
