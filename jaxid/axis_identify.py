"""From a recorded log of an axis of a file to intervals, and to whether the log belongs to it."""

from collections.abc import Callable, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid import report
from jaxid.axis_file import Axis
from jaxid.brackets import brackets
from jaxid.checks import require
from jaxid.feasible_set import FeasibleSet, blind, feasible_set, louder, smallest_factor
from jaxid.files import UNITS, write_json
from jaxid.guarantee import Guarantee, assumptions, identify_logs
from jaxid.joint import joined
from jaxid.limits import Limits
from jaxid.log_file import Recorded
from jaxid.log_rows import Logged, hats
from jaxid.modulating import pieces as runs_of
from jaxid.quantities import Scalar
from jaxid.steady import Piece, rows_used, steady
from jaxid.system import System

FILES = ("result.json", "residuals.png")
_KNOTS = 3000  # of all pieces together: a linear program of seconds
_ABSURD = 20.0  # times a limit's half-width, which no stop, amplifier or clock would let pass
_MEANS = 2000  # of rows, for least squares and for the picture


class Identified(NamedTuple):
    """What a log says of an axis.

    Attributes:
        axis: of the file.
        recorded: the log.
        pieces: of it, which were used.
        factor: the smallest of δ that explains it; above 1 it contradicts the axis.
        guarantee: unless it does.
        left: unless it does; all that it leaves possible.
        unseen: parameters whose interval may remain whole whatever the data, and with which
            combination of others each can be exchanged.
        misfit: of least squares.
    """

    axis: Axis
    recorded: Recorded
    pieces: tuple[Piece, ...]
    factor: float
    guarantee: Guarantee | None
    left: FeasibleSet | None
    unseen: dict[str, Float[np.ndarray, " m"]]
    misfit: "Misfit"


