"""Optimal modulating functions: the weights on hat functions of least worst-case error for a log.

For one parameter, or any functional c of θ, minimise over g

    Σ_k |g_k| δ_k + Σ channels + Σ_j b_j |c − Φᵀg|_j,

a linear program. The bandwidth of a filter is a trade-off between disturbance and noise; here the
program makes it, instant by instant. To keep it small, g is piecewise linear between knots some
samples apart, so that its second differences, which multiply the noise of ÿ, are zero between
knots. The result of the solver need not be optimal: `guaranteed_estimate` gives the bound of any
weights.
"""

import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy import sparse

from jaxid._checks import require
from jaxid.identification.interior_point import LeastDeviations
from jaxid.identification.regression_rows import RegressionRows
from jaxid.regression.worst_case import Norm

Pieces = tuple[tuple[int, int], ...]  # first row of each log, and the one after its last
Knots = int | tuple[int, ...] | None  # most per log: one for all, one each, or one per row
KNOTS = 300  # default maximum; twice as many reduce the bounds of the motor by less than 0.1 %


def modulating(
    logged: RegressionRows, box: Float[Array, " m"], norm: Norm | None = None, knots: Knots = KNOTS
) -> Float[Array, "k n"]:
    """Return the estimator weights of least worst-case error on rows made by `hats`.

    Args:
        logged: regression rows of logs, made by `hats`.
        box: half-widths b of the prior box, in the units of the parameters.
        norm: functionals of θ to estimate; default the m parameters themselves.
        knots: largest number of weights per log.

    Returns:
        One row of weights per functional, shape (k, n).
    """
    rows, half_widths = logged.record.rows, np.asarray(box)
    functionals = np.eye(half_widths.size) if norm is None else np.asarray(norm.functionals)
    phi, delta = np.asarray(rows.regressors), np.asarray(rows.delta)
    noise = np.asarray(logged.channels["quantised ÿ"].bound)
    runs = pieces(rows.measure)
    return jnp.asarray(optimal(phi, delta, noise, half_widths, functionals, knots, runs)[0])


def pieces(measure: Float[Array | np.ndarray, " n"]) -> Pieces:
    """Return the first row of each log and the one after its last, where padding separates logs.

    Args:
        measure: measure of each row, zero for padding.
    """
    counted = np.pad(np.asarray(measure) > 0, 1).astype(int)
    starts, stops = (np.flatnonzero(np.diff(counted) == sign) for sign in (1, -1))
    return tuple(zip(starts.tolist(), stops.tolist(), strict=True))


def optimal(
    phi: Float[np.ndarray, "n m"],
    delta: Float[np.ndarray, " n"],
    noise: Float[np.ndarray, " samples"],
    half_widths: Float[np.ndarray, " m"],
    functionals: Float[np.ndarray, "k m"],
    knots: Knots,
    runs: Pieces | None = None,
) -> tuple[Float[np.ndarray, "k n"], Float[np.ndarray, "k m"]]:
    """Return the weights of least worst-case error, and the multipliers ν of c − Φᵀg.

    A change dΦ of the regressors changes the error by −gᵀ dΦ ν.

    Args:
        phi: regressors of the rows, shape (n, m).
        delta: disturbance bound of the rows, in the unit of the input.
        noise: bounds that multiply the second differences of the weights, shape (n + 2,).
        half_widths: half-widths of the prior box, in the units of the parameters.
        functionals: functionals c of θ, one per row.
        knots: largest number of weights per log; None for one per row.
        runs: first row of each log and the one after its last; default one log.
    """
    program = Program(phi, delta, noise, half_widths, knots, runs)
    found = [program.least(c) for c in functionals]
    weights, multipliers = zip(*found, strict=True)
    return np.stack(weights), np.stack(multipliers)


