"""Heat maps of what each stage of a design through filter and loop gains."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from experiments.paper import tables
from experiments.paper.designs import STUDIED
from experiments.paper.figures import SYMBOLS
from jaxid.io import plots

CHANGES = {
    "limit_percent": "limit",
    "filter_percent": "filter",
    "loop_percent": "loop",
    "robust_percent": "worst case",
}


def study(path: Path, rows: Sequence[tables.Row]) -> None:
    """Filter, loop and worst case: horizons by bandwidths, one row of panels per parameter."""
    stages = list(CHANGES.items())[1:]
    names = [name for name in STUDIED if any(row["parameter"] == name for row in rows)]
    canvas, panels = plots.figure(len(names), len(stages), (9.5, 2.7 * len(names)))
    horizons, bandwidths = (_values(rows, column) for column in ("N", "w_rad_s"))
    for number, panel in enumerate(panels):
        name, (column, title) = names[number // len(stages)], stages[number % len(stages)]
        cells = {
            (row["N"], row["w_rad_s"]): row[column] for row in rows if row["parameter"] == name
        }
        values = _rounded([[cells[n, w] for w in bandwidths] for n in horizons])
        names_of = _text(horizons), _text(bandwidths)
        plots.heat_map(panel, values, *names_of, "{:.1f}", ends=_ends(rows, dict(stages)))
        y = "horizon N" if title == stages[0][1] else ""
        x = "w (rad/s)" if name == names[-1] else ""
        plots.label(panel, x, y, f"{title}: $J_f$ of {SYMBOLS[name]}, %")
    plots.save(canvas, path)


def harder(path: Path, rows: Sequence[tables.Row]) -> None:
    """Settings by stages, one panel per parameter."""
    names = [name for name in STUDIED if any(row["parameter"] == name for row in rows)]
    canvas, panels = plots.figure(1, len(names), (9.5, 3.6))
    for panel, name in zip(panels, names, strict=True):
        own = [row for row in rows if row["parameter"] == name]
        values = _rounded([[row[column] for column in CHANGES] for row in own])
        settings = [str(row["setting"]) for row in own] if panel is panels[0] else [""] * len(own)
        columns = list(CHANGES.values())
        plots.heat_map(panel, values, settings, columns, "{:.1f}", ends=_ends(rows, CHANGES))
        plots.label(panel, "", "", f"$J_f$ of {SYMBOLS[name]}, %")
        panel.tick_params(axis="x", rotation=30)
    plots.save(canvas, path)


def _rounded(cells: Sequence[Sequence[tables.Value]]) -> plots.Array:
    """As they are written: what is written as nothing has no colour of its own either."""
    return np.round([[float(cell or 0.0) for cell in line] for line in cells], 1) + 0.0


def _ends(rows: Sequence[tables.Row], columns: Mapping[str, str]) -> tuple[float, float]:
    """Of the colours of all panels."""
    values = _rounded([[row[column] for column in columns] for row in rows])
    return float(values.min()), float(values.max())


def _values(rows: Sequence[tables.Row], column: str) -> list[tables.Value]:
    return list(dict.fromkeys(row[column] for row in rows))


def _text(values: Sequence[tables.Value]) -> list[str]:
    return [f"{float(value or 0.0):g}" for value in values]
