"""From a recorded log of an axis of a file to intervals, and to whether the log belongs to it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Array

from jaxid._checks import require
from jaxid.axis.file import PROGRAM, Axis
from jaxid.axis.result import Result
from jaxid.axis.summaries import IdentificationSummary, IdentifiedParameter, UsedPiece
from jaxid.identification.batches import STRETCH, Proved, prove, rounded_down
from jaxid.identification.falsification import LEAST
from jaxid.identification.intervals import assumptions
from jaxid.identification.least_squares import LeastSquaresFit, fit_least_squares
from jaxid.io import plots
from jaxid.io.files import UNITS, json_bytes
from jaxid.io.log_file import Recorded
from jaxid.io.segments import Segment, rows_used, steady_segments
from jaxid.loop.log import Log
from jaxid.model.system import System
from jaxid.motion.limits import Limits

_SHOWN = 10  # pieces that are named
_ABSURD = 20.0  # times a limit's half-width, which no stop, amplifier or clock would let pass


class Identified(NamedTuple):
    """What a log says of an axis.

    Attributes:
        axis: of the file.
        recorded: the log.
        pieces: of it, which were used.
        proved: by all of them.
        fit: least squares, if the log tells all parameters apart.
    """

    axis: Axis
    recorded: Recorded
    pieces: tuple[Segment, ...]
    proved: Proved
    fit: LeastSquaresFit | None


def identify_axis(
    axis: Axis, recorded: Recorded, tell: Callable[[str], None] = lambda message: None
) -> Identified:
    """Read a log piece by piece, and what all pieces prove together.

    Args:
        axis: from a file.
        recorded: a log, of a motion that was designed or of any other.
        tell: told what goes on.

    Raises:
        ValueError: if it cannot be a log of this axis, its rows or its units.
    """
    _require_plausible(recorded, axis.task.limits, axis.system)
    servo, system = axis.servo, axis.system
    found = steady_segments(recorded, servo.period, servo.resolution, axis.delay, longest=STRETCH)
    logs = [piece.log for piece in found]
    proved = prove(system, logs, tell)
    return Identified(axis, recorded, found, proved, _fit_if_possible(system, logs))


def _fit_if_possible(system: System, logs: Sequence[Log]) -> LeastSquaresFit | None:
    try:
        return fit_least_squares(system, logs)
    except ValueError:  # a bound needs no θ that is the only one to fit
        return None


def _require_plausible(recorded: Recorded, limits: Limits, system: System) -> None:
    unit = UNITS[system.coordinate]
    for name, values, interval, entry in (
        ("position", recorded.position, limits.position, "position_unit"),
        ("input", recorded.input, limits.input, "input_unit"),
    ):
        low, high = (float(end) for end in interval)
        finite = values[np.isfinite(values)]
        require(finite.size > 0, f"Argument `recorded`: no {name} is a number.")
        beyond = float(np.max(np.abs(finite - (low + high) / 2))) / ((high - low) / 2)
        across = unit if name == "position" else system.input_unit
        require(
            beyond <= _ABSURD,
            f"Argument `recorded`: its {name} reaches {float(finite.min()):.6g} to "
            f"{float(finite.max()):.6g} {across}, {beyond:.0f} times as far as its limits "
            f"{low:g} to {high:g} {across}. Is {entry} right?",
        )


@dataclass(frozen=True, eq=False)
class IdentifyResult(Result):
    """What a log proves, as files and as text.

    Attributes:
        found: what a log says.
        log_sha256: of the file that holds the log.
    """

    found: Identified
    log_sha256: str
    name: ClassVar[str] = "identify"
    names: ClassVar[tuple[str, ...]] = ("result.json", "residuals.png")

    @property
    def axis(self) -> Axis:
        return self.found.axis

    @property
    def sources(self) -> dict[str, str]:
        return super().sources | {"log": self.log_sha256}

    def summary(self) -> IdentificationSummary:
        return summary(self.found)

    def files(self) -> Mapping[str, bytes]:
        return {"result.json": json_bytes(self.summary()), "residuals.png": page(self.found)}

    def text(self) -> str:
        return text(self.found)


def summary(found: Identified) -> IdentificationSummary:
    """For other programs: intervals, or how large δ would have to be, and what all rests on."""
    axis, system, proved = found.axis, found.axis.system, found.proved
    logs = [piece.log for piece in found.pieces]
    return IdentificationSummary(
        program=PROGRAM,
        consistent=proved.contradiction is None,
        contradiction=proved.contradiction,
        least_factor_of_disturbance_bound=_factor(proved),
        parameters={name: _parameter(found, k) for k, name in enumerate(system.names)},
        not_told_apart={
            name: dict(zip(system.names, combination.tolist(), strict=True))
            for name, combination in proved.unseen.items()
        },
        rows=found.recorded.position.size,
        rows_used=rows_used(found.pieces),
        stretches=proved.stretches,
        ticks_to_a_weight=proved.coarse,
        pieces=tuple(
            UsedPiece(
                first_row=piece.first + 1,
                last_row=piece.last + 1,
                period_s=float(piece.log.period),
                jitter_s=float(piece.log.jitter),
            )
            for piece in found.pieces
        ),
        rests_on=assumptions(system, *logs, delay=axis.delay),
    )


def _factor(proved: Proved) -> float | None:
    """None where it says nothing: less than a thousandth, or contradicting for another reason."""
    known = proved.factor > LEAST and not (proved.contradiction and proved.factor <= 1)
    return proved.factor if known else None


def _parameter(found: Identified, k: int) -> IdentifiedParameter:
    system = found.axis.system
    known = IdentifiedParameter(
        unit=system.units[k],
        prior=(float(system.lower[k]), float(system.upper[k])),
        least_squares=None if found.fit is None else float(found.fit.theta[k]),
    )
    proved, estimate = found.proved, found.proved.estimate
    if estimate is None:
        return known
    return msgspec.structs.replace(
        known,
        theta_hat=float(estimate.theta[k]),
        bound=float(estimate.bound[k]),
        guaranteed=(float(estimate.lower[k]), float(estimate.upper[k])),
        possible=(float(proved.lower[k]), float(proved.upper[k])),
    )


def text(found: Identified) -> str:
    """For people."""
    proved = found.proved
    long = f"It is long: {proved.stretches} stretches of it were read one by one."
    return "\n".join(
        (
            _rows_used(found),
            *((long,) if proved.stretches > 1 else ()),
            _intervals(found),
            *(
                f"{name} cannot be told apart from others: {_exchange(found, combination)}"
                for name, combination in proved.unseen.items()
            ),
            "This rests on:",
            *(f"  {sentence}" for sentence in summary(found).rests_on),
        )
    )


def _rows_used(found: Identified) -> str:
    rows, pieces = found.recorded.position.size, found.pieces
    shown = [f"{p.first + 1}–{p.last + 1}" for p in pieces]
    where = ", ".join(shown[:_SHOWN]) + (", …" if len(shown) > _SHOWN else "")
    most = max(float(p.log.jitter) for p in pieces)
    return f"Used {rows_used(pieces)} of {rows} rows: {where}; jitter up to {most:.3g} s."


def _intervals(found: Identified) -> str:
    system = found.axis.system
    proved, estimate = found.proved, found.proved.estimate
    if estimate is None:
        return f"The log contradicts the axis. {proved.contradiction} No interval is printed."
    header = ("parameter", "unit", "prior", "guaranteed", "possible")
    pairs = (
        (system.lower, system.upper),
        (estimate.lower, estimate.upper),
        (proved.lower, proved.upper),
    )
    columns = [
        [f"{low:.5g} … {high:.5g}" for low, high in zip(*map(np.asarray, pair), strict=True)]
        for pair in pairs
    ]
    rows = list(zip(system.names, system.units, *columns, strict=True))
    takes = f"{rounded_down(proved.factor):g}·δ at least" if proved.factor > LEAST else "hardly any"
    title = f"What the log proves; to explain it takes {takes}"
    return plots.text_table(header, rows, title)


def _exchange(found: Identified, combination: np.ndarray) -> str:
    system = found.axis.system
    parts = zip(system.names, combination.tolist(), system.units, strict=True)
    return ", ".join(f"{amount:+.3g} {unit} of {name}" for name, amount, unit in parts if amount)


def page(found: Identified) -> bytes:
    """What least squares leaves of the input by time, position and velocity, beside ±δ."""
    system = found.axis.system
    rest = found.fit or LeastSquaresFit(*np.zeros((6, 0)))
    unit = UNITS[system.coordinate]
    canvas, panels = plots.figure(1, 3, (12.0, 4.2))
    bound = np.asarray(
        system.disturbance_bound(jnp.asarray(rest.position), jnp.asarray(rest.velocity))
    )
    views: tuple[tuple[str, Array | np.ndarray], ...] = (
        ("time (s)", rest.time),
        (f"velocity ({unit}/s)", rest.velocity),
        (f"position ({unit})", rest.position),
    )
    for panel, (name, x) in zip(panels, views, strict=True):
        order = np.argsort(x)
        for sign in (-1, 1):
            panel.plot(x[order], sign * bound[order], color=plots.GREY, linewidth=1.2)
        panel.plot(x, rest.rest, ".", color=plots.BLUE, markersize=2.5)
        plots.label(panel, name, "")
    title = "" if found.fit else "no fit by least squares"
    rest_of = f"rest of least squares ({system.input_unit}), ±δ grey"
    plots.label(panels[0], views[0][0], rest_of, title)
    return plots.png(canvas)
