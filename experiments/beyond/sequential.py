"""Identify, narrow the prior box, design again: three rounds on the simulated motor.

The results are sequential.csv and sequential.png. A smaller box allows more acceleration by (18),
and with more acceleration a log narrows M further. For the other parameters, by the lower bound, no
log can promise much more than the first one does. The feasible parameter set still shrinks with
every log whose data happen to be favourable.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Array, Float
from tqdm import tqdm

from experiments._support.toys import Toys
from experiments.axes import linear_motor as motor
from experiments.paper.designs import HORIZON, TOY, one_motion
from experiments.paper.figures import SYMBOLS
from jaxid.design.optimal_motion import optimal_motion
from jaxid.identification.assumptions import assumptions
from jaxid.identification.feasible_parameter_set import FeasibleSet, feasible_set
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.identification.modulating_functions import KNOTS
from jaxid.io import plots
from jaxid.io.files import Cell, read_trajectory, write_table, write_trajectory
from jaxid.io.text_tables import text_table
from jaxid.loop.closed_loop import run
from jaxid.loop.controllers import ARC
from jaxid.loop.log import Log
from jaxid.model.system import System
from jaxid.motion.acceleration_limit import acceleration_limit
from jaxid.motion.limits import Limits
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.estimate import Estimate
from jaxid.regression.lower_bound import lower_bound
from jaxid.runtime import configure
from jaxid.search.effort import Effort

JERKS = (1000.0, 3000.0)  # m/s³; with the second, motions can use more acceleration
# N_i of each round: with a jerk of 1000 m/s³, a second motion of 0.6 s would narrow M no further
# than the data of the first happen to. `alone_first_limits` shows the effect of the duration alone.
HORIZONS = (HORIZON, 2 * HORIZON, 2 * HORIZON)
# a parameter can improve if its lower bound is below this share of its last predicted error
_WORTH = 0.98
_NEAR = 1.02  # target of a motion for all parameters, relative to the best for one alone
COLUMNS = (
    "jerk_m_s3", "round", "N", "parameter", "acceleration_m_s2", "theta_true", "alone",
    "alone_first_limits", "lower_bound", "bound", "lower", "upper",
    "feasible_lower", "feasible_upper",
)  # fmt: skip


@dataclass(frozen=True)
class Sequential(Toys):
    """Three experiments in sequence; each narrows the prior box and so widens the next limits.

    Attributes:
        out: folder for sequential.csv, sequential.png and the motions of all rounds.
        seed: seed of the searches.
        redraw: use the motions in `out` instead of searching.
        toy: run one jerk limit, two rounds and fewer parameters with minimal effort, only to show
            that everything works.
    """

    out: Path = Path("figures")
    seed: int = 0
    redraw: bool = False
    toy: bool = False

    def path(self, jerk: float, number: int, first_limits: bool = False) -> Path:
        """Return the file of a round's motion, for its own limits or those of the first round."""
        return self.named(f"sequential_{jerk:g}_{number}{'_first' * first_limits}.csv")


class Round(NamedTuple):
    """One experiment and its results.

    Attributes:
        log: log of the experiment.
        motion: motion that was run.
        limits: limits that the prior box of this round allows.
        least: lower bound on the half-widths that any motion within these limits can promise.
        alone: estimate with guaranteed intervals from this log alone.
        alone_first_limits: the same from the log of a motion as long as this one, within the limits
            of the first round, if there is one.
        found: estimate with guaranteed intervals from all logs so far.
        left: feasible parameter set of all logs so far, the prior box of the next round.
    """

    log: Log
    motion: JerkTrajectory
    limits: Limits
    least: Float[Array, " m"]
    alone: Estimate
    alone_first_limits: Estimate | None
    found: Estimate
    left: FeasibleSet


