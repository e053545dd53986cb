"""Drawing of arrays on matplotlib axes; only this module imports matplotlib."""

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
from matplotlib.ticker import EngFormatter

from jaxid.io.files import UNITS, write_bytes
from jaxid.motion.trajectory import JerkTrajectory, states_at

# Okabe and Ito's palette: colour-blind readers can distinguish all of its colours
BLACK, ORANGE, SKY, GREEN, BLUE, RED = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00",
)  # fmt: skip
GREY = "#888888"
CYCLE = (BLUE, RED, GREEN, ORANGE, SKY, BLACK)

Array = Float[np.ndarray, "..."]


def figure(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (7.0, 5.0)
) -> tuple[Figure, list[Axes]]:
    """Return a figure that needs no display, and its axes in reading order.

    Args:
        rows: number of rows of axes.
        columns: number of columns of axes.
        size: width and height of the figure, inches.
    """
    canvas = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(canvas)
    panels = np.atleast_1d(canvas.subplots(rows, columns)).ravel()
    for panel in panels:
        panel.grid(alpha=0.3)
        panel.tick_params(labelsize=11)
    return canvas, list(panels)


def png(canvas: Figure) -> bytes:
    """Return a figure as the bytes of a PNG; the same drawing gives the same bytes."""
    buffer = io.BytesIO()
    canvas.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()


def save(canvas: Figure, path: Path) -> None:
    """Write a figure to a PNG file; a file that already has these bytes is left untouched."""
    write_bytes(path, png(canvas))


def label(panel: Axes, x: str, y: str, title: str = "") -> None:
    """Set the axis labels and the title of axes, in a size that is readable at half scale.

    Args:
        panel: axes to label.
        x: label of the horizontal axis.
        y: label of the vertical axis.
        title: title; default none.
    """
    panel.set_xlabel(x, fontsize=12)
    panel.set_ylabel(y, fontsize=12)
    if title:
        panel.set_title(title, fontsize=12)


def engineering(panel: Axes, unit: str) -> None:
    """Label the vertical axis in a unit with SI prefixes, such as 100 µm."""
    panel.yaxis.set_major_formatter(EngFormatter(unit=unit))


def limit_lines(panel: Axes, interval: Sequence[float]) -> None:
    """Draw both ends of an interval as dashed horizontal lines."""
    for end in interval:
        panel.axhline(end, color=GREY, linestyle="--", linewidth=1.2)


def motion(
    panels: Sequence[Axes],
    trajectory: JerkTrajectory,
    limits: Array,
    title: str,
    coordinate: str = "linear",
) -> None:
    """Draw position, velocity and acceleration of a desired motion over time, with their limits.

    Args:
        panels: three axes to draw on.
        trajectory: motion.
        limits: rows (lower, upper) for position, velocity and acceleration.
        title: title of the first axes.
        coordinate: "linear" (m) or "rotary" (rad), for the labels.
    """
    time = np.linspace(0.0, np.sum(np.asarray(trajectory.durations)), 2000)
    states = states_at(trajectory, jnp.asarray(time))
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
    """Draw one signal over time.

    Args:
        panel: axes to draw on.
        time: times, s.
        values: values of the signal.
        y: label of the vertical axis.
        colour: colour of the line.
        title: title; default none.
    """
    panel.plot(time, values, color=colour, linewidth=1.2)
    label(panel, "time (s)", y, title)


def intervals(
    panel: Axes, names: Sequence[str], bars: Mapping[str, tuple[Array, Array]], truth: Array
) -> None:
    """Draw the intervals of several methods for several parameters, and the true values.

    Args:
        panel: axes to draw on.
        names: names of the parameters, from left to right.
        bars: lower and upper ends for each method, one per parameter.
        truth: true value of each parameter, on the same scale.
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
    """Draw several kinds of numbers as bars for several parameters.

    Args:
        panel: axes to draw on.
        names: names of the parameters, from left to right.
        kinds: for each kind one number per parameter.
        highest: value at which higher bars are cut.
        wanted: required value of each parameter, drawn as a black line; inf for none.
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
    panel.legend(fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=2)


def heat_map(
    panel: Axes,
    values: Array,
    rows: Sequence[str],
    columns: Sequence[str],
    number: str,
    highest: float = np.inf,
    logarithmic: bool = False,
    ends: tuple[float, float] | None = None,
    signed: bool = False,
) -> None:
    """Draw a table as numbers on colours, from the smallest value (dark) to the largest.

    NaN cells (not computed) are hatched, infinite ones black, those above `highest` orange-red.

    Args:
        panel: axes to draw on.
        values: values of the cells, rows from top to bottom.
        rows: names of the rows.
        columns: names of the columns.
        number: format string of a value.
        highest: largest value that has an ordinary colour.
        logarithmic: whether equal ratios of values are equal steps of colour.
        ends: lowest and highest value of the colours, for several maps alike; default the extremes
            of the values.
        signed: whether the values are changes: colours diverge from white at zero, violet for
            negative and orange for positive values, equally far on both sides.
    """
    ordinary = values[np.isfinite(values) & (values <= highest)]
    if ends is None:
        top = min(highest, 1.0)  # 1 if no value is finite
        ends = (ordinary.min(), ordinary.max()) if ordinary.size else (top / 2, top)
    if signed:
        ends = -max(map(abs, ends)), max(map(abs, ends))
    norm = (LogNorm if logarithmic else Normalize)(*ends)
    colours = colormaps["PuOr_r" if signed else "viridis"].with_extremes(over=RED)
    shown = np.ma.masked_invalid(values)
    panel.imshow(shown, norm=norm, cmap=colours, aspect="auto", interpolation="nearest")
    for (row, column), value in np.ndenumerate(values):
        if np.isnan(value):
            _box(panel, row, column, facecolor="white", edgecolor=GREY, hatch="////")
            continue
        if np.isinf(value):
            _box(panel, row, column, facecolor=BLACK)
        text = number.format(value) if np.isfinite(value) else "∞"
        panel.text(
            column, row, text, ha="center", va="center", fontsize=12,
            color=_readable(colours(norm(value))) if np.isfinite(value) else "white",
        )  # fmt: skip
    panel.grid(False)
    panel.set_xticks(range(len(columns)), columns, fontsize=12)
    panel.set_yticks(range(len(rows)), rows, fontsize=12)


def _readable(background: Sequence[float]) -> str:
    """Return black or white, whichever has more contrast to a colour (red, green, blue, …)."""
    luminance = float(np.dot(background[:3], (0.299, 0.587, 0.114)))  # ITU-R BT.601
    return BLACK if luminance > 0.5 else "white"


def _box(panel: Axes, row: int, column: int, **style: Any) -> None:
    panel.add_patch(Rectangle((column - 0.5, row - 0.5), 1.0, 1.0, linewidth=0.0, **style))
