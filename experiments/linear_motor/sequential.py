"""Identify, shrink the box, design again: three rounds on the simulated motor, sequential.csv."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Float
from tqdm import tqdm

from experiments.linear_motor.certificates import KNOTS
from experiments.linear_motor.designs import HORIZON, TOY, one_motion
from experiments.linear_motor.figures import SYMBOLS
from jaxid import linear_motor as motor
from jaxid import report
from jaxid.control import ARC
from jaxid.design import Effort
from jaxid.experiment import log_of, run
from jaxid.feasible_set import FeasibleSet, feasible_set
from jaxid.files import Cell, write_table
from jaxid.floor import floor
from jaxid.guarantee import Guarantee, identify_log
from jaxid.limits import Limits, acceleration_limit
from jaxid.problem import Task
from jaxid.report import text_table
from jaxid.runtime import configure
from jaxid.sensing import Encoder
from jaxid.system import System
from jaxid.trajectory import JerkTrajectory

JERKS = (1000.0, 3000.0)  # m/s³; with the second more acceleration can be used
ROUNDS = 3
COLUMNS = (
    "jerk_m_s3", "round", "parameter", "acceleration_m_s2", "theta_true", "bound",
    "lower", "upper", "possible_lower", "possible_upper", "floor",
)  # fmt: skip


@dataclass(frozen=True)
class Sequential:
    """Three experiments, each designed for the box that the one before has left.

    Attributes:
        out: the folder that sequential.csv and sequential.png are written to.
        seed: of the searches.
        toy: one jerk limit, two rounds, hardly searched: only shows that everything runs.
    """

    out: Path = Path("figures")
    seed: int = 0
    toy: bool = False


class Round(NamedTuple):
    """One experiment.

    Attributes:
        system: with the box before it.
        limits: that this box allows.
        least: the floor of both.
        found: from the log.
        left: all that the log leaves possible: the box of the next round.
    """

    system: System
    limits: Limits
    least: Float[np.ndarray, " m"]
    found: Guarantee
    left: FeasibleSet


def main(options: Sequential) -> None:
    """Design, run, identify, shrink; save and draw."""
    jerks, rounds = (JERKS[:1], 2) if options.toy else (JERKS, ROUNDS)
    rows: list[dict[str, Cell]] = []
    with tqdm(total=len(jerks) * rounds, desc="rounds") as progress:
        for jerk in jerks:
            for number, done in enumerate(experiments(options, jerk, rounds), start=1):
                rows += rows_of(jerk, number, done)
                progress.update()
    prefix = "toy_" if options.toy else ""
    write_table(options.out / f"{prefix}sequential.csv", COLUMNS, rows)
    draw(options.out / f"{prefix}sequential.png", rows)
    print(text_table(COLUMNS, [[row[name] for name in COLUMNS] for row in rows]))


def experiments(options: Sequential, jerk: float, rounds: int) -> Iterator[Round]:
    """One after the other, on the same axis."""
    system = motor.system()
    for number in range(rounds):
        limits = allowed(system, jerk)
        least = np.asarray(floor(system, limits).value)
        key = jax.random.fold_in(jax.random.key(options.seed), number)
        motion = designed(system, limits, key, options.toy)
        found = measured(system, motion)
        left = feasible_set(found.logged, [found.estimate], KNOTS)
        yield Round(system, limits, least, found, left)
        ends = [jnp.stack(pair) for pair in zip(left.lower, left.upper, strict=True)]
        system = eqx.tree_at(lambda s: [term.interval for term in s.terms], system, ends)


def allowed(system: System, jerk: float) -> Limits:
    """(18) with the box as it is now: the better it is known, the faster the axis may be moved."""
    usual = motor.limits()
    box = {name: tuple(getattr(usual, name).tolist()) for name in ("position", "velocity", "input")}
    return Limits(acceleration=acceleration_limit(system, **box), jerk=(-jerk, jerk), **box)


def designed(system: System, limits: Limits, key: jax.Array, toy: bool) -> JerkTrajectory:
    """For the guaranteed errors of all parameters."""
    task = Task(limits, motor.boundary(), 2 * HORIZON, motor.KNOT_PERIOD)
    return one_motion(system, task, key, TOY if toy else Effort())


def measured(system: System, motion: JerkTrajectory) -> Guarantee:
    """The motor's log of it, tracked by a law that knows the box as it is now."""
    encoder, period = Encoder(motor.ENCODER_RESOLUTION), motor.CONTROL_PERIOD
    law = ARC(system, **motor.ARC_GAINS)
    _, signals = run(motor.plant(), law, encoder, motion, period)
    return identify_log(system, log_of(signals, encoder, period))


def rows_of(jerk: float, number: int, done: Round) -> list[dict[str, Cell]]:
    """For the table."""
    found, left = done.found.estimate, done.left
    return [
        {
            "jerk_m_s3": jerk,
            "round": number,
            "parameter": name,
            "acceleration_m_s2": float(done.limits.acceleration[1]),
            "theta_true": motor.TRUE_PARAMETERS[k],
            "bound": float(found.bound[k]),
            "lower": float(found.lower[k]),
            "upper": float(found.upper[k]),
            "possible_lower": float(left.lower[k]),
            "possible_upper": float(left.upper[k]),
            "floor": float(done.least[k]),
        }
        for k, name in enumerate(done.system.names)
    ]


def draw(path: Path, rows: Sequence[dict[str, Cell]]) -> None:
    """Intervals by round: guaranteed before the data, and left by them."""
    names = motor.system().names
    canvas, panels = report.figure(1, len(names), (11.0, 4.4))
    jerks = list(dict.fromkeys(float(row["jerk_m_s3"] or 0) for row in rows))
    for panel, name in zip(panels, names, strict=True):
        for jerk, colour, side in zip(jerks, report.CYCLE, (-0.12, 0.12), strict=False):
            own = [r for r in rows if r["parameter"] == name and r["jerk_m_s3"] == jerk]
            x = np.array([float(r["round"] or 0) for r in own]) + side
            for first, last, width, alpha in (
                ("lower", "upper", 9, 0.3),
                ("possible_lower", "possible_upper", 5, 1.0),
            ):
                low, high = ([float(r[end] or 0) for r in own] for end in (first, last))
                text = (
                    f"{'left by' if alpha == 1.0 else 'guaranteed before'} the data, {jerk:g} m/s³"
                )
                panel.vlines(x, low, high, color=colour, linewidth=width, alpha=alpha, label=text)
            panel.axhline(float(own[0]["theta_true"] or 0), color=report.BLACK, linewidth=1.0)
        panel.set_xticks(range(1, 1 + max(int(r["round"] or 0) for r in rows)))
        report.label(panel, "round", "", f"{SYMBOLS[name]} ({_unit(name)})")
    handles, labels = panels[0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=11)
    report.save(canvas, path)


def _unit(name: str) -> str:
    system = motor.system()
    return system.units[system.index(name)]


if __name__ == "__main__":
    configure()
    main(tyro.cli(Sequential))
