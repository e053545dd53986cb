"""The feasible parameter set: all θ in the prior box that are consistent with the data.

For any weights g and any θ that is consistent with the data

    cᵀθ ≤ cᵀcentre + gᵀ(u − Φ·centre) + worst-case error of g (`upper_ends`).

This holds for all g at once, so they may be chosen after the data are known: the smallest such
upper end is a linear program, and by its duality the largest cᵀθ of the feasible set (M. Milanese
and A. Vicino, "Optimal Estimation Theory for Dynamic Systems with Set Membership Uncertainty",
1991). Each end is computed from its weights, so that it does not depend on the tolerance of a
solver.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.identification.falsification import needed_factor
from jaxid.identification.modulating_functions import Knots, Program, program_of
from jaxid.identification.regression_rows import ROUNDED, RegressionRows, upper_ends
from jaxid.loop.log import InconsistentLogError
from jaxid.regression.estimate import Estimate

_DIRECTIONS = 48  # edges of a projection


class FeasibleSet(NamedTuple):
    """A box that contains the feasible parameter set: all θ that are consistent with the data.

    Attributes:
        lower: lower ends of the intervals, shape (m,), in the units of the parameters.
        upper: upper ends of the intervals, shape (m,), in the units of the parameters.
        disturbance_factor: proved lower bound, at most 1, on the factor of δ that the data need.
    """

    lower: Float[Array, " m"]
    upper: Float[Array, " m"]
    disturbance_factor: float


def feasible_set(
    logged: RegressionRows, others: Sequence[Estimate] = (), knots: Knots = None
) -> FeasibleSet:
    """Return intervals that contain all θ of the prior box that are consistent with the data.

    Args:
        logged: data as regression rows, with their system.
        others: estimates whose intervals are intersected with the result.
        knots: largest number of weights; default one per row, which gives the tightest intervals.

    Raises:
        InconsistentLogError: if no θ of the prior box is consistent with the data, or the
            intersection with `others` is empty.
    """
    require(
        isinstance(logged, RegressionRows),
        "Argument `logged` must be regression rows, such as "
        "`jaxid.identification.joined_rows.rows_of_logs(system, logs)`, but is a "
        f"{type(logged).__name__}.",
    )
    system = logged.system
    program, misfit = program_of(logged, knots)
    needed = needed_factor(logged, program, misfit)
    require(
        needed <= 1.0,
        "No parameter vector of the prior box explains the data of `logged` with |Δ| ≤ δ.",
        InconsistentLogError,
    )
    axes = np.eye(len(system.names))
    upper, lower = np.split(_ends(logged, program, misfit, np.concatenate([axes, -axes])), 2)
    # centre ± half-width may differ from an end of the box in the last bit
    first, last = np.asarray(system.lower), np.asarray(system.upper)
    close = ROUNDED * (last - first) / 2
    lower = np.where(-lower <= first + close, first, -lower)
    upper = np.where(upper >= last - close, last, upper)
    for other in others:
        lower, upper = np.maximum(lower, other.lower), np.minimum(upper, other.upper)
    for name, low, high in zip(system.names, lower, upper, strict=True):
        require(
            float(low) <= float(high),
            f"Argument `logged` requires {name} ≥ {float(low):.6g}, but also {name} ≤ "
            f"{float(high):.6g}, together with the estimates `others`.",
            InconsistentLogError,
        )
    return FeasibleSet(jnp.asarray(lower), jnp.asarray(upper), needed)


def projection(
    logged: RegressionRows, one: str, other: str, knots: Knots = None
) -> Float[np.ndarray, "directions 2"]:
    """Return a polygon that contains the projection of the feasible set onto two parameters.

    Args:
        logged: data as regression rows, with their system.
        one: name of the first parameter.
        other: name of the second parameter.
        knots: largest number of weights; default one per row.

    Returns:
        Its 48 corners, one (one, other) pair per row, in the units of the parameters.
    """
    system = logged.system
    program, misfit = program_of(logged, knots)
    pair = np.array([system.index(one), system.index(other)])
    size = np.asarray(system.half_widths)[pair]
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    functionals = np.zeros((_DIRECTIONS, len(system.names)))
    functionals[:, pair] = normals / size
    ends = _ends(logged, program, misfit, functionals)
    lines = np.stack([normals, np.roll(normals, -1, axis=0)], axis=1)
    corners = np.linalg.solve(lines, np.stack([ends, np.roll(ends, -1)], axis=1)[..., None])
    return corners[..., 0] * size


def _ends(
    logged: RegressionRows,
    program: Program,
    misfit: Float[np.ndarray, " n"],
    functionals: Float[np.ndarray, "k m"],
) -> Float[np.ndarray, " k"]:
    """Return the upper ends of Cθ; those of the prior box where the program has no solution."""
    weights = np.stack([program.least(c, misfit)[0] for c in functionals])
    ends, _ = upper_ends(logged, *map(jnp.asarray, (weights, misfit, functionals)))
    return np.asarray(ends)
