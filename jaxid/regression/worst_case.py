"""Worst-case estimation errors (5)-(15): functions of rows (φ, δ, measure) alone.

An estimator that is linear in the data is a matrix of weights G, θ̂ = G u, with G Φ = I. Its error
is G Δ, whose i-th entry is at most Σ_k |G_ik| δ_k and reaches that with Δ_k = δ_k·sign(G_ik).
Without G Φ = I it is affine about the centre of the prior box, which then adds to the error.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require
from jaxid._types import Numbers, Scalar, as_array, dot
from jaxid.loop.record import Rows


def information(rows: Rows) -> Float[Array, "m m"]:
    """P = ∫ φ φᵀ dt of Theorem 1.

    Entry by entry: a batched matrix product of such thin matrices takes three times as long.
    """
    columns, m = rows.columns, len(rows.columns)
    pairs = [(i, j) for i in range(m) for j in range(i, m)]
    upper = {(i, j): jnp.sum(columns[i] * columns[j] * rows.measure) for i, j in pairs}
    return jnp.stack([jnp.stack([upper[min(i, j), max(i, j)] for j in range(m)]) for i in range(m)])


def least_squares(rows: Rows, norm: "Norm | None" = None) -> Float[Array, "k n"]:
    """The weights of (11), P⁻¹ Φᵀ diag(measure); with a norm those of its functionals of θ."""
    P = information(rows)
    functionals = jnp.eye(P.shape[0], dtype=P.dtype) if norm is None else norm.functionals
    mixtures = jnp.linalg.solve(P, functionals.T).T
    return jnp.stack([dot(rows.columns, mixture) * rows.measure for mixture in mixtures])


def worst_case_error(weights: Float[Array, "k n"], delta: Float[Array, " n"]) -> Float[Array, " k"]:
    """Max |Σ_k G_ik Δ_k| over all |Δ_k| ≤ δ_k: the row sums of (13) and (15), with P⁻¹."""
    return jnp.abs(weights) @ delta


def bias(
    weights: Float[Array, "k n"], rows: Rows, norm: "Norm | None" = None
) -> Float[Array, "k m"]:
    """C − GΦ: how an affine estimator C·centre + G(u − Φ·centre) of Cθ answers to θ − centre.

    Zero, up to rounding, for least squares, weighted or not; C are the functionals of the norm, or
    without one the parameters themselves.
    """
    products = jnp.stack([weights @ column for column in rows.columns], axis=1)
    functionals = jnp.eye(len(rows.columns)) if norm is None else norm.functionals
    return functionals - products


def affine_worst_case_error(
    weights: Float[Array, "k n"],
    rows: Rows,
    half_widths: Float[Array, " m"],
    norm: "Norm | None" = None,
) -> Float[Array, " k"]:
    """Max |GΔ − (C − GΦ)(θ − centre)| over all |Δ_k| ≤ δ_k and all θ in a box, biased or not.

    Both terms are symmetric and independent, so it is the sum of their maxima, which δ·sign(G) and
    the corner of the box at −sign(C − GΦ) reach.
    """
    return worst_case_error(weights, rows.delta) + worst_case_error(
        bias(weights, rows, norm), half_widths
    )


def smooth_worst_case_error(
    weights: Float[Array, "k n"], rows: Rows, smoothing: Scalar
) -> Float[Array, " k"]:
    """`worst_case_error` with √(g² + s²) for |g|, never below it: for gradients, not for bounds.

    Per unit of time s is `smoothing` times the root mean square of g, which has no kink of its own.
    """
    measure = rows.measure[None, :]
    density = weights**2 / jnp.where(measure > 0, measure, 1.0)  # no measure, no weight
    corner = smoothing**2 * jnp.sum(density, axis=1, keepdims=True) / jnp.sum(measure)
    # √0 has no derivative
    square = weights**2 + corner * measure**2
    safe = jnp.where(square > 0, square, 1.0)
    return jnp.sum(jnp.where(square > 0, jnp.sqrt(safe), 0.0) * rows.delta[None, :], axis=1)


class Norm(eqx.Module):
    """max_k |c_kᵀ θ̃| over the rows c_k of a matrix: every norm of the paper, and any combination.

    Attributes:
        functionals: the rows c_k, shape (k, m).
    """

    functionals: Float[Array, "k m"] = eqx.field(converter=as_array("functionals"))

    def __check_init__(self) -> None:
        require(
            self.functionals.ndim == 2,
            "Argument `functionals` of a norm must be a matrix, one row per functional, but has "
            f"the shape {self.functionals.shape}.",
        )
        if is_concrete(self.functionals):
            require(
                bool(jnp.all(jnp.any(self.functionals != 0, axis=1))),
                "Argument `functionals` of a norm must have no zero row, but is "
                f"{self.functionals.tolist()}.",
            )


def individual(index: int, count: int) -> Norm:
    """|·|_∞i of (14): the error of one parameter of `count`, in its own unit."""
    return Norm(jnp.zeros((1, count)).at[0, index].set(1.0))


def infinity(scale: Numbers) -> Norm:
    """The ∞ norm of (13), each parameter divided by its own scale so that units do not matter.

    Args:
        scale: of each parameter, positive, not traced; inf leaves one out.
    """
    counted = ~np.isinf(scale)
    require(
        counted.any() and np.all(np.asarray(scale) > 0),
        f"Argument `scale` of a norm must be positive, at least one of them finite, but is "
        f"{np.asarray(scale).tolist()}.",
    )
    return Norm(jnp.diag(1 / jnp.asarray(scale))[counted])


def require_informative(rows: Rows, names: tuple[str, ...], scale: Float[Array, " m"]) -> None:
    """Refuse rows whose P is singular, naming the combination that the motion cannot tell apart.

    Args:
        rows: of one motion or record, not traced.
        names: of the m parameters.
        scale: their natural sizes (half the box), to compare columns of different units.
    """
    P = information(rows) * jnp.outer(scale, scale)
    values, vectors = jnp.linalg.eigh(P)
    # eigh resolves values down to rounding of the largest; a thousand times that is not information
    if float(values[0]) > 1e3 * jnp.finfo(P.dtype).eps * float(values[-1]):
        return
    blind = vectors[:, 0] * scale
    blind = blind / blind[jnp.argmax(jnp.abs(vectors[:, 0]))]
    parts = [
        f"{float(c):+.3g}·{name}" for c, name in zip(blind, names, strict=True) if abs(c) > 1e-6
    ]
    raise ValueError(
        f"Argument `rows`: P is singular, so this motion cannot identify {', '.join(names)} "
        f"together: moving along {' '.join(parts)} changes nothing that is measured."
    )