def main(options: Sequential) -> None:
    """Run all rounds, and write, draw and print the results."""
    jerks, horizons = (JERKS[:1], HORIZONS[:2]) if options.toy else (JERKS, HORIZONS)
    rows: list[dict[str, Cell]] = []
    logs: list[Log] = []
    with tqdm(total=len(jerks) * len(horizons), desc="rounds") as progress:
        for jerk in jerks:
            for number, done in enumerate(experiments(options, jerk, horizons), start=1):
                rows += rows_of(jerk, number, done)
                logs.append(done.log)
                progress.update()
    write_table(options.named("sequential.csv"), COLUMNS, rows)
    draw(options.named("sequential.png"), rows)
    print(text_table(COLUMNS, [[row[name] for name in COLUMNS] for row in rows]))
    print("These intervals hold provided that:", *assumptions(motor.system(), *logs), sep="\n  ")


def experiments(options: Sequential, jerk: float, horizons: Sequence[int]) -> Iterator[Round]:
    """Yield experiments on one axis, each designed with the box that those before it left.

    All guaranteed intervals assume the first box only. A later, smaller box permits higher
    accelerations and is what the controller knows.
    """
    first = known = motor.system()
    done: list[Round] = []
    for number, horizon in enumerate(horizons, start=1):
        limits = allowed(known, jerk)
        least = lower_bound(first, limits).value
        motion = chosen(options, options.path(jerk, number), limits, horizon, done)
        log = measured(known, motion)
        logs = [*(before.log for before in done), log]
        together = guaranteed_intervals(first, logs)
        left = feasible_set(together.rows, [together.estimate], KNOTS)
        alone = guaranteed_intervals(first, [log]).estimate
        control = None
        if done and horizon > done[-1].motion.jerk.size // 2:  # the effect of the duration alone
            path = options.path(jerk, number, first_limits=True)
            usual = chosen(options, path, allowed(first, jerk), horizon, done)
            control = guaranteed_intervals(first, [measured(known, usual)]).estimate
        found = together.estimate
        done.append(Round(log, motion, limits, least, alone, control, found, left))
        yield done[-1]
        known = first.with_box(left.lower, left.upper)


def chosen(
    options: Sequential, path: Path, limits: Limits, horizon: int, done: Sequence[Round]
) -> JerkTrajectory:
    """Return the motion of a round, and keep it in a file."""
    if not options.redraw:
        task = Task(limits, motor.boundary(), 2 * horizon, motor.KNOT_PERIOD)
        write_trajectory(path, designed(options, task, done))
    return read_trajectory(path)


def allowed(system: System, jerk: float) -> Limits:
    """Return the limits with (18) for the current box: a smaller box permits more acceleration."""
    usual = motor.limits()
    box = {name: tuple(getattr(usual, name).tolist()) for name in ("position", "velocity", "input")}
    return Limits(acceleration=acceleration_limit(system, **box), jerk=(-jerk, jerk), **box)


def designed(options: Sequential, task: Task, done: Sequence[Round]) -> JerkTrajectory:
    """Return the motion of the next round, designed for the predicted half-widths of its own log.

    Parameters that can improve, by their lower bound, get smaller targets; the targets of the
    others are their predicted errors of the round before.
    """
    effort = TOY if options.toy else Effort()
    key = jax.random.fold_in(jax.random.key(options.seed), len(done))
    if not done:
        return one_motion(task, key, effort)
    before, least = done[-1].motion, lower_bound(motor.system(), task.limits).value
    # the motion before, designed for other limits, is one of the starts and may be kept
    starts = [key, before] if before.jerk.size == task.intervals else [key]
    proved = targets = expected(before)
    improvable = np.flatnonzero(least < _WORTH * proved)
    for k in improvable[:1] if options.toy else improvable:
        only = jnp.full(len(proved), jnp.inf).at[k].set(proved[k])
        reached, _ = best(task, only, starts, effort)
        targets = targets.at[k].set(jnp.minimum(_NEAR * reached[k], proved[k]))
    return best(task, targets, starts, effort)[1]


def best(
    task: Task,
    targets: Float[Array, " m"],
    starts: Sequence[jax.Array | JerkTrajectory],
    effort: Effort,
) -> tuple[Float[Array, " m"], JerkTrajectory]:
    """Return the predicted errors and the motion of the best design from several starts.

    Designs are compared by the error that they are designed for, so that a start which is a motion
    is never made worse.
    """
    criterion, found = motor.predicted_error(targets), []
    for k, start in enumerate(starts):
        motion = optimal_motion(task, criterion, start, effort=effort).trajectory
        bound = expected(motion)
        found.append((float(jnp.max(bound / targets)), k, bound, motion))
    return min(found)[2:]


