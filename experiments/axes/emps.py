"""A real axis: the record of EMPS, an electro-mechanical positioning system, and what it proves.

The record is that of A. Janot, M. Gautier and M. Brunot, "Data Set and Reference Models of EMPS",
Workshop on Nonlinear System Identification Benchmarks, 2019. It is not part of this project: fetch
`DATA_EMPS.mat` from there. Four laps of a carriage, 1 ms, an encoder of 50 nm; `vir` is in volts,
the force is gtau·vir.

How large δ is nobody knows. The rule, made before laps 3 and 4 were looked at: 1.25 times the
smallest one that explains laps 1 and 2 row by row. Laps 3 and 4 may then falsify it.
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
from jaxid.io.plots import text_table
from jaxid.io.recorded import Columns, Recorded
from jaxid.io.segments import steady_segments
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
KNOTS = 1000  # of a lap: twice as many tighten the bounds of friction by 1 to 3 %, M and offset not
_CUTOFF, _ORDER, _EDGE = 100.0, 4, 100  # Hz, of the low-pass; rows that it spoils at both ends
# of the carriage in the record, and the voltage of its drive
POSITION, VELOCITY = (-0.005, 0.2464), (-0.1247, 0.1247)
JERK, KNOT_PERIOD, INTERVALS = (-100.0, 100.0), 0.04, 156  # as long as a lap
COLUMNS = (
    "model", "rows", "delta_N", "parameter", "theta_hat", "bound", "lower", "upper", "published",
    "inside",
)  # fmt: skip
MOTIONS = ("motion", "parameter", "predicted", "lower_bound", "gap")


@dataclass(frozen=True)
class Emps(Toys):
    """What the record of EMPS proves, and what a designed motion would.

    Attributes:
        data: DATA_EMPS.mat.
        out: the folder of emps.csv, emps_motions.csv, emps.png and the designed motion.
        seed: of the search.
        redraw: use the motion in `out` instead of searching.
        toy: parts of the first laps, hardly searched: only shows that everything runs.
    """

    data: Path
    out: Path = Path("figures")
    seed: int = 0
    redraw: bool = False
    toy: bool = False


class Result(NamedTuple):
    """Of one model.

    Attributes:
        model: its name.
        smallest: δ that explains laps 1 and 2, N.
        system: with the δ that the rule makes of it.
        later: what laps 3 and 4 need of that δ, as a factor; above 1 they falsify it.
        laps: what each proves.
        together: what all prove.
    """

    model: str
    smallest: float
    system: System
    later: float
    laps: list[Estimate]
    together: Estimate


def main(options: Emps) -> None:
    """Fit, choose δ, identify lap by lap, design; save, draw, print."""
    recorded = read(options.data)
    fit = recipe(recorded)
    print(
        "Least squares by the benchmark's recipe, and how far from the published values:",
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
    """The record, its input as a force."""
    return read_log(path, Columns("qm", "vir", "t", input_unit=gain(path)))


def gain(path: Path) -> float:
    """Of the drive, N/V."""
    return float(loadmat(path)["gtau"].item())


def recipe(recorded: Recorded) -> dict[str, float]:
    """Plain least squares: zero-phase low-pass, central differences, sign of the velocity."""
    low_pass = butter(_ORDER, _CUTOFF, fs=1 / PERIOD)
    y = filtfilt(*low_pass, recorded.position)
    v = np.gradient(y, PERIOD)
    columns = np.stack([np.gradient(v, PERIOD), v, np.sign(v), np.ones_like(v)], axis=1)
    inner = np.s_[_EDGE:-_EDGE]
    theta = np.linalg.lstsq(columns[inner], recorded.input[inner], rcond=None)[0]
    return dict(zip(PUBLISHED, theta.tolist(), strict=True))


def laps_of(recorded: Recorded, rows: int) -> list[Log]:
    """The first rows of each lap; the last one is a little shorter."""
    found = []
    for k in range(LAPS):
        part = np.s_[k * LAP : k * LAP + rows]
        assert recorded.time is not None  # EMPS has stamps
        own = Recorded(recorded.time[part], recorded.position[part], recorded.input[part])
        (piece,) = steady_segments(own, PERIOD, RESOLUTION)
        found.append(piece.log)
    return found


def system(delta: float, friction: Regressor = Sign()) -> System:
    """The model of the benchmark."""
    regressors = (None, Viscous(), friction, Constant())
    units = ("kg", "N s/m", "N", "N")
    terms = zip(BOX, units, BOX.values(), regressors, strict=True)
    return System(tuple(Term(*term) for term in terms), ConstantBound(delta), "N")


def by_direction(delta: float) -> System:
    """Friction of its own forwards and backwards. An offset would be half of their difference."""
    ways = ((name, forward) for name in ("Fv", "Fc") for forward in (True, False))
    parts = {"Fv": ("N s/m", Viscous()), "Fc": ("N", Sign())}
    terms = [
        Term(f"{name}{'+' if forward else '-'}", unit, BOX[name], OneWay(regressor, forward))
        for name, forward in ways
        for unit, regressor in (parts[name],)
    ]
    return System((Term("M", "kg", BOX["M"]), *terms), ConstantBound(delta), "N")


def studied(name: str, model: Callable[[float], System], laps: Sequence[Log]) -> Result:
    """By the rule.

    Args:
        name: of the model.
        model: for a δ.
        laps: of the record.
    """
    smallest = smallest_disturbance_factor(model(1.0), laps[:2])
    chosen = model(MARGIN * smallest)
    later = smallest_disturbance_factor(chosen, laps[2:])
    alone = [guaranteed_intervals(chosen, [log], KNOTS).estimate for log in laps]
    together = guaranteed_intervals(chosen, laps, KNOTS).estimate
    return Result(name, smallest, chosen, later, alone, together)


def rows_of(result: Result) -> Iterator[dict[str, Cell]]:
    """For the table."""
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
    """What was found, in sentences."""
    for result in results:
        common = jnp.min(jnp.stack([e.upper for e in result.laps]), axis=0) - jnp.max(
            jnp.stack([e.lower for e in result.laps]), axis=0
        )
        yield (
            f"{result.model}: laps 1 and 2 need a δ of {result.smallest:.3g} N, so "
            f"{MARGIN * result.smallest:.3g} N are counted with; laps 3 and 4 need "
            f"{result.later:.3f} of that and {'falsify it' if result.later > 1 else 'agree'}. The "
            f"intervals of all laps have {'something' if jnp.all(common >= 0) else 'NOTHING'} in "
            "common."
        )
    one, two = (result.smallest for result in results)
    theta = dict(zip(results[1].system.names, results[1].together.theta.tolist(), strict=True))
    dry, viscous = (theta[f"{name}+"] - theta[f"{name}-"] for name in ("Fc", "Fv"))
    yield (
        f"Friction by direction lowers the smallest δ by {1 - two / one:.0%}. What was an offset "
        f"is then half of the difference of both directions, by θ̂ {dry / 2:.3g} N near rest and "
        f"{(dry + viscous * VELOCITY[1]) / 2:.3g} N at full speed."
    )


def compared(options: Emps, result: Result) -> Iterator[dict[str, Cell]]:
    """Guaranteed errors of a lap of the record and of a designed motion as long."""
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
    """For all parameters; a sign has no slope to search by, an arctangent as steep has."""
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
