"""Minimax weights: the least worst-case error that any estimator can guarantee, and its proof.

For a functional cᵀθ of a θ in the box of half-widths b, weights g have the worst-case error

    Σ_k |g_k| δ_k + Σ_j b_j |c − Φᵀg|_j.

Its minimum over g is a linear program, and so is the dual of that,

    max cᵀν   with   |φ_kᵀν| ≤ δ_k in every row k   and   |ν_j| ≤ b_j.

Any g is an upper bound of both and any feasible ν a lower one. The lower one holds for estimators
of every kind: u = Φ·centre may come from θ = centre + ν and from centre − ν alike, and one of them
is missed by cᵀν (C. A. Micchelli and T. J. Rivlin, "A Survey of Optimal Recovery", 1977).

In units of the bounds, z_j = ν_j/b_j, x_k = g_k δ_k, and the terms b_j·(c − Φᵀg)_j as m more
entries of x, the box is nothing but m more rows:

    min ‖x‖₁ with A x = d,     max dᵀz with |a_kᵀz| ≤ 1 for every column a_k of A = [b∘φ_k/δ_k, I],

with d = b∘c. An optimal x has no more than m entries, and those of m columns determine all: x from
A x = d, z from a_kᵀz = sign x_k. While another column has |a_kᵀz| > 1, the worst of them replaces
one of the m: the simplex method, or Remez's exchange. A step solves m × m systems and reads A once.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Bool, Float, Int

from jaxid._checks import is_concrete, require, require_float64
from jaxid._types import Scalar, dot
from jaxid.loop.record import Rows
from jaxid.model.system import Tree
from jaxid.regression.worst_case import Norm, affine_worst_case_error, bias

_GAP = 1e-11  # relative gap at which the search stops
_STEPS = 100  # at most; 5 to 20 are usual
_ROUNDED = 1e-13  # tolerance of |aᵀz| ≤ 1
_TILT = 1e-12  # relative perturbation of d, so that no entry of x is zero (no degenerate step)


class Optimum(eqx.Module):
    """The least worst-case errors of k functionals of θ, with bounds that prove them.

    Attributes:
        error: worst-case error of `weights`, with rounding added, shape (k,), in the units of the
            functionals.
        lower_bound: lower bound on the worst-case error of every estimator, with rounding
            subtracted, shape (k,).
        weights: weights g of the affine estimators centre + g(u − Φ·centre), shape (k, n).
        dual: parameter deviations ν that prove the lower bounds, shape (k, m): centre + ν and
            centre − ν can produce the same data.
        steps: number of steps of the exchange algorithm, shape (k,).
    """

    error: Float[Array, " k"]
    lower_bound: Float[Array, " k"]
    weights: Float[Array, "k n"]
    dual: Float[Array, "k m"]
    steps: Int[Array, " k"]


def minimax(rows: Rows, half_widths: Float[Array, " m"], norm: Norm | None = None) -> Optimum:
    """Return the weights of the least worst-case error over all |Δ_k| ≤ δ_k and all θ in the box.

    Even if the search stops early, `error` is that of the weights and `lower_bound` that of a
    feasible ν. Both have the derivatives of the optimum, with weights and ν as constants (envelope
    theorem), and no second derivatives:

        ∂r/∂φ_k = −g_k ν,   ∂r/∂δ_k = |g_k|,   ∂r/∂b_j = |c − Φᵀg|_j,   ∂r/∂c = ν.

    Where several weights are optimal these are one of several subgradients.

    Args:
        rows: regression rows of one motion or record, with δ above zero in every row of nonzero
            measure. The size of the measure has no influence.
        half_widths: half-widths b of the prior box, above zero, in the units of the parameters.
        norm: functionals of θ to estimate; default the m parameters themselves.

    Raises:
        ValueError: if anything is not float64, or a δ or b is not above zero and finite.
    """
    require_float64(rows=rows, half_widths=half_widths)
    if is_concrete((rows, half_widths)):
        _require_bounded(rows, half_widths)
    return _minimax(rows, half_widths, Norm(jnp.eye(half_widths.size)) if norm is None else norm)


@eqx.filter_jit
def _minimax(rows: Rows, half_widths: Float[Array, " m"], norm: Norm) -> Optimum:
    fixed = stop_gradient((rows, half_widths, norm))
    weights, direction, steps = _optimal(*fixed)
    dual = _feasible(direction, *fixed[:2])
    remainder = bias(weights, fixed[0], fixed[2])
    slope = _lagrangian(weights, dual, remainder, rows, half_widths, norm)
    slope = slope - stop_gradient(slope)  # zero, with the derivative of the Lagrangian
    error = affine_worst_case_error(weights, *fixed) + _rounding(weights, *fixed)
    parts = fixed[2].functionals * dual
    least = jnp.sum(parts, axis=1) - _relative(parts) * jnp.sum(jnp.abs(parts), axis=1)
    return Optimum(error + slope, least + slope, weights, dual, steps)


def _lagrangian(
    weights: Float[Array, "k n"],
    dual: Float[Array, "k m"],
    remainder: Float[Array, "k m"],
    rows: Rows,
    half_widths: Float[Array, " m"],
    norm: Norm,
) -> Float[Array, " k"]:
    """Return Σ|g|δ + |remainder|·b + ν·(c − Φᵀg), whose gradient is that of the least error."""
    paid = jnp.abs(weights) @ rows.delta + jnp.abs(remainder) @ half_widths
    return paid + jnp.sum(dual * bias(weights, rows, norm), axis=1)


def _optimal(
    rows: Rows, half_widths: Float[Array, " m"], norm: Norm
) -> tuple[Float[Array, "k n"], Float[Array, "k m"], Int[Array, " k"]]:
    """Return weights, ν up to a factor, and the number of steps."""
    columns, delta = _counted(rows)
    scaled = jnp.stack([b * x / delta for b, x in zip(half_widths, columns, strict=True)])
    A = jnp.concatenate([scaled, jnp.eye(half_widths.size)], axis=1)
    x, z, steps = jax.vmap(_exchange, (None, 0))(A, half_widths[None, :] * norm.functionals)
    return x[:, : delta.size] / delta[None, :], z * half_widths[None, :], steps


def _counted(rows: Rows) -> tuple[tuple[Float[Array, " n"], ...], Float[Array, " n"]]:
    """Return columns and δ; rows of measure zero become the condition 0 ≤ 1."""
    counts = rows.counted
    columns = tuple(jnp.where(counts, column, 0.0) for column in rows.columns)
    return columns, jnp.where(counts, rows.delta, 1.0)


def _feasible(
    direction: Float[Array, "k m"], rows: Rows, half_widths: Float[Array, " m"]
) -> Float[Array, "k m"]:
    """Return the longest ν in each direction that keeps all bounds, rounding included."""
    columns, delta = _counted(rows)
    rounded = _relative(direction)

    def shortened(nu: Float[Array, " m"]) -> Float[Array, " m"]:
        uncertain = rounded * dot([jnp.abs(column) for column in columns], jnp.abs(nu))
        size = jnp.max((jnp.abs(dot(columns, nu)) + uncertain) / delta)
        size = jnp.maximum(size, (1 + rounded) * jnp.max(jnp.abs(nu) / half_widths))
        return nu / jnp.where(size > 0, size, 1.0)

    return jax.vmap(shortened)(direction)


def _rounding(
    weights: Float[Array, "k n"], rows: Rows, half_widths: Float[Array, " m"], norm: Norm
) -> Float[Array, " k"]:
    """Return an upper bound of the rounding error of a worst-case error."""
    sizes = eqx.tree_at(lambda r: r.columns, rows, tuple(jnp.abs(c) for c in rows.columns))
    functionals = -jnp.abs(norm.functionals)  # so that all terms have one sign
    parts = affine_worst_case_error(jnp.abs(weights), sizes, half_widths, Norm(functionals))
    return _relative(functionals) * parts


def _relative(vectors: Float[Array, "k m"]) -> float:
    """Return an upper bound of the relative rounding error of a sum of products over m entries."""
    return (vectors.shape[1] + 4) * float(jnp.finfo(vectors.dtype).eps)


class _Primal(NamedTuple):
    """The m possibly nonzero entries of an x, with their columns and worst-case error."""

    columns: Int[Array, " m"]
    x: Float[Array, " m"]
    error: Scalar

    def or_better(self, other: "_Primal") -> "_Primal":
        return _chosen(other.error < self.error, other, self)


class _Dual(NamedTuple):
    """A feasible z, with its lower bound."""

    z: Float[Array, " m"]
    lower_bound: Scalar

    def or_better(self, other: "_Dual") -> "_Dual":
        return _chosen(other.lower_bound > self.lower_bound, other, self)


def _chosen(condition: Bool[Array, ""], new: Tree, old: Tree) -> Tree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)


class _State(NamedTuple):
    """The state of the exchange: the next columns, the perturbation of d, the best x and z so far.

    The best x and the best z may be from different steps.
    """

    columns: Int[Array, " m"]
    tilt: Scalar
    primal: _Primal
    dual: _Dual
    steps: Int[Array, ""]
    open: Bool[Array, ""]


def _exchange(
    A: Float[Array, "m N"], d: Float[Array, " m"]
) -> tuple[Float[Array, " N"], Float[Array, " m"], Int[Array, ""]]:
    """Return x with A x = d of least ‖x‖₁, and z with ‖Aᵀz‖_∞ ≤ 1 as its proof; A ends with I."""
    m, N = A.shape
    # a generic direction; the perturbation is reduced to zero at the end
    direction = jnp.max(jnp.abs(d)) * (1 + (jnp.arange(1.0, m + 1) * jnp.sqrt(5.0)) % 1)

    def step(state: _State) -> _State:
        """Exchange one column, or reduce the perturbation if the columns are optimal."""
        columns, tilt = state.columns, state.tilt
        basis = A[:, columns]
        inverse = jnp.linalg.inv(basis)
        x = inverse @ d
        tilted = x + tilt * (inverse @ direction)
        z = jnp.where(tilted >= 0, 1.0, -1.0) @ inverse
        reach = z @ A
        entering = jnp.argmax(jnp.abs(reach))
        excess = jnp.abs(reach[entering])
        missed = jnp.sum(jnp.abs(d - basis @ x))  # rounding error, added by the columns of the box
        primal = state.primal.or_better(_Primal(columns, x, jnp.sum(jnp.abs(x)) + missed))
        dual = state.dual.or_better(_Dual(z / excess, z @ d / excess))
        optimal = excess <= 1 + _ROUNDED
        change = inverse @ A[:, entering] * jnp.sign(reach[entering])
        exchanged = columns.at[_leaving(tilted, change, excess)].set(entering)
        return _State(
            jnp.where(optimal, columns, exchanged),
            jnp.where(optimal, 1e-3 * tilt, tilt),
            primal,
            dual,
            state.steps + 1,
            (primal.error - dual.lower_bound > _GAP * primal.error)
            & jnp.isfinite(excess)
            & (~optimal | (tilt > 1e-6 * _TILT)),
        )

    box = jnp.arange(N - m, N)
    start = _State(
        box,
        jnp.asarray(_TILT),
        _Primal(box, d, jnp.sum(jnp.abs(d))),
        _Dual(jnp.zeros(m), jnp.zeros(())),
        jnp.asarray(0),
        jnp.asarray(True),
    )
    end = jax.lax.while_loop(lambda s: s.open & (s.steps < _STEPS), step, start)
    return jnp.zeros(N).at[end.primal.columns].set(end.primal.x), end.dual.z, end.steps


def _leaving(x: Float[Array, " m"], change: Float[Array, " m"], excess: Scalar) -> Int[Array, ""]:
    """Return the index of the entry that is zero at the minimum of ‖x − t·change‖₁ + t over t.

    The slope starts at 1 − excess, and each |x_j| that passes zero adds 2·|change_j|.
    """
    shrinks = jnp.sign(x) * change > 0
    zero = jnp.where(shrinks, x / jnp.where(shrinks, change, 1.0), jnp.inf)
    order = jnp.argsort(zero)
    slope = 1 - excess + 2 * jnp.cumsum(jnp.where(shrinks, jnp.abs(change), 0.0)[order])
    return order[jnp.argmax(slope >= 0)]


def _require_bounded(rows: Rows, half_widths: Float[Array, " m"]) -> None:
    delta, box = np.asarray(rows.delta), np.asarray(half_widths)  # NumPy: not traced
    bounded = (delta > 0) & np.isfinite(delta) | ~(np.asarray(rows.measure) > 0)
    row = int(np.argmin(bounded))
    require(
        bool(np.all(bounded)),
        "Argument `rows` must have a finite δ above zero in every row that has a measure, but "
        f"delta[{row}] is {delta[row]:g}.",
    )
    require(
        bool(np.all((box > 0) & np.isfinite(box))),
        "Argument `half_widths` of the prior box must be finite and above zero, but is "
        f"{box.tolist()}.",
    )
