"""Optimal modulating functions: the weights on hats with the least guaranteed error of a log.

For one parameter, or any functional c of θ, minimise over g

    Σ_k |g_k| δ_k + Σ channels + Σ_j b_j |c − Φᵀg|_j,

a linear program. The bandwidth of a filter is a trade-off between disturbance and noise; here the
program makes it, instant by instant. To keep it small g is piecewise linear between knots some
ticks apart, so that its second differences, which turn into noise of ÿ, live at the knots. Whatever
it returns, `guaranteed` says what it is worth.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import linprog

from jaxid.bound import Norm
from jaxid.log_rows import Logged

KNOTS = 300  # at most; twice as many gain less than 1e-3 of the motor's bounds


def modulating(
    logged: Logged, box: Float[Array, " m"], norm: Norm | None = None, knots: int = KNOTS
) -> Float[Array, "k n"]:
    """Weights on the rows of `hats`, one row of them per functional.

    Args:
        logged: by `hats`.
        box: b, half the widths of the prior box, in the units of the parameters.
        norm: the functionals; without one, the m parameters themselves.
        knots: at most.
    """
    rows, half_widths = logged.record.rows, np.asarray(box)
    functionals = np.eye(half_widths.size) if norm is None else np.asarray(norm.functionals)
    phi, delta = np.asarray(rows.regressors), np.asarray(rows.delta)
    noise = np.asarray(logged.channels["quantised ÿ"].bound)
    return jnp.asarray(optimal(phi, delta, noise, half_widths, functionals, knots)[0])


def optimal(
    phi: Float[np.ndarray, "n m"],
    delta: Float[np.ndarray, " n"],
    noise: Float[np.ndarray, " samples"],
    half_widths: Float[np.ndarray, " m"],
    functionals: Float[np.ndarray, "k m"],
    knots: int,
) -> tuple[Float[np.ndarray, "k n"], Float[np.ndarray, "k m"]]:
    """Weights, and the multipliers ν of c − Φᵀg: what a change of Φ costs is −gν.

    Args:
        phi: regressors of the rows.
        delta: of the rows.
        noise: bounds of what second differences of the weights are multiplied by.
        half_widths: of the prior box.
        functionals: c.
        knots: at most.
    """
    basis = _linear(delta.size, knots)
    second = np.abs(noise)[:, None] * _second_differences(basis)
    second = second[np.any(second != 0, axis=1)]
    found = [_solve(c, phi.T @ basis, delta @ basis, second, half_widths) for c in functionals]
    weights, multipliers = zip(*found, strict=True)
    return np.stack(weights) @ basis.T, np.stack(multipliers)


def _solve(
    functional: Float[np.ndarray, " m"],
    phi: Float[np.ndarray, "m knots"],
    delta: Float[np.ndarray, " knots"],
    second: Float[np.ndarray, "l knots"],
    half_widths: Float[np.ndarray, " m"],
) -> tuple[Float[np.ndarray, " knots"], Float[np.ndarray, " m"]]:
    """Min Σ|x| + Σ|S x| + Σ|b∘(c − Φx)|, in units of the prior; x = x⁺ − x⁻."""
    unit = np.abs(functional) @ half_widths
    (m, count), noisy = phi.shape, len(second)
    moments, spread = half_widths[:, None] * phi / delta, second / delta
    free, rest, nothing = np.eye(noisy), np.eye(m), np.zeros((noisy, m))
    solution = linprog(
        np.ones(2 * count + noisy + 2 * m),
        A_ub=np.block(
            [
                [spread, -spread, -free, nothing, nothing],
                [-spread, spread, -free, nothing, nothing],
            ]
        ),
        b_ub=np.zeros(2 * noisy),
        A_eq=np.block([moments, -moments, np.zeros((m, noisy)), rest, -rest]),
        b_eq=half_widths * functional / unit,
        method="highs",
    )
    if solution.x is None:  # without weights the prior box remains
        return np.zeros(count), half_widths * np.sign(functional)
    x = solution.x[:count] - solution.x[count : 2 * count]
    return unit * x / delta, half_widths * solution.eqlin.marginals


def _linear(count: int, most: int) -> Float[np.ndarray, "count knots"]:
    """Hat functions of coarse knots on samples 1 … count, zero at 0 and count + 1."""
    at = np.unique(np.linspace(0, count + 1, min(most, count) + 2).round())
    samples = np.arange(1, count + 1)
    return np.stack([np.interp(samples, at, unit) for unit in np.eye(len(at))[1:-1]], axis=1)


def _second_differences(
    basis: Float[np.ndarray, "n knots"],
) -> Float[np.ndarray, "samples knots"]:
    """Convolved with (1, −2, 1), full length."""
    padded = np.pad(basis, ((2, 2), (0, 0)))
    found = np.diff(padded, 2, axis=0)
    found[np.abs(found) < 1e-12] = 0.0
    return found
