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
    """Return the information matrix P = ∫ φ φᵀ dt of Theorem 1, shape (m, m).

    It is computed entry by entry, since a batched product of such thin matrices takes three times
    as long.
    """
    columns, m = rows.columns, len(rows.columns)
    pairs = [(i, j) for i in range(m) for j in range(i, m)]
    upper = {(i, j): jnp.sum(columns[i] * columns[j] * rows.measure) for i, j in pairs}
    return jnp.stack([jnp.stack([upper[min(i, j), max(i, j)] for j in range(m)]) for i in range(m)])


def least_squares(rows: Rows, norm: "Norm | None" = None) -> Float[Array, "k n"]:
    """Return the least-squares weights P⁻¹ Φᵀ diag(measure) of (11), one row per functional.

    Args:
        rows: regression rows of one motion or record.
        norm: functionals of θ to estimate; default the m parameters themselves.
    """
    _, mixtures = _mixtures(rows, norm)
    return jnp.stack([dot(rows.columns, mixture) * rows.measure for mixture in mixtures])


def _mixtures(rows: Rows, norm: "Norm | None") -> tuple[Float[Array, "k m"], Float[Array, "k m"]]:
    """Return the functionals C of θ, and C P⁻¹."""
    P = information(rows)
    functionals = jnp.eye(P.shape[0], dtype=P.dtype) if norm is None else norm.functionals
    return functionals, jnp.linalg.solve(P, functionals.T).T


def worst_case_error(weights: Float[Array, "k n"], delta: Float[Array, " n"]) -> Float[Array, " k"]:
    """Return max |Σ_k G_ik Δ_k| over all |Δ_k| ≤ δ_k, for each row i of the weights.

    For least-squares weights these are the row sums of (13) and (15).

    Args:
        weights: estimator weights G, shape (k, n).
        delta: disturbance bound δ of each row, shape (n,).
    """
    return jnp.abs(weights) @ delta


def bias(
    weights: Float[Array, "k n"], rows: Rows, norm: "Norm | None" = None
) -> Float[Array, "k m"]:
    """Return C − GΦ: the factor of θ − centre in the error of an affine estimator of Cθ.

    The estimator is C·centre + G(u − Φ·centre). For least squares, weighted or not, the bias is
    zero up to rounding.

    Args:
        weights: estimator weights G, shape (k, n).
        rows: regression rows.
        norm: functionals C of θ; default the m parameters themselves.
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
    """Return max |GΔ − (C − GΦ)(θ − centre)| over all |Δ_k| ≤ δ_k and all θ in the prior box.

    Both terms are symmetric and independent, so it is the sum of their maxima, which δ·sign(G) and
    the corner of the box at −sign(C − GΦ) attain. It is exact for biased and unbiased weights.

    Args:
        weights: estimator weights G, shape (k, n).
        rows: regression rows.
        half_widths: half-widths of the prior box, in the units of the parameters.
        norm: functionals C of θ; default the m parameters themselves.
    """
    return worst_case_error(weights, rows.delta) + worst_case_error(
        bias(weights, rows, norm), half_widths
    )


def smooth_least_squares_error(
    rows: Rows, smoothing: Scalar, norm: "Norm | None" = None
) -> Float[Array, " k"]:
    """Return a smooth upper approximation of the worst-case error of least squares.

    It is that of `worst_case_error` with √(g² + s²) for the |g| of each weight g. It serves
    gradients and is never below the exact error. Per unit of time, s is `smoothing` times the root
    mean square of g.

    Args:
        rows: regression rows of one motion or record.
        smoothing: smoothing parameter, dimensionless; zero gives the exact error.
        norm: functionals of θ to estimate; default the m parameters themselves.
    """
    functionals, mixtures = _mixtures(rows, norm)
    # a matrix product: the gradient of sums over columns takes twice as long
    density = mixtures @ jnp.stack(rows.columns)
    # the integral of (φᵀP⁻¹c)² over time is cᵀP⁻¹c; rounding must not make it negative
    power = jnp.maximum(jnp.sum(functionals * mixtures, axis=1), 0.0) / jnp.sum(rows.measure)
    square = density**2 + smoothing**2 * power[:, None]
    # √0 has no derivative
    safe = jnp.where(square > 0, square, 1.0)
    return jnp.where(square > 0, jnp.sqrt(safe), 0.0) @ (rows.delta * rows.measure)


class Norm(eqx.Module):
    """The norm max_k |c_kᵀ θ̃| of an estimation error θ̃, over the rows c_k of a matrix.

    All norms of the paper have this form.

    Attributes:
        functionals: rows c_k, shape (k, m).

    Raises:
        ValueError: if a row is zero.
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
                bool(np.all(np.any(np.asarray(self.functionals) != 0, axis=1))),
                "Argument `functionals` of a norm must have no zero row, but is "
                f"{self.functionals.tolist()}.",
            )


def individual(index: int, count: int) -> Norm:
    """Return the norm |·|_∞i of (14): the error of one parameter, in its own unit.

    Args:
        index: index of the parameter in θ.
        count: number m of parameters.
    """
    return Norm(jnp.zeros((1, count)).at[0, index].set(1.0))


def infinity(scale: Numbers) -> Norm:
    """Return the ∞-norm of (13), with each parameter divided by its own scale.

    Args:
        scale: scale of each parameter, positive, in its unit, not traced; inf leaves a parameter
            out.

    Raises:
        ValueError: if a scale is not positive, or none is finite.
    """
    counted = ~np.isinf(scale)
    require(
        counted.any() and np.all(np.asarray(scale) > 0),
        f"Argument `scale` of a norm must be positive, at least one of them finite, but is "
        f"{np.asarray(scale).tolist()}.",
    )
    return Norm(np.diag(1 / np.asarray(scale))[counted])


def require_informative(rows: Rows, names: tuple[str, ...], scale: Float[Array, " m"]) -> None:
    """Raise an error if P is singular, and name the parameters that are not identifiable.

    Args:
        rows: regression rows of one motion or record, not traced.
        names: names of the m parameters.
        scale: typical sizes of the parameters (half-widths of the prior box), to compare columns of
            different units.

    Raises:
        ValueError: if P is singular to rounding.
    """
    P = information(rows) * jnp.outer(scale, scale)
    values, vectors = jnp.linalg.eigh(P)
    # eigenvalues below 1000 rounding errors of the largest one count as zero
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
