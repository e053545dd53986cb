"""Heat maps of tables 6 and 7: change of J_f by what a design takes into account."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from experiments.axes import linear_motor as motor
from experiments.paper import tables
from experiments.paper.designs import STUDIED
from experiments.paper.figures import SYMBOLS
from jaxid.io import plots

CHANGES = {
    "limit_percent": "limits of the axis",
    "filter_percent": "filter",
    "loop_percent": "closed loop",
    "robust_percent": "worst plant",
}
SETTINGS = {
    "7 V": "input limit 7 V",
    "w = 30": "filter of 30 rad/s",
    "heavy plant": "twice the mass",
    "weak gains": "low gains",
}
SIGN = "Change of $J_f$ in % (negative is better) when the design takes into account …"


def study(path: Path, rows: Sequence[tables.Row]) -> None:
    """Draw table 6: duration over filter bandwidth, one row of panels per parameter."""
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
        sides = [f"{motor.seconds(int(n or 0)):g}" for n in horizons], _text(bandwidths)
        plots.heat_map(panel, values, *sides, "{:.1f}", ends=_ends(rows, dict(stages)), signed=True)
        y = "duration (s)" if title == stages[0][1] else ""
        x = "filter bandwidth w (rad/s)" if name == names[-1] else ""
        plots.label(panel, x, y, f"… the {title}: {SYMBOLS[name]}")
    canvas.suptitle(SIGN, fontsize=12)
    plots.save(canvas, path)


def harder(path: Path, rows: Sequence[tables.Row]) -> None:
    """Draw table 7: settings over what the design takes into account, one panel per parameter."""
    names = [name for name in STUDIED if any(row["parameter"] == name for row in rows)]
    canvas, panels = plots.figure(1, len(names), (10.5, 4.2))
    for panel, name in zip(panels, names, strict=True):
        own = [row for row in rows if row["parameter"] == name]
        values = _rounded([[row[column] for column in CHANGES] for row in own])
        settings = [SETTINGS.get(str(row["setting"]), str(row["setting"])) for row in own]
        settings = settings if panel is panels[0] else [""] * len(own)
        columns = list(CHANGES.values())
        plots.heat_map(
            panel, values, settings, columns, "{:.1f}", ends=_ends(rows, CHANGES), signed=True
        )
        plots.label(panel, "", "", SYMBOLS[name])
        panel.set_xticklabels(columns, rotation=35, ha="right")
    canvas.suptitle(SIGN, fontsize=12)
    plots.save(canvas, path)


def _rounded(cells: Sequence[Sequence[tables.Value]]) -> plots.Array:
    """Return cells as they are printed, so that one printed as 0.0 has the colour of zero."""
    return np.round([[float(cell or 0.0) for cell in line] for line in cells], 1) + 0.0


def _ends(rows: Sequence[tables.Row], columns: Mapping[str, str]) -> tuple[float, float]:
    """Return the lowest and highest value of some columns: the colour range of all panels."""
    values = _rounded([[row[column] for column in columns] for row in rows])
    return float(values.min()), float(values.max())


def _values(rows: Sequence[tables.Row], column: str) -> list[tables.Value]:
    return list(dict.fromkeys(row[column] for row in rows))


def _text(values: Sequence[tables.Value]) -> list[str]:
    return [f"{float(value or 0.0):g}" for value in values]
