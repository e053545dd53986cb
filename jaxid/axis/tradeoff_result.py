"""The files and the text of designs for several durations and targets."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import cycle
from typing import ClassVar

import msgspec
import numpy as np

from jaxid._text import at_least
from jaxid.axis.design_result import HEADINGS, TITLE, evaluation_cells
from jaxid.axis.file import Axis
from jaxid.axis.result import Result
from jaxid.axis.summaries import TradeoffRow
from jaxid.axis.tradeoff import Tradeoff, duration_of
from jaxid.io import plots
from jaxid.io.files import table_bytes
from jaxid.io.text_tables import text_table

_COLUMNS = TradeoffRow.__struct_fields__


@dataclass(frozen=True, eq=False)
class TradeoffResult(Result):
    """The result of `jaxid design` for several motions, compared in one table and one picture.

    Attributes:
        found: designs.
    """

    found: Tradeoff
    name: ClassVar[str] = "tradeoff"
    names: ClassVar[tuple[str, ...]] = ("tradeoff.csv", "tradeoff.png")

    @property
    def axis(self) -> Axis:
        """The axis that the motions were designed for."""
        return self.found.axis

    @property
    def results(self) -> dict[str, str]:
        """The digests of the designs, by their places."""
        return self.found.results

    def summary(self) -> tuple[TradeoffRow, ...]:
        """Return one row per motion and parameter, as in `tradeoff.csv`."""
        return tuple(
            TradeoffRow(
                target=one.target,
                duration_s=duration_of(one.axis),
                parameter=name,
                unit=unit,
                **worth._asdict(),
            )
            for one in self.found.designs
            for name, unit, worth in zip(
                one.axis.system.names, one.axis.system.units, one.worth.by_parameter, strict=True
            )
        )

    def files(self) -> Mapping[str, bytes]:
        """Return the content of `tradeoff.csv` and `tradeoff.png`, by name."""
        rows = map(msgspec.structs.asdict, self.summary())
        return {"tradeoff.csv": table_bytes(_COLUMNS, rows), "tradeoff.png": page(self.found)}

    def text(self) -> str:
        """Return the comparison of the motions as a text table."""
        rows = [
            (one.target, f"{duration_of(one.axis):g}", name, unit, *evaluation_cells(worth))
            for one in self.found.designs
            for name, unit, worth in zip(
                one.axis.system.names, one.axis.system.units, one.worth.by_parameter, strict=True
            )
        ]
        header = ("target", "duration (s)", "parameter", "unit", *HEADINGS)
        return text_table(header, rows, TITLE)


def page(found: Tradeoff) -> bytes:
    """Return a picture of the predicted errors over the duration, one line per target, as PNG."""
    designs, system = found.designs, found.axis.system
    targets = list(dict.fromkeys(one.target for one in designs))
    count = len(system.names)
    most = 100 * max(float(np.max(np.asarray(one.worth.gap))) for one in designs)
    canvas, panels = plots.figure(1, count, (3.4 * count, 3.8))
    for k, (panel, name, unit) in enumerate(zip(panels, system.names, system.units, strict=True)):
        for target, colour in zip(targets, cycle(plots.CYCLE), strict=False):
            own = [one for one in designs if one.target == target]
            time = [duration_of(one.axis) for one in own]
            gap = [100 * float(one.worth.gap[k]) for one in own]
            panel.plot(time, gap, "o-", color=colour, label=f"motion for {target}")
        least = at_least(float(designs[0].worth.lower_bound[k]), 3)
        plots.label(panel, "duration (s)", "", f"{name}\nlower bound ± {least} {unit}")
        panel.set_ylim(0.0, 1.1 * most)
    panels[0].set_ylabel("% above the lower bound", fontsize=12)
    panels[0].legend(fontsize=10)
    canvas.suptitle("Predicted guaranteed half-widths by duration and target", fontsize=12)
    return plots.png(canvas)
