"""Arrays and an `Axes` in, ink out; tables as text. The only matplotlib of the package."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jaxid.io.files import UNITS, write_bytes
from jaxid.motion.trajectory import JerkTrajectory

# Okabe and Ito's palette: told apart by colour-blind readers too
BLACK, ORANGE, SKY, GREEN, BLUE, RED = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00",
)  # fmt: skip
GREY = "#888888"
CYCLE = (BLUE, RED, GREEN, ORANGE, SKY, BLACK)

Array = Float[np.ndarray, "..."]


def text_table(header: Sequence[str], rows: Sequence[Sequence[object]], title: str = "") -> str:
    """Columns aligned for reading; numbers with four significant digits, None as a dash."""
    cells = [list(header), *([_text(cell) for cell in row] for row in rows)]
    widths = [max(len(line[k]) for line in cells) for k in range(len(header))]
    lines = [
        "  ".join(cell.rjust(w) for cell, w in zip(line, widths, strict=True)) for line in cells
    ]
    lines.insert(1, "  ".join("-" * w for w in widths))
    return "\n".join(([title] if title else []) + lines)


def figure(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (7.0, 5.0)
) -> tuple[Figure, list[Axes]]:
    """A figure that needs no display, and its panels in reading order."""
    canvas = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(canvas)
    panels = np.atleast_1d(canvas.subplots(rows, columns)).ravel()
    for panel in panels:
        panel.grid(alpha=0.3)
        panel.tick_params(labelsize=11)
    return canvas, list(panels)


def png(canvas: Figure) -> bytes:
    """The bytes of a picture; the same drawing makes the same ones."""
    buffer = io.BytesIO()
    canvas.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()


def save(canvas: Figure, path: Path) -> None:
    """Write a PNG whole or not at all; one that already has these bytes is left untouched."""
    write_bytes(path, png(canvas))


def label(panel: Axes, x: str, y: str, title: str = "") -> None:
    """Axis labels and title in sizes that survive halving."""
    panel.set_xlabel(x, fontsize=12)
    panel.set_ylabel(y, fontsize=12)
    if title:
        panel.set_title(title, fontsize=12)


def limit_lines(panel: Axes, interval: Sequence[float]) -> None:
    """Both ends of an interval as dashed lines."""
    for end in interval:
        panel.axhline(end, color=GREY, linestyle="--", linewidth=1.2)


def motion(
    panels: Sequence[Axes],
    trajectory: JerkTrajectory,
    limits: Array,
    title: str,
    coordinate: str = "linear",
) -> None:
    """Position, velocity and acceleration of a desired motion, with the rows of their limits."""
    time = jnp.linspace(0.0, float(trajectory.duration), 2000)
    states = trajectory.states(time)
    unit = UNITS[coordinate]
    names = (f"position ({unit})", f"velocity ({unit}/s)", f"acceleration ({unit}/s²)")
    for panel, values, interval, name in zip(panels, states, limits, names, strict=False):
        panel.plot(time, np.asarray(values), color=BLUE, linewidth=1.8)
        limit_lines(panel, np.asarray(interval).tolist())
        label(panel, "", name)
    panels[0].set_title(title, fontsize=12)
    panels[-1].set_xlabel("time (s)", fontsize=12)


def series(
    panel: Axes, time: Array, values: Array, y: str, colour: str = BLUE, title: str = ""
) -> None:
    """One signal over time."""
    panel.plot(time, values, color=colour, linewidth=1.2)
    label(panel, "time (s)", y, title)


def intervals(
    panel: Axes, names: Sequence[str], bars: Mapping[str, tuple[Array, Array]], truth: Array
) -> None:
    """Intervals of several methods for several parameters, each in half-widths of the prior box.

    Args:
        panel: to draw on.
        names: of the parameters, from left to right.
        bars: for each method the lower and upper ends, one per parameter.
        truth: of each parameter.
    """
    offsets = np.linspace(-0.25, 0.25, len(bars))
    for (name, (lower, upper)), offset, colour in zip(
        bars.items(), offsets, (GREY, *CYCLE), strict=False
    ):
        x = np.arange(len(names)) + offset
        panel.vlines(x, lower, upper, color=colour, linewidth=7, label=name)
    x = np.arange(len(names))
    panel.hlines(truth, x - 0.38, x + 0.38, color=BLACK, linewidth=1.5, label="true value")
    panel.set_xticks(x, names, fontsize=12)
    panel.legend(fontsize=10)


def bars(
    panel: Axes,
    names: Sequence[str],
    kinds: Mapping[str, Array],
    highest: float,
    wanted: Array,
) -> None:
    """Numbers of several kinds for several parameters.

    Args:
        panel: to draw on.
        names: of the parameters, from left to right.
        kinds: for each kind a number per parameter.
        highest: bars end there.
        wanted: of each parameter, as a black line; inf for none.
    """
    x, width = np.arange(len(names)), 0.8 / len(kinds)
    offsets = width * (np.arange(len(kinds)) - (len(kinds) - 1) / 2)
    for (kind, values), offset, colour in zip(kinds.items(), offsets, CYCLE, strict=False):
        panel.bar(x + offset, np.minimum(values, highest), 0.93 * width, color=colour, label=kind)
    some = np.flatnonzero(wanted <= highest)
    if some.size:
        panel.hlines(
            wanted[some], some - 0.42, some + 0.42, color=BLACK, linewidth=1.5, label="wanted"
        )
    panel.set_xticks(x, names, fontsize=12)
    panel.legend(fontsize=10)


def heat_map(
    panel: Axes,
    values: Array,
    rows: Sequence[str],
    columns: Sequence[str],
    number: str,
    highest: float = np.inf,
    logarithmic: bool = False,
    ends: tuple[float, float] | None = None,
) -> None:
    """A table as numbers on colours, from the smallest value (dark) to the largest.

    Cells that were never run (NaN) are hatched, infinite ones black, those beyond `highest` orange.

    Args:
        panel: to draw on.
        values: one row per row of cells, from top to bottom.
        rows: their names.
        columns: the names of the columns.
        number: how to write one.
        highest: that is still in order.
        logarithmic: whether equal ratios are equal steps of colour.
        ends: of the colours, for several maps alike; default the extremes of the values.
    """
    ordinary = values[np.isfinite(values) & (values <= highest)]
    if ends is None:
        top = min(highest, 1.0)  # of colours that no value has
        ends = (ordinary.min(), ordinary.max()) if ordinary.size else (top / 2, top)
    norm = (LogNorm if logarithmic else Normalize)(*ends)
    colours = colormaps["viridis"].with_extremes(over=ORANGE)
    shown = np.ma.masked_invalid(values)
    panel.imshow(shown, norm=norm, cmap=colours, aspect="auto", interpolation="nearest")
    for (row, column), value in np.ndenumerate(values):
        if np.isnan(value):
            _box(panel, row, column, facecolor="white", edgecolor=GREY, hatch="////")
            continue
        if np.isinf(value):
            _box(panel, row, column, facecolor=BLACK)
        text = number.format(value) if np.isfinite(value) else "∞"
        colour = BLACK if np.isfinite(value) and norm(value) > 0.55 else "white"
        panel.text(column, row, text, ha="center", va="center", fontsize=12, color=colour)
    panel.grid(False)
    panel.set_xticks(range(len(columns)), columns, fontsize=12)
    panel.set_yticks(range(len(rows)), rows, fontsize=12)


def _box(panel: Axes, row: int, column: int, **style: Any) -> None:
    panel.add_patch(Rectangle((column - 0.5, row - 0.5), 1.0, 1.0, linewidth=0.0, **style))


def _text(cell: object) -> str:
    if cell is None:
        return "-"
    if isinstance(cell, float):
        return f"{cell:.4g}" if abs(cell) < 1e5 else f"{cell:.3e}"
    return str(cell)