class Program:
    """The linear program for the weights of a log, scaled by δ and the prior box."""

    def __init__(
        self,
        phi: Float[np.ndarray, "n m"],
        delta: Float[np.ndarray, " n"],
        noise: Float[np.ndarray, " samples"],
        half_widths: Float[np.ndarray, " m"],
        knots: Knots,
        runs: Pieces | None = None,
    ) -> None:
        """Prepare the program; the arguments are those of `optimal`."""
        whole = ((0, delta.size),)
        self.basis, kinks, second = _family(delta.size, whole if runs is None else runs, knots)
        self.half_widths = half_widths
        self.delta = delta @ self.basis
        self.moments = half_widths[:, None] * (phi.T @ self.basis) / self.delta
        noisy = noise[kinks] != 0
        in_units = sparse.diags_array(noise[kinks][noisy]), sparse.diags_array(1 / self.delta)
        self.spread = sparse.csr_array(in_units[0] @ second[noisy] @ in_units[1])
        self.deviations = LeastDeviations(self.spread, self.moments)

    def least(
        self, functional: Float[np.ndarray, " m"], misfit: Float[np.ndarray, " n"] | None = None
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " m"]]:
        """Return the weights of least worst-case error of cᵀθ, or of the least upper end of cᵀθ.

        Args:
            functional: functional c of θ, shape (m,).
            misfit: u − Φ·centre of the rows; if given, gᵀ(u − Φ·centre) + error is minimised, which
                is the upper end.

        Returns:
            The weights g, and the multipliers of c − Φᵀg. If the program has no solution, g is
            zero, so that the prior interval remains.
        """
        unit = np.abs(functional) @ self.half_widths
        tilt = np.zeros_like(self.delta) if misfit is None else misfit @ self.basis / self.delta
        found = self.deviations.minimum(tilt, self.half_widths * functional / unit)
        if found is None:
            return np.zeros(self.basis.shape[0]), self.half_widths * np.sign(functional)
        return unit * self._weights(found.x), self.half_widths * found.multipliers

    def contradicting(self, misfit: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the weights that prove the largest necessary δ, with Σ|g|δ ≤ 1.

        They are zero, and prove nothing, if the solver fails.

        Args:
            misfit: u − Φ·centre of the rows, shape (n,), in the unit of the input.
        """
        tilt = misfit @ self.basis / self.delta
        nothing = np.zeros_like(self.half_widths)
        found = self.deviations.minimum(tilt, nothing, limited=True)
        if found is None:  # badly scaled data: no result
            return np.zeros(self.basis.shape[0])
        return self._weights(found.x)

    def _weights(self, x: Float[np.ndarray, " knots"]) -> Float[np.ndarray, " n"]:
        """Return the weights of the rows, from weights of the knots in units of 1/δ."""
        return self.basis @ (x / self.delta)


class _Family(NamedTuple):
    """Piecewise linear weights: hat functions of coarse knots, zero outside each log.

    Attributes:
        basis: hat functions on the rows, which are the samples 1 … size; rows × knots.
        kinks: samples, from 0 on and with two beyond the rows, at which any hat function has a
            kink.
        second: second differences of the hat functions there; kinks × knots.
    """

    basis: sparse.csr_array
    kinks: Int[np.ndarray, " kinks"]
    second: sparse.csr_array


@functools.lru_cache(maxsize=4)
def _family(size: int, runs: Pieces, knots: Knots) -> _Family:
    each = knots if isinstance(knots, tuple) else (size if knots is None else knots,) * len(runs)
    require(
        len(each) == len(runs),
        f"Argument `knots` must be one number, or one for each of {len(runs)} logs, but has "
        f"{len(each)}.",
    )
    blocks = [
        _hats(start, stop - start, size, most)
        for (start, stop), most in zip(runs, each, strict=True)
    ]
    # where no row counts, there are no weights
    basis = sparse.csr_array(sparse.hstack([sparse.csr_array((size, 0)), *blocks]))
    turning = sparse.diags_array([1.0, -2.0, 1.0], offsets=[0, -1, -2], shape=(size + 2, size))
    second = sparse.csr_array(turning @ basis)
    second.data[np.abs(second.data) < 1e-12] = 0.0
    second.eliminate_zeros()
    kinks = np.flatnonzero(np.diff(second.indptr))
    return _Family(basis, kinks, second[kinks])


def _hats(start: int, count: int, size: int, most: int) -> sparse.csr_array:
    """Return the hat functions of the knots of one log, whose rows begin at `start`."""
    at = np.unique(np.linspace(0, count + 1, min(most, count) + 2).round())
    samples = np.arange(1, count + 1)
    left = np.searchsorted(at, samples, side="right") - 1  # the knot at or before
    share = (samples - at[left]) / (at[left + 1] - at[left])
    rows = np.concatenate([samples, samples]) - 1 + start
    knots = np.concatenate([left, left + 1]) - 1  # neither end has a hat
    values = np.concatenate([1 - share, share])
    inside = (knots >= 0) & (knots < len(at) - 2) & (values != 0)
    entries = values[inside], (rows[inside], knots[inside])
    return sparse.csr_array(entries, shape=(size, len(at) - 2))


def program_of(logged: RegressionRows, knots: Knots) -> tuple[Program, Float[np.ndarray, " n"]]:
    """Return the linear program of regression rows, and their u − Φ·centre.

    Args:
        logged: data as regression rows, with their system.
        knots: largest number of weights per log; None for one per row.
    """
    rows, system = logged.record.rows, logged.system
    channel = logged.channels.get("quantised ÿ")
    delta = np.asarray(rows.delta)
    noise = np.zeros(delta.size + 2) if channel is None else np.asarray(channel.bound)
    phi, box = np.asarray(rows.regressors), np.asarray(system.half_widths)
    program = Program(phi, delta, noise, box, knots, pieces(rows.measure))
    return program, np.asarray(logged.record.input) - phi @ np.asarray(system.centre)
