"""Unidentifiable directions of the parameters: those that a motion does not excite."""

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.optimize import linprog

from jaxid.identification.modulating_functions import Knots, Program, program_of
from jaxid.identification.regression_rows import RegressionRows


def unidentifiable_directions(
    logged: RegressionRows, knots: Knots = None
) -> dict[str, Float[np.ndarray, " m"]]:
    """Return directions of the parameters that a motion cannot identify, whatever the inputs are.

    Args:
        logged: regression rows made with the prior box.
        knots: largest number of weights per log; default one per row.

    Returns:
        For each parameter whose prior interval may not be narrowed at all, its name and the
        simplest direction ν, shape (m,): centre + ν and centre − ν explain the same data and span
        this interval.
    """
    program, _ = program_of(logged, knots)
    found = {name: _unseen(program, k) for k, name in enumerate(logged.system.names)}
    return {name: combination for name, combination in found.items() if combination is not None}


def _unseen(program: Program, index: int) -> Float[np.ndarray, " m"] | None:
    """Return the simplest ν with ν_i = b_i that is consistent with all weights, or None.

    In half-widths: |momentsᵀν − Sᵀe| ≤ 1 at every knot for some encoder errors |e| ≤ 1.
    """
    (m, count), noisy = program.moments.shape, program.spread.shape[0]
    rows = sparse.hstack([program.moments.T, -program.moments.T, program.spread.T])
    unit = np.zeros((1, 2 * m + noisy))
    unit[0, index], unit[0, m + index] = 1.0, -1.0
    # linprog accepts a sparse A_ub, although its stub does not
    solution = linprog(  # pyright: ignore[reportCallIssue]
        np.concatenate([np.ones(2 * m), np.zeros(noisy)]),
        A_ub=sparse.vstack([rows, -rows]),  # pyright: ignore[reportArgumentType]
        b_ub=np.ones(2 * count),
        A_eq=unit,
        b_eq=[1.0],
        bounds=[(0.0, 1.0)] * (2 * m) + [(-1.0, 1.0)] * noisy,
        method="highs",
    )
    if solution.x is None:
        return None
    return (solution.x[:m] - solution.x[m : 2 * m]) * program.half_widths
