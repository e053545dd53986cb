"""From a recorded log of an axis to guaranteed intervals, or to its inconsistency."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import msgspec
import numpy as np
from jaxtyping import Float

from jaxid._checks import require
from jaxid._progress import Report, silent, within
from jaxid._text import at_least, at_most, between, quantity
from jaxid.axis.file import PROGRAM, Axis
from jaxid.axis.result import Result
from jaxid.axis.summaries import IdentificationSummary, IdentifiedParameter, UsedSegment
from jaxid.axis.wording import in_words_of_files
from jaxid.identification.assumptions import assumptions
from jaxid.identification.batches import SIZES, batches
from jaxid.identification.falsification import LEAST
from jaxid.identification.identify import (
    Identification,
    InterruptedIdentification,
    identify,
)
from jaxid.identification.least_squares import LeastSquaresFit, fit_least_squares
from jaxid.identification.residuals import Residuals, residuals
from jaxid.io import plots
from jaxid.io.files import UNITS, json_bytes
from jaxid.io.recorded import Recorded
from jaxid.io.segments import Segment, rows_used, steady_segments
from jaxid.io.text_tables import text_table
from jaxid.loop.log import InconsistentLogError, Log
from jaxid.model.system import System
from jaxid.motion.limits import Limits

_SHOWN = 10  # segments that are listed
_ROOM = 1.1  # of a factor of δ that is proved to be needed: with it, state bounds are not empty
_NEAR = 0.7  # a needed share of δ above which the text asks for a check of δ
_SLIGHT, _LARGE = 3.0, 10.0  # needed factors of δ that have different likely causes
_ABSURD = 20.0  # half-widths of a limit: beyond it, a unit must be wrong


_NEAR_DELTA = (
    "This log needs most of δ. If δ is only a little too small, or the delay is wrong, these "
    "intervals may exclude the true parameters: check both (jaxid guide delta)."
)


class Identified(NamedTuple):
    """The identification of an axis from a recorded log.

    Attributes:
        axis: axis from a file.
        recorded: rows of the log file.
        pieces: segments of the log that were used.
        result: guaranteed intervals; None if the log is inconsistent with the axis.
        inconsistency: inconsistency of the log; None if there is none.
        fit: least-squares fit; None if the log does not identify all parameters separately.
        residuals: residuals at the best θ of the prior box; None if the log is too inconsistent.
        interruption: interruption by the user, after some batches of a long log; None, the default,
            if there was none. Then the other fields are those of the segments of these batches.
    """

    axis: Axis
    recorded: Recorded
    pieces: tuple[Segment, ...]
    result: Identification | None
    inconsistency: InconsistentLogError | None
    fit: LeastSquaresFit | None
    residuals: Residuals | None
    interruption: InterruptedIdentification | None = None


def identify_axis(axis: Axis, recorded: Recorded, report: Report = silent) -> Identified:
    """Identify an axis from a recorded log: guaranteed intervals, or the inconsistency of the log.

    Args:
        axis: axis from a file.
        recorded: rows of a log file, of a designed or any other motion.
        report: function that is called as each step begins, with its name and the share of the
            work that is done.

    Raises:
        ValueError: if position or input are far outside the limits of the axis, or the rows are not
            a sample period apart.
    """
    _require_plausible(recorded, axis.task.limits, axis.system)
    servo, system = axis.servo, axis.system
    found = steady_segments(
        recorded, servo.period, servo.resolution, axis.servo.delay, longest=SIZES.samples
    )
    logs = [piece.log for piece in found]
    result = inconsistency = interruption = None
    try:
        result = identify(system, logs, sizes=SIZES, report=within(report, 0.0, 0.9))
    except InconsistentLogError as error:
        inconsistency = error
    except InterruptedIdentification as error:
        result, interruption = error.found, error
        logs = [log for batch in batches(logs, SIZES)[: result.batches] for log in batch]
    report("residuals", 0.9)
    fit, shown = _fit_if_possible(system, logs), _residuals_if_possible(system, logs, inconsistency)
    used = found[: len(logs)]
    return Identified(axis, recorded, used, result, inconsistency, fit, shown, interruption)


def _residuals_if_possible(
    system: System, logs: Sequence[Log], inconsistency: InconsistentLogError | None
) -> Residuals | None:
    factor = 1.0 if inconsistency is None else inconsistency.factor or 1.0
    try:
        return residuals(system, logs, max(1.0, _ROOM * factor))
    except InconsistentLogError:
        return None


def _fit_if_possible(system: System, logs: Sequence[Log]) -> LeastSquaresFit | None:
    try:
        return fit_least_squares(system, logs)
    except ValueError:  # guaranteed intervals do not need a unique fit
        return None


def _require_plausible(recorded: Recorded, limits: Limits, system: System) -> None:
    unit = UNITS[system.coordinate]
    for name, values, interval, entry in (
        ("position", recorded.position, limits.position, "position_unit"),
        ("input", recorded.input, limits.input, "input_unit"),
    ):
        low, high = (float(end) for end in interval)
        finite = values[np.isfinite(values)]
        require(finite.size > 0, f"Argument `recorded` has no row in which the {name} is a number.")
        beyond = float(np.max(np.abs(finite - (low + high) / 2))) / ((high - low) / 2)
        across = unit if name == "position" else system.input_unit
        require(
            beyond <= _ABSURD,
            f"Argument `recorded` has values of the {name} from {float(finite.min()):.6g} to "
            f"{float(finite.max()):.6g} {across}, {beyond:.0f} times as far as its limits "
            f"[{low:g}, {high:g}] {across}. Check `log.{entry}`.",
        )


@dataclass(frozen=True, eq=False)
class IdentifyResult(Result):
    """The result of `jaxid identify`, as files and as text.

    Attributes:
        found: identification of the axis.
        log_sha256: SHA-256 of the log file.
    """

    found: Identified
    log_sha256: str
    name: ClassVar[str] = "identify"
    names: ClassVar[tuple[str, ...]] = ("result.json", "residuals.png")

    @property
    def axis(self) -> Axis:
        """The axis that was identified."""
        return self.found.axis

    @property
    def sources(self) -> dict[str, str]:
        """The SHA-256 of the axis file and of the log file."""
        return super().sources | {"log": self.log_sha256}

    def summary(self) -> IdentificationSummary:
        """Return the content of `result.json`."""
        return summary(self.found)

    def files(self) -> Mapping[str, bytes]:
        """Return the content of `result.json` and `residuals.png`, by name."""
        return {"result.json": json_bytes(self.summary()), "residuals.png": page(self.found)}

    def text(self) -> str:
        """Return the result as text: intervals or the inconsistency, and the assumptions."""
        return text(self.found)


def summary(found: Identified) -> IdentificationSummary:
    """Return the content of `result.json`: intervals or the inconsistency, and the assumptions."""
    axis, system, result = found.axis, found.axis.system, found.result
    logs = [piece.log for piece in found.pieces]
    return IdentificationSummary(
        program=PROGRAM,
        consistent=result is not None,
        inconsistency=None
        if found.inconsistency is None
        else in_words_of_files(str(found.inconsistency)),
        disturbance_factor=_factor(found),
        parameters={name: _parameter(found, k) for k, name in enumerate(system.names)},
        not_identifiable={
            name: dict(zip(system.names, combination.tolist(), strict=True))
            for name, combination in ({} if result is None else result.unidentifiable).items()
        },
        rows=found.recorded.position.size,
        rows_used=rows_used(found.pieces),
        batches=None if result is None else result.batches,
        interrupted=found.interruption is not None,
        samples_per_weight=None if result is None else result.samples_per_weight,
        segments=tuple(
            UsedSegment(
                first_row=piece.first + 1,
                last_row=piece.last + 1,
                period_s=float(piece.log.period),
                jitter_s=float(piece.log.jitter),
            )
            for piece in found.pieces
        ),
        assumptions=assumptions(system, *logs, delay=axis.servo.delay),
    )


def _factor(found: Identified) -> float | None:
    """Return a proved lower bound on the factor of δ that the log needs; None without a proof."""
    if found.result is None:
        return None if found.inconsistency is None else found.inconsistency.factor
    return found.result.disturbance_factor if found.result.disturbance_factor > LEAST else None


def _parameter(found: Identified, k: int) -> IdentifiedParameter:
    system = found.axis.system
    known = IdentifiedParameter(
        unit=system.units[k],
        prior=(float(system.lower[k]), float(system.upper[k])),
        least_squares_estimate=None if found.fit is None else float(found.fit.theta[k]),
    )
    result = found.result
    if result is None:
        return known
    estimate = result.estimate
    return msgspec.structs.replace(
        known,
        guaranteed=(float(result.lower[k]), float(result.upper[k])),
        theta_hat=float(estimate.theta[k]),
        bound=float(estimate.bound[k]),
    )


def text(found: Identified) -> str:
    """Return an identification as text: intervals or the inconsistency, and the assumptions."""
    return "\n".join(
        (
            _rows_used(found),
            *([] if found.result is None else _of_result(found, found.result)),
            *([] if found.inconsistency is None else [_inconsistency(found.inconsistency)]),
            "These intervals hold provided that:" if found.result else "The test assumes that:",
            *(f"  {sentence}" for sentence in summary(found).assumptions),
        )
    )


def _of_result(found: Identified, result: Identification) -> list[str]:
    return [
        *_batches(result, found.interruption),
        _intervals(found.axis.system, result),
        *([_NEAR_DELTA] if result.disturbance_factor > _NEAR else []),
        *(
            _not_identifiable(found.axis.system, name, combination)
            for name, combination in result.unidentifiable.items()
        ),
    ]


def _batches(result: Identification, interruption: InterruptedIdentification | None) -> list[str]:
    """Return a sentence about the batches of a long log, if there are several."""
    done = result.batches
    if interruption is None:
        together = f"Long log: processed in {done} batches, then in all of them together."
        return [together] if done > 1 else []
    if done < interruption.batches:
        return [
            f"Interrupted after {done} of {interruption.batches} batches: these intervals are "
            "those of the rows above. All other rows were not tested."
        ]
    return [
        f"Interrupted after all {done} batches, before they were processed together: the intervals "
        "hold, but may be wider than those of the whole command."
    ]


def _inconsistency(error: InconsistentLogError) -> str:
    factor = error.factor or 1.0
    if factor <= _SLIGHT:
        causes = (
            "δ, a missing term of the model, the prior intervals, a saturated input, `input.delay`"
        )
    elif factor <= _LARGE:
        causes = (
            "`input.delay`, `servo.resolution`, a saturated input, sign and unit of the input and "
            "of the position"
        )
    else:
        causes = (
            "sign and unit of the input, sign and unit of the position, `servo.period`, "
            "`input.delay`, swapped columns"
        )
    return (
        f"Inconsistent log: {in_words_of_files(str(error))} No intervals are reported. Check, in "
        f"this order: {causes} (jaxid guide inconsistent)."
    )


def _rows_used(found: Identified) -> str:
    rows, pieces, used = found.recorded.position.size, found.pieces, rows_used(found.pieces)
    shown = [f"{p.first + 1}–{p.last + 1}" for p in pieces]
    where = ", ".join(shown[:_SHOWN]) + (", …" if len(shown) > _SHOWN else "")
    number = f"all {rows} rows" if used == rows else f"{used} of {rows} rows"
    most = max(float(p.log.jitter) for p in pieces)
    jitter = f"jitter up to {quantity(float(at_most(most)), 's')}" if most else "no jitter found"
    return f"Used {number} ({where}); {jitter}."


def _intervals(system: System, result: Identification) -> str:
    factor = result.disturbance_factor
    # a range that is estimated from samples makes an estimate of everything that depends on it
    kind = "estimated" if system.estimated else "guaranteed"
    header = ("parameter", "unit", "prior", kind)
    pairs = ((system.lower, system.upper), (result.lower, result.upper))
    columns = [
        [between(low, high) for low, high in zip(*(end.tolist() for end in pair), strict=True)]
        for pair in pairs
    ]
    rows = list(zip(system.names, system.units, *columns, strict=True))
    lowest = f"at least {at_least(factor)}·δ" if factor > LEAST else "no lower bound was found"
    intervals = f"{kind.capitalize()} parameter intervals."
    title = f"{intervals} Disturbance needed to explain this log: {lowest}."
    return text_table(header, rows, title)


def _not_identifiable(system: System, name: str, direction: Float[np.ndarray, " m"]) -> str:
    """Return a sentence about a parameter whose prior interval the log cannot narrow."""
    parts = zip(system.names, direction.tolist(), system.units, strict=True)
    moved = [f"{other} {amount:+.3g} {unit}" for other, amount, unit in parts if amount]
    together = f"{', '.join(moved[:-1])} together with {moved[-1]}" if moved[1:] else moved[0]
    return (
        f"{name} is not identifiable from this log: from the centre of the prior box, {together} "
        "explains the log equally well, and so does the opposite change."
    )


def page(found: Identified) -> bytes:
    """Return a picture of the residual beside its bound, over time, velocity and position, as PNG.

    The bound is δ with the errors of the measurement. Of a consistent log no residual exceeds it.
    """
    system, one = found.axis.system, found.residuals
    unit = UNITS[system.coordinate]
    canvas, panels = plots.figure(1, 3, (12.0, 4.2))
    names = ("time (s)", f"velocity ({unit}/s)", f"position ({unit})")
    for panel, name in zip(panels, names, strict=True):
        plots.label(panel, name, "")
    panels[0].set_ylabel(f"residual ({system.input_unit})", fontsize=12)
    panels[1].set_ylabel("residual / its bound", fontsize=12)
    if one is None:
        panels[1].set_title("positions and inputs are too inconsistent for a residual", fontsize=12)
        return plots.png(canvas)
    _draw_residuals(panels, one)
    most = float(np.max(np.abs(one.ratio)))
    title = (
        "Residual of the best parameters in the prior box (means over "
        f"{2 * one.half_width} samples): up to {most:.2g} times its bound"
    )
    if found.result is None and most <= 1.0:
        title += "\nThe log is inconsistent all the same: the test combines samples of all times"
    canvas.suptitle(title, fontsize=12)
    return plots.png(canvas)


def _draw_residuals(panels: Sequence[plots.Axes], one: Residuals) -> None:
    beyond = np.abs(one.ratio) > 1.0
    order = np.argsort(one.time)
    panels[0].fill_between(
        one.time[order],
        -one.bound[order],
        one.bound[order],
        color=plots.GREY,
        alpha=0.25,
        linewidth=0,
        label="bound: δ + measurement error",
    )
    ratio = one.ratio
    views = ((one.time, one.residual), (one.velocity, ratio), (one.position, ratio))
    for panel, (x, y) in zip(panels, views, strict=True):
        panel.plot(x[~beyond], y[~beyond], ".", color=plots.BLUE, markersize=3)
        if beyond.any():
            panel.plot(x[beyond], y[beyond], ".", color=plots.RED, markersize=5, label="exceeds it")
    for panel in panels[1:]:
        plots.limit_lines(panel, (-1.0, 1.0))
    panels[0].legend(fontsize=10, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