class Misfit(NamedTuple):
    """What least squares leaves of the input, as means over some ticks each.

    Attributes:
        theta: its estimate, shape (m,); no bound goes with it.
        time: s, since the first row, shape (k,) as the others.
        position: m or rad.
        velocity: m/s or rad/s.
        rest: of the input, in its unit.
    """

    theta: Float[np.ndarray, " m"]
    time: Float[np.ndarray, " k"]
    position: Float[np.ndarray, " k"]
    velocity: Float[np.ndarray, " k"]
    rest: Float[np.ndarray, " k"]


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
    found = steady(recorded, axis.servo.period, axis.servo.resolution, axis.delay)
    logs, system = [piece.log for piece in found], axis.system
    knots = max(_KNOTS // len(logs), 2)

    def rows(factor: Scalar) -> Logged:
        other = louder(system, factor)
        return joined([hats(other, log, brackets(other, log)) for log in logs])

    tell("smallest δ that explains the log")
    factor = smallest_factor(rows, knots)
    explained = system if factor <= 1 else louder(system, 1.01 * factor)
    logged = joined([hats(explained, log, brackets(explained, log)) for log in logs])
    tell("what the motion cannot tell apart")
    unseen = blind(logged, knots)
    misfit = _misfit(logged, found)
    told = partial(Identified, axis, recorded, found, factor, unseen=unseen, misfit=misfit)
    if factor > 1:
        return told(guarantee=None, left=None)
    tell("intervals")
    guarantee = identify_logs(system, logs, knots)
    tell("all that is possible")
    left = feasible_set(guarantee.logged, [guarantee.estimate], knots)
    return told(guarantee=guarantee, left=left)


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


def _misfit(logged: Logged, found: Sequence[Piece]) -> Misfit:
    """Least squares of means over as many rows as make their noise small.

    Pieces of fewer rows than a mean takes count nothing.
    """
    rows, record = logged.record.rows, logged.record
    phi, u = np.asarray(rows.regressors), np.asarray(record.input)
    runs = runs_of(rows.measure)
    width = max(sum(stop - start for start, stop in runs) // _MEANS, 5)
    starts = [k for start, stop in runs for k in range(start, stop - width + 1, width)]
    require(len(starts) > phi.shape[1], "Argument `recorded` has too few rows on end to fit.")
    regressors, inputs = (
        np.stack([x[k : k + width].mean(axis=0) for k in starts]) for x in (phi, u)
    )
    theta = np.linalg.lstsq(regressors, inputs, rcond=None)[0]
    times, positions, velocities = _states(runs, found, width)
    return Misfit(theta, times, positions, velocities, inputs - regressors @ theta)


def _states(
    runs: Sequence[tuple[int, int]], found: Sequence[Piece], width: int
) -> tuple[Float[np.ndarray, " k"], ...]:
    """Time, position and velocity in the middle of each mean."""
    columns: list[list[np.ndarray]] = [[], [], []]
    for (start, stop), piece in zip(runs, found, strict=True):
        h, y = float(piece.log.period), np.asarray(piece.log.position)
        at = np.arange(0, stop - start - width + 1, width)  # its rows are the samples from 1 on
        columns[0].append((piece.first + at + width / 2) * h)
        columns[1].append((y[at] + y[at + width + 1]) / 2)
        columns[2].append((y[at + width + 1] - y[at]) / ((width + 1) * h))
    time, position, velocity = (np.concatenate(c) for c in columns)
    return time, position, velocity


def write_identified(folder: Path, found: Identified) -> None:
    """Write `FILES`."""
    write_json(folder / FILES[0], summary(found))
    page(folder / FILES[1], found)


def summary(found: Identified) -> dict[str, Any]:
    """For other programs: intervals, or how large δ would have to be, and what all rests on."""
    axis, system = found.axis, found.axis.system
    logs = [piece.log for piece in found.pieces]
    return {
        "program": f"jaxid {version('jaxid')}",
        "consistent": found.factor <= 1,
        "smallest_factor_of_disturbance_bound": found.factor,
        "parameters": {name: _parameter(found, k) for k, name in enumerate(system.names)},
        "not_told_apart": {
            name: dict(zip(system.names, combination.tolist(), strict=True))
            for name, combination in found.unseen.items()
        },
        "rows": found.recorded.position.size,
        "rows_used": rows_used(found.pieces),
        "pieces": [
            {
                "first_row": piece.first + 1,
                "last_row": piece.last + 1,
                "period_s": float(piece.log.period),
                "jitter_s": float(piece.log.jitter),
            }
            for piece in found.pieces
        ],
        "rests_on": list(assumptions(system, *logs, delay=axis.delay)),
    }


def _parameter(found: Identified, k: int) -> dict[str, Any]:
    system = found.axis.system
    known: dict[str, Any] = {
        "unit": system.units[k],
        "prior": [float(system.lower[k]), float(system.upper[k])],
        "least_squares": float(found.misfit.theta[k]),
    }
    if found.guarantee is None or found.left is None:
        return known
    estimate = found.guarantee.estimate
    return known | {
        "theta_hat": float(estimate.theta[k]),
        "bound": float(estimate.bound[k]),
        "guaranteed": [float(estimate.lower[k]), float(estimate.upper[k])],
        "possible": [float(found.left.lower[k]), float(found.left.upper[k])],
    }


def page(path: Path, found: Identified) -> None:
    """What least squares leaves of the input by time, position and velocity, beside ±δ."""
    misfit, system = found.misfit, found.axis.system
    unit = UNITS[system.coordinate]
    canvas, panels = report.figure(1, 3, (12.0, 4.2))
    bound = np.asarray(
        system.disturbance_bound(jnp.asarray(misfit.position), jnp.asarray(misfit.velocity))
    )
    views: tuple[tuple[str, Array | np.ndarray], ...] = (
        ("time (s)", misfit.time),
        (f"velocity ({unit}/s)", misfit.velocity),
        (f"position ({unit})", misfit.position),
    )
    for panel, (name, x) in zip(panels, views, strict=True):
        order = np.argsort(x)
        for sign in (-1, 1):
            panel.plot(x[order], sign * bound[order], color=report.GREY, linewidth=1.2)
        panel.plot(x, misfit.rest, ".", color=report.BLUE, markersize=2.5)
        report.label(panel, name, "")
    report.label(panels[0], "time (s)", f"rest of least squares ({system.input_unit}), ±δ grey")
    report.save(canvas, path)
