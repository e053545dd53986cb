"""Guaranteed intervals from the record of a real axis, the positioning system EMPS.

The record is that of A. Janot, M. Gautier and M. Brunot, "Data Set and Reference Models of EMPS",
Workshop on Nonlinear System Identification Benchmarks, 2019. It is not part of this project:
download `DATA_EMPS.mat` from there. It contains four laps of a carriage, with a sample period of 1
ms and an encoder of 50 nm. The input `vir` is in volts; the force is gtau·vir.

The true δ is unknown. The rule for choosing it was made before laps 3 and 4 were looked at: 1.25
times the smallest δ that explains laps 1 and 2 row by row. Laps 3 and 4 may then be inconsistent
with it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Float
from scipy.io import loadmat
from scipy.signal import butter, filtfilt
from tqdm import tqdm

from experiments._support.toys import Toys
from experiments.paper.designs import TOY
from jaxid.design.evaluation import evaluate
from jaxid.design.optimal_motion import optimal_motion
from jaxid.design.predicted_error import PredictedError
from jaxid.identification.assumptions import assumptions
from jaxid.identification.falsification import smallest_disturbance_factor
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.io import plots
from jaxid.io.files import Cell, read_trajectory, write_table, write_trajectory
from jaxid.io.log_file import read_log
from jaxid.io.recorded import Columns, Recorded
from jaxid.io.segments import steady_segments
from jaxid.io.text_tables import text_table
from jaxid.loop.log import Log
from jaxid.loop.servo import Servo
from jaxid.model.disturbance_bound import ConstantBound
from jaxid.model.regressors import Constant, Coulomb, OneWay, Regressor, Sign, Viscous
from jaxid.model.system import System, Term
from jaxid.motion.acceleration_limit import acceleration_limit
from jaxid.motion.limits import Boundary, Limits, through
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.estimate import Estimate
from jaxid.regression.lower_bound import lower_bound
from jaxid.runtime import configure
from jaxid.search.effort import Effort

PUBLISHED = {"M": 95.1089, "Fv": 203.5034, "Fc": 20.3935, "offset": -3.1648}
PERIOD, RESOLUTION, VOLTS = 0.001, 5e-8, 10.0
LAP, LAPS = 6240, 4  # rows
BOX = {"M": (50.0, 150.0), "Fv": (0.0, 500.0), "Fc": (0.0, 50.0), "offset": (-20.0, 20.0)}
MARGIN = 1.25
KNOTS = 1000  # per lap; twice as many tighten the bounds of friction by 1 to 3 %, no others
_CUTOFF, _ORDER, _EDGE = 100.0, 4, 100  # Hz and order of the low-pass; rows to drop at each end
# ranges of the carriage in the record, m and m/s
POSITION, VELOCITY = (-0.005, 0.2464), (-0.1247, 0.1247)
JERK, KNOT_PERIOD, INTERVALS = (-100.0, 100.0), 0.04, 156  # m/s³, s: as long as a lap
COLUMNS = (
    "model", "rows", "delta_N", "parameter", "theta_hat", "bound", "lower", "upper", "published",
    "inside",
)  # fmt: skip
MOTIONS = ("motion", "parameter", "predicted", "lower_bound", "gap")


@dataclass(frozen=True)
class Emps(Toys):
    """Guaranteed intervals from the record of EMPS, and predicted ones of a designed motion.

    Attributes:
        data: file DATA_EMPS.mat.
        out: folder for emps.csv, emps_motions.csv, emps.png and the designed motion.
        seed: seed of the search.
        redraw: use the motion in `out` instead of searching.
        toy: use the first 400 rows of each lap and search with minimal effort, only to show that
            everything works.
    """

    data: Path
    out: Path = Path("figures")
    seed: int = 0
    redraw: bool = False
    toy: bool = False


class Result(NamedTuple):
    """The results of one model.

    Attributes:
        model: name of the model.
        smallest: smallest δ that explains laps 1 and 2, N.
        system: model with the δ that the rule gives.
        later: factor of this δ that laps 3 and 4 need; above 1 they are inconsistent with it.
        laps: estimates with guaranteed intervals from each lap alone.
        together: estimate with guaranteed intervals from all laps together.
    """

    model: str
    smallest: float
    system: System
    later: float
    laps: list[Estimate]
    together: Estimate


def main(options: Emps) -> None:
    """Fit the record, choose δ, identify lap by lap, design a motion, and write the results."""
    recorded = read(options.data)
    fit = recipe(recorded)
    print(
        "Least-squares estimates by the benchmark's method (deviation from the published values):",
        *(f"{name} {x:.6g} ({x / PUBLISHED[name] - 1:+.2%})" for name, x in fit.items()),
        sep="\n  ",
    )
    laps = laps_of(recorded, 400 if options.toy else LAP)
    models = {"one friction": system, "friction by direction": by_direction}
    results = [studied(name, model, laps) for name, model in tqdm(models.items(), "models")]
    rows = [row for result in results for row in rows_of(result)]
    write_table(options.named("emps.csv"), COLUMNS, rows)
    print(text_table(COLUMNS, [[row[c] for c in COLUMNS] for row in rows]))
    print(*said(results), sep="\n")
    motions = list(compared(options, results[0]))
    write_table(options.named("emps_motions.csv"), MOTIONS, motions)
    print(text_table(MOTIONS, [[row[c] for c in MOTIONS] for row in motions]))
    draw(options.named("emps.png"), results[0])
    print("These intervals hold provided that:", *assumptions(results[0].system, *laps), sep="\n  ")


def read(path: Path) -> Recorded:
    """Return the record, with its input as a force in N."""
    return read_log(path, Columns("qm", "vir", "t", input_unit=gain(path)))


def gain(path: Path) -> float:
    """Return the gain of the drive, N/V."""
    return float(loadmat(path)["gtau"].item())


def recipe(recorded: Recorded) -> dict[str, float]:
    """Return plain least-squares estimates by the method of the benchmark.

    It uses a zero-phase low-pass filter, central differences and the sign of the velocity.
    """
    low_pass = butter(_ORDER, _CUTOFF, fs=1 / PERIOD)
    y = filtfilt(*low_pass, recorded.position)
    v = np.gradient(y, PERIOD)
    columns = np.stack([np.gradient(v, PERIOD), v, np.sign(v), np.ones_like(v)], axis=1)
    inner = np.s_[_EDGE:-_EDGE]
    theta = np.linalg.lstsq(columns[inner], recorded.input[inner], rcond=None)[0]
    return dict(zip(PUBLISHED, theta.tolist(), strict=True))


def laps_of(recorded: Recorded, rows: int) -> list[Log]:
    """Return a log of the first rows of each lap; the last lap is a little shorter."""
    found = []
    for k in range(LAPS):
        part = np.s_[k * LAP : k * LAP + rows]
        assert recorded.time is not None  # the record of EMPS has time stamps
        own = Recorded(recorded.time[part], recorded.position[part], recorded.input[part])
        (piece,) = steady_segments(own, PERIOD, RESOLUTION)
        found.append(piece.log)
    return found


def system(delta: float, friction: Regressor = Sign()) -> System:
    """Return the model of the benchmark, for a disturbance bound δ in N."""
    regressors = (None, Viscous(), friction, Constant())
    units = ("kg", "N s/m", "N", "N")
    terms = zip(BOX, units, BOX.values(), regressors, strict=True)
    return System(tuple(Term(*term) for term in terms), ConstantBound(delta), "N")


def by_direction(delta: float) -> System:
    """Return the model with separate friction for each direction, for a disturbance bound δ in N.

    It has no offset, which would be half of the difference between the directions.
    """
    ways = ((name, forward) for name in ("Fv", "Fc") for forward in (True, False))
    parts = {"Fv": ("N s/m", Viscous()), "Fc": ("N", Sign())}
    terms = [
        Term(f"{name}{'+' if forward else '-'}", unit, BOX[name], OneWay(regressor, forward))
        for name, forward in ways
        for unit, regressor in (parts[name],)
    ]
    return System((Term("M", "kg", BOX["M"]), *terms), ConstantBound(delta), "N")


def studied(name: str, model: Callable[[float], System], laps: Sequence[Log]) -> Result:
    """Return the results of one model, with δ chosen by the rule.

    Args:
        name: name of the model.
        model: function that returns the model for a δ in N.
        laps: logs of the laps of the record.
    """
    smallest = smallest_disturbance_factor(model(1.0), laps[:2])
    chosen = model(MARGIN * smallest)
    later = smallest_disturbance_factor(chosen, laps[2:])
    alone = [guaranteed_intervals(chosen, [log], KNOTS).estimate for log in laps]
    together = guaranteed_intervals(chosen, laps, KNOTS).estimate
    return Result(name, smallest, chosen, later, alone, together)


def rows_of(result: Result) -> Iterator[dict[str, Cell]]:
    """Yield the table rows of one model, one per lap and parameter."""
    names = result.system.names
    parts = [*(f"lap {k}" for k in range(1, LAPS + 1)), "all laps"]
    for part, found in zip(parts, [*result.laps, result.together], strict=True):
        for k, name in enumerate(names):
            published = PUBLISHED.get(name)
            low, high = float(found.lower[k]), float(found.upper[k])
            yield {
                "model": result.model,
                "rows": part,
                "delta_N": MARGIN * result.smallest,
                "parameter": name,
                "theta_hat": float(found.theta[k]),
                "bound": float(found.bound[k]),
                "lower": low,
                "upper": high,
                "published": published,
                "inside": None if published is None else low <= published <= high,
            }


def said(results: Sequence[Result]) -> Iterator[str]:
    """Yield the results as sentences."""
    for result in results:
        common = jnp.min(jnp.stack([e.upper for e in result.laps]), axis=0) - jnp.max(
            jnp.stack([e.lower for e in result.laps]), axis=0
        )
        yield (
            f"{result.model}: laps 1 and 2 need a δ of at least {result.smallest:.3g} N, so δ is "
            f"set to {MARGIN * result.smallest:.3g} N. Laps 3 and 4 need {result.later:.3f} times "
            f"this δ and are {'inconsistent' if result.later > 1 else 'consistent'} with it. The "
            f"intervals of the laps {'overlap' if jnp.all(common >= 0) else 'do NOT overlap'}."
        )
    one, two = (result.smallest for result in results)
    theta = dict(zip(results[1].system.names, results[1].together.theta.tolist(), strict=True))
    dry, viscous = (theta[f"{name}+"] - theta[f"{name}-"] for name in ("Fc", "Fv"))
    yield (
        f"Separate friction for each direction lowers the smallest δ by {1 - two / one:.0%}. The "
        "offset is then half of the difference between the directions: by the estimates, "
        f"{dry / 2:.3g} N near rest and {(dry + viscous * VELOCITY[1]) / 2:.3g} N at full speed."
    )


def compared(options: Emps, result: Result) -> Iterator[dict[str, Cell]]:
    """Yield the errors guaranteed by a lap of the record and those predicted for a designed motion.

    Both motions have the same duration.
    """
    axis = result.system
    most = VOLTS * gain(options.data)
    box = {"position": POSITION, "velocity": VELOCITY, "input": (-most, most)}
    limits = Limits(acceleration=acceleration_limit(axis, **box), jerk=JERK, **box)
    least = lower_bound(axis, limits)
    path = options.named("emps_trajectory.csv")
    if not options.redraw:
        write_trajectory(path, designed(options, axis, limits, least.value))
    worth = evaluate(axis, read_trajectory(path), Servo(PERIOD, RESOLUTION), least)
    errors = {"lap 1 of the record": result.laps[0].bound, "designed": worth.predicted}
    for motion, error in errors.items():
        for k, name in enumerate(axis.names):
            own, lowest = float(error[k]), float(least.value[k])
            gap = own / lowest - 1
            yield dict(zip(MOTIONS, (motion, name, own, lowest, gap), strict=True))


def designed(
    options: Emps, axis: System, limits: Limits, targets: Float[jax.Array, " m"]
) -> JerkTrajectory:
    """Return a motion that is optimal for the predicted half-widths of all parameters.

    The sign function has no gradient for the search, so a steep arctangent replaces it.
    """
    delta = float(axis.disturbance_bound(jnp.zeros(()), jnp.zeros(())))
    smooth = system(delta, Coulomb(5000.0))
    ends = Boundary((0.0, 0.0, 0.0), (through((0.0, 0.0, 0.0), at=1.0),))
    task = Task(limits, ends, INTERVALS, KNOT_PERIOD)
    effort = TOY if options.toy else Effort(starts=32, rounds=0, searches=1)
    key = jax.random.key(options.seed)
    criterion = PredictedError(smooth, targets, Servo(PERIOD, RESOLUTION))
    return optimal_motion(task, criterion, key, effort=effort).trajectory


def draw(path: Path, result: Result) -> None:
    """Draw the intervals of each lap and of all laps, and the published values."""
    names = result.system.names
    canvas, panels = plots.figure(1, len(names), (11.0, 4.0))
    parts = [*(str(k) for k in range(1, LAPS + 1)), "all"]
    for k, (panel, name) in enumerate(zip(panels, names, strict=True)):
        found = [*result.laps, result.together]
        low, high = ([float(getattr(e, end)[k]) for e in found] for end in ("lower", "upper"))
        x = np.arange(len(found))
        panel.vlines(x, low, high, color=plots.BLUE, linewidth=8, label="guaranteed")
        panel.axhline(PUBLISHED[name], color=plots.RED, linewidth=1.5, label="published")
        panel.set_xticks(x, parts, fontsize=12)
        low, high = BOX[name]
        prior = f"prior {low:g} … {high:g}".replace("-", "−")
        plots.label(panel, "lap", "", f"{name} ({result.system.units[k]})\n{prior}")
    handles, labels = panels[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=11)
    delta = MARGIN * result.smallest
    title = f"EMPS record: guaranteed intervals if every unmodelled force is at most {delta:.3g} N"
    canvas.suptitle(title, fontsize=12)
    plots.save(canvas, path)


if __name__ == "__main__":
    configure()
    main(tyro.cli(Emps))
