"""The paper's three tables and others beside those of this study, as CSV rows and as text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from experiments.axes import linear_motor as motor
from experiments.paper.designs import Cell
from experiments.paper.runs import ClosedLoopRun, OpenLoopRun
from jaxid._checks import require
from jaxid.io.files import Cell as Value
from jaxid.io.text_tables import text_table
from jaxid.regression.estimate import Estimate

Row = dict[str, Value]
Errors = Float[np.ndarray, " m"]

TABLE_1 = ("parameter", "N", "feasible", "J_star", "J_paper")
TABLE_2 = (
    "parameter", "N", "theta_true", "theta_hat", "J_star", "J_f",
    "lower", "upper", "prior_lower", "prior_upper", "J_paper",
)  # fmt: skip
TABLE_3 = (
    "input_V", "parameter", "theta_true", "theta_hat", "bound",
    "lower", "upper", "prior_lower", "prior_upper", "bound_paper",
)  # fmt: skip
DESIGNS = ("design", "N", "J_M", "J_B", "J_Fc", "J_dbar")
ROBUST = (
    "parameter", "N", "limits", "J_star", "proved",
    "random_plants", "random_beyond_position", "random_beyond_velocity", "random_beyond_input",
    "searched_plants", "searched_beyond_position", "searched_beyond_velocity",
    "searched_beyond_input",
)  # fmt: skip
LABELS = ("setting", "parameter", "N", "w_rad_s")
SEARCHES = (
    *LABELS, "design", "inputs", "seconds",
    "J_star", "J_aware", "J_f", "J_f_worst", "beyond", "jerk_m_s3",
)  # fmt: skip
_BY_STAGE = (
    "parameter", "N", "w_rad_s", "J_f_two_stage", "J_f_filter_aware", "J_f_end_to_end",
    "J_f_worst_two_stage", "J_f_worst_robust",
)  # fmt: skip
_CHANGES = ("limit_percent", "filter_percent", "loop_percent", "robust_percent")
GAINS = {
    "table6": _BY_STAGE,
    "table7": ("setting", *_BY_STAGE[:3], "J_f_18", "beyond_18", *_BY_STAGE[3:], *_CHANGES),
}
LIMITS = ("motion", "quantity", "lowest", "highest", "limit_lower", "limit_upper", "kept")


@dataclass(frozen=True)
class Table:
    """A table: its header and its rows."""

    header: Sequence[str]
    rows: list[Row]

    def text(self, title: str) -> str:
        """Return the table as text under a title."""
        return text_table(
            self.header, [[row[name] for name in self.header] for row in self.rows], title
        )


def chosen_horizon(errors: Mapping[int, float], tie: float = 0.005) -> int:
    """Return the horizon of the smallest J*; a shorter one wins if its J* is within 0.5 % of it."""
    best = min(errors.values())
    return min(horizon for horizon, error in errors.items() if error <= (1 + tie) * best)


def table_1(errors: Mapping[Cell, Errors], names: Sequence[str], horizons: Sequence[int]) -> Table:
    """Return Table I: J* of every parameter and horizon."""
    rows: list[Row] = []
    for index, name in enumerate(names):
        paper_horizon, paper_error = motor.PAPER_TABLE_1[name]
        for horizon in horizons:
            error = errors.get(Cell(name, horizon))
            rows.append(
                {
                    "parameter": name,
                    "N": horizon,
                    "feasible": error is not None,
                    "J_star": None if error is None else float(error[index]),
                    "J_paper": paper_error if horizon == paper_horizon else None,
                }
            )
    return Table(TABLE_1, rows)


def crosscheck(shipped: Mapping[Cell, float], others: Mapping[str, Mapping[Cell, float]]) -> Table:
    """Return a table of J* of the study and of other searches, and of their differences."""
    rows: list[Row] = []
    for cell, own in shipped.items():
        values = {name: found[cell] for name, found in others.items()}
        lowest, highest = min(values.values()), max(values.values())
        rows.append(
            {
                "parameter": cell.target,
                "N": cell.horizon,
                "J_star": own,
                **values,
                "spread_percent": 100 * (highest / lowest - 1),
                "above_best_percent": 100 * (own / min(own, lowest) - 1),
            }
        )
    return Table(tuple(rows[0]), rows)


def designs_table(errors: Mapping[Cell, Errors]) -> Table:
    """Return a table of the planned error J of every parameter for every design."""
    rows: list[Row] = []
    for cell, error in sorted(errors.items(), key=lambda item: (item[0].target, item[0].horizon)):
        values = dict(zip(DESIGNS[2:], map(float, error), strict=True))
        rows.append({"design": cell.target, "N": cell.horizon, **values})
    return Table(DESIGNS, rows)


def table_2(loops: Mapping[Cell, ClosedLoopRun], errors: Mapping[Cell, Errors]) -> Table:
    """Return Table II: θ̂ ± J_f of each parameter from its own experiment, with exact signals."""
    rows: list[Row] = []
    for cell, loop in loops.items():
        index = motor.system().index(cell.target)
        rows.append(
            {
                "parameter": cell.target,
                "N": cell.horizon,
                "J_star": float(errors[cell][index]),
                "J_f": float(loop.estimate.bound[index]),
                "J_paper": motor.PAPER_TABLE_2[cell.target][1],
                **_interval(loop.estimate, index),
            }
        )
    return Table(TABLE_2, rows)


def table_3(runs: Mapping[float, OpenLoopRun]) -> Table:
    """Return Table III: every parameter from open-loop pulses."""
    rows: list[Row] = []
    for amplitude in motor.OPEN_LOOP_AMPLITUDES:
        estimate = runs[amplitude].estimate
        for index, name in enumerate(motor.system().names):
            rows.append(
                {
                    "input_V": amplitude,
                    "parameter": name,
                    "bound": float(estimate.bound[index]),
                    "bound_paper": motor.PAPER_TABLE_3[amplitude][index],
                    **_interval(estimate, index),
                }
            )
    return Table(TABLE_3, rows)


def limits_table(loops: Mapping[Cell, ClosedLoopRun]) -> Table:
    """Return a table of the ranges of the simulated axis beside the limits of its reference."""
    limits = motor.limits()
    rows: list[Row] = []
    for cell, loop in loops.items():
        signals = loop.signals
        actual = {
            "position (m)": (signals.position, limits.position),
            "velocity (m/s)": (signals.velocity, limits.velocity),
            "input (V)": (signals.input, limits.input),
        }
        for quantity, (values, limit) in actual.items():
            lowest, highest = float(values.min()), float(values.max())
            rows.append(
                {
                    "motion": cell.target,
                    "quantity": quantity,
                    "lowest": lowest,
                    "highest": highest,
                    "limit_lower": float(limit[0]),
                    "limit_upper": float(limit[1]),
                    "kept": bool(limit[0] <= lowest and highest <= limit[1]),
                }
            )
    return Table(LIMITS, rows)


# the objective of each design stage, all within the limits of the axis
OBJECTIVES = {
    "two_stage": "J_star",
    "filter_aware": "J_aware",
    "end_to_end": "J_f",
    "robust": "J_f_worst",
}


def number(row: Row, column: str) -> float:
    """Return a number of a row, or NaN if there is none."""
    value = row[column]
    return np.nan if value is None or value == "" else float(value)


def gains(designs: Mapping[str, Row]) -> Row:
    """Return J_f of one case by design stage, and its change from stage to stage in per cent.

    Each stage is represented by the best motion for its objective that any search of the case has
    found, so that no stage wins only because another search missed a motion. The design by (18) may
    exceed the limits of the axis: `beyond_18`, in half-widths of a limit.

    Raises:
        ValueError: if a design has no number, or another design than that by (18) exceeds its
            limits.
    """
    for name, row in designs.items():
        for column in OBJECTIVES.values():
            require(
                np.isfinite(number(row, column)),
                f"Argument `designs`: the design {name} has no {column}, but {row[column]}.",
            )
        require(
            name == "by_18" or number(row, "beyond") <= 0,
            f"Argument `designs`: the design {name} makes the axis leave its limits, beyond is "
            f"{row['beyond']}, not below zero.",
        )
    by_18 = designs["by_18"]
    kept = [row for name, row in designs.items() if name != "by_18"]
    best = {
        stage: min(kept, key=lambda row: number(row, column))
        for stage, column in OBJECTIVES.items()
    }
    two, aware, loop = (number(best[stage], "J_f") for stage in list(OBJECTIVES)[:3])
    worst_two, worst_loop, worst_robust = (
        number(best[stage], "J_f_worst") for stage in ("two_stage", "end_to_end", "robust")
    )
    return {
        "J_f_18": number(by_18, "J_f"),
        "beyond_18": number(by_18, "beyond"),
        "J_f_two_stage": two,
        "J_f_filter_aware": aware,
        "J_f_end_to_end": loop,
        "J_f_worst_two_stage": worst_two,
        "J_f_worst_robust": worst_robust,
        "limit_percent": 100 * (two / number(by_18, "J_f") - 1),
        "filter_percent": 100 * (aware / two - 1),
        "loop_percent": 100 * (loop / aware - 1),
        "robust_percent": 100 * (worst_robust / worst_loop - 1),
    }


def not_reduced(table: Table, bound: str) -> list[str]:
    """Return a sentence for every bound that is no better than the prior box."""
    sentences = []
    for row in table.rows:
        half = (float(row["prior_upper"] or 0) - float(row["prior_lower"] or 0)) / 2
        if float(row[bound] or 0) >= half:
            where = f"{row['input_V']} V" if "input_V" in row else f"N = {row['N']}"
            sentences.append(
                f"{row['parameter']} at {where}: prior interval not reduced, since the bound "
                f"{row[bound]:.3g} is at least its half-width {half:.3g}."
            )
    return sentences


def _interval(estimate: Estimate, index: int) -> Row:
    return {
        "theta_true": motor.TRUE_PARAMETERS[index],
        "theta_hat": float(estimate.theta[index]),
        "lower": float(estimate.lower[index]),
        "upper": float(estimate.upper[index]),
        "prior_lower": float(estimate.prior_lower[index]),
        "prior_upper": float(estimate.prior_upper[index]),
    }
