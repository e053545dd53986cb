"""Table 4, and the guaranteed intervals of one experiment beside the paper's three."""

from collections.abc import Mapping

import jax.numpy as jnp

from experiments._support.evaluations import rows_of
from experiments.axes import linear_motor as motor
from experiments.paper.certificates import Proof, Worth
from experiments.paper.designs import Cell
from experiments.paper.tables import Errors, Row, Table

TABLE_4 = (
    "design", "parameter", "N", "J_lse", "J_weighted_1", "J_weighted_2", "r_minimax",
    "predicted", "lower_bound", "gap",
)  # fmt: skip
PROVED = (
    "parameter", "theta_true", "lower", "upper", "half_width",
    "feasible_lower", "feasible_upper", "feasible_half_width", "lower_bound", "J_paper",
)  # fmt: skip
_ESTIMATORS = {
    "J_weighted_1": "weighted_1",
    "J_weighted_2": "weighted_2",
    "r_minimax": "minimax",
}


def table_4(worths: Mapping[Cell, Worth]) -> Table:
    """Return table 4: errors of each design by every estimator, and predicted / lower bound − 1."""
    rows: list[Row] = []
    for cell, (evaluation, errors) in worths.items():
        evaluated = rows_of({cell.label: evaluation}, "design", motor.system().names)
        for k, row in enumerate(evaluated):
            others = {column: float(errors[name][k]) for column, name in _ESTIMATORS.items()}
            rows.append({**row, **others, "N": cell.horizon})
    return Table(TABLE_4, rows)


def proved(proof: Proof, floor: Errors) -> Table:
    """Return a table of guaranteed intervals and of the feasible set, from one experiment."""
    found, left = proof.guarantee.estimate, proof.left
    possible = jnp.stack([left.lower, left.upper, (left.upper - left.lower) / 2], axis=1)
    rows: list[Row] = []
    for k, name in enumerate(motor.system().names):
        lower, upper, half = (float(x) for x in possible[k])
        paper = motor.PAPER_TABLE_2.get(name)
        rows.append(
            {
                "parameter": name,
                "theta_true": motor.TRUE_PARAMETERS[k],
                "lower": float(found.lower[k]),
                "upper": float(found.upper[k]),
                "half_width": float(found.half_widths[k]),
                "feasible_lower": lower,
                "feasible_upper": upper,
                "feasible_half_width": half,
                "lower_bound": float(floor[k]),
                "J_paper": None if paper is None else paper[1],
            }
        )
    return Table(PROVED, rows)