def expected(motion: JerkTrajectory) -> Float[Array, " m"]:
    """Return the predicted errors, with allowance for the servo's velocity error where δ jumps."""
    task = Task(motor.limits(), motor.boundary(), motion.jerk.size, motor.KNOT_PERIOD)
    near = motor.predicted_error(motor.system().half_widths).near(task, motion)
    return near.errors(motion, jnp.zeros(()))


def measured(system: System, motion: JerkTrajectory) -> Log:
    """Return the motor's log of a motion, with a controller that knows the current box."""
    return run(motor.plant(), ARC(system, **motor.ARC_GAINS), motor.servo(), motion).log


def rows_of(jerk: float, number: int, done: Round) -> list[dict[str, Cell]]:
    """Return the table rows of one round, one per parameter."""
    found, left, control = done.found, done.left, done.alone_first_limits
    return [
        {
            "jerk_m_s3": jerk,
            "round": number,
            "N": done.motion.jerk.size // 2,
            "parameter": name,
            "acceleration_m_s2": float(done.limits.acceleration[1]),
            "theta_true": motor.TRUE_PARAMETERS[k],
            "alone": float(done.alone.bound[k]),
            "alone_first_limits": None if control is None else float(control.bound[k]),
            "lower_bound": float(done.least[k]),
            "bound": float(found.bound[k]),
            "lower": float((found.theta - found.bound)[k]),
            "upper": float((found.theta + found.bound)[k]),
            "feasible_lower": float(left.lower[k]),
            "feasible_upper": float(left.upper[k]),
        }
        for k, name in enumerate(motor.system().names)
    ]


def draw(path: Path, rows: Sequence[dict[str, Cell]]) -> None:
    """Draw the intervals from all logs so far, by round."""
    names = motor.system().names
    canvas, panels = plots.figure(1, len(names), (11.0, 4.4))
    jerks = list(dict.fromkeys(float(row["jerk_m_s3"] or 0) for row in rows))
    for panel, name in zip(panels, names, strict=True):
        for jerk, colour, side in zip(jerks, plots.CYCLE, (-0.12, 0.12), strict=False):
            own = [r for r in rows if r["parameter"] == name and r["jerk_m_s3"] == jerk]
            x = np.array([float(r["round"] or 0) for r in own]) + side
            for first, last, width, alpha, what in (
                ("lower", "upper", 9, 0.3, "θ̂ ± bound"),
                ("feasible_lower", "feasible_upper", 5, 1.0, "feasible set"),
            ):
                # the intervals of all rounds contain the true value, so their intersection does
                low = np.maximum.accumulate([float(r[first] or 0) for r in own])
                high = np.minimum.accumulate([float(r[last] or 0) for r in own])
                text = f"{what}, jerk limit {jerk:g} m/s³"
                panel.vlines(x, low, high, color=colour, linewidth=width, alpha=alpha, label=text)
        panel.axhline(
            motor.TRUE_PARAMETERS[_index(name)],
            color=plots.BLACK,
            linewidth=1.0,
            label="true value",
        )
        panel.set_xticks(range(1, 1 + max(int(r["round"] or 0) for r in rows)))
        low, high = (float(end) for end in motor.system().terms[_index(name)].interval)
        prior = f"prior {low:g} … {high:g}".replace("-", "−")
        plots.label(panel, "experiment", "", f"{SYMBOLS[name]} ({_unit(name)})\n{prior}")
    handles, labels = panels[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=11)
    canvas.suptitle("Guaranteed intervals by all experiments so far", fontsize=12)
    plots.save(canvas, path)


def _index(name: str) -> int:
    return motor.system().index(name)


def _unit(name: str) -> str:
    return motor.system().units[_index(name)]


if __name__ == "__main__":
    configure()
    main(tyro.cli(Sequential))
