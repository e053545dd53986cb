"""Motions whose axis keeps its limits, by simulated plants or by proof, compared with (18)."""

from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Float

from experiments._support.cases import Case, encoder
from experiments._support.settings import Setting
from experiments._support.stages import by_18
from experiments.axes import linear_motor as motor
from experiments.paper import figures, tables
from experiments.paper.designs import STUDIED, TOY
from jaxid._checks import require
from jaxid.design.criteria import LeastSquaresError
from jaxid.design.optimal_motion import optimal_motion
from jaxid.io.files import read_trajectory, write_table, write_trajectory
from jaxid.loop.closed_loop import plant_violations
from jaxid.loop.disturbances import AgainstTracking, Disturbance, NoDisturbance
from jaxid.loop.scenarios import random_scenarios
from jaxid.loop.sensors import IdealSensor
from jaxid.loop.tube import Tube, parameter_cells
from jaxid.loop.worst_case_plants import find_worst_case_plants
from jaxid.motion.limits import Limits, shrunk
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.motion.violation import Prediction
from jaxid.regression.error_of_motion import planned_error
from jaxid.runtime import configure
from jaxid.search.effort import Effort
from jaxid.search.frozen_loop import fixed_margins
from jaxid.search.local import improve
from jaxid.search.problem import Problem

CELLS = (8, 4, 4, 4)  # cells of Ω_θ along each parameter, for a proof
# initial margins for position, velocity, input and input rate in m, m/s, V and V/s, near a tube's
PROVED_MARGINS, SAMPLED_MARGINS = (0.004, 0.04, 0.45, 0.0), (0.003, 0.03, 0.2, 0.0)
ROUNDS = 4  # rounds of finding plants beyond the limits and increasing the margins
SIDES = ("position", "velocity", "input")
METHODS = ("18", "proved", "sampled")


@dataclass(frozen=True)
class Robust:
    """One motion per parameter and method to keep limits: (18), simulated plants, and a proof.

    Motions that exist already are checked and not searched again; remove their files to search
    again.

    Attributes:
        out: folder for robust.csv and the motions.
        motions: folder with the trajectories of the study.
        horizon: horizon N_i of the motions.
        plants: number of random plants of the final check.
        attacks: number of worst-case plants of the final check, each found by a search.
        seed: seed of the designs; the final check uses the next one.
        toy: run with minimal effort, only to show that everything works.
    """

    out: Path = Path("figures")
    motions: Path = Path("figures")
    horizon: int = 30
    plants: int = 1000
    attacks: int = 100
    seed: int = 0
    toy: bool = False

    @property
    def prefix(self) -> str:
        """The prefix of the file names, so that a toy run overwrites no files of a full run."""
        return "toy_" if self.toy else ""

    def case(self, name: str) -> Case:
        """Return the case of one parameter, with the controller that has a proved tube."""
        return Case(
            Setting("provable", gains="provable"), name, self.horizon, self.motions, self.toy
        )


def main(options: Robust) -> None:
    """Design the missing motions, check all, and write and print the results."""
    rows = []
    for name in STUDIED[: 1 if options.toy else None]:
        for method in METHODS:
            rows.append(checked(options, name, method, motion(options, name, method)))
            print(", ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    table = tables.Table(tables.ROBUST, rows)
    write_table(options.out / f"{options.prefix}robust.csv", table.header, table.rows)
    draw(options, STUDIED[0])
    print(table.text("Limits of the axis itself: by (18), by proof, by simulated plants"))


def draw(options: Robust, name: str) -> None:
    """Draw the tube of the proved motion, and the range of simulated corners of the box."""
    case, found = options.case(name), motion(options, name, "proved")
    after = found.states(motor.CONTROL_PERIOD * jnp.arange(1, case.ticks + 1))
    simulated = case.axis(encoder())(found)
    path = options.out / f"{options.prefix}tube.png"
    figures.tube(path, after, tube(case)(found), simulated, case.setting.limits(), name)


def motion(options: Robust, name: str, method: str) -> JerkTrajectory:
    """Return a motion from its file; if there is none, search it and write the file."""
    case = options.case(name)
    if method == "18":
        return by_18(case, {})
    path = options.out / f"{options.prefix}robust_{method}_{name}_N{options.horizon}.csv"
    if not path.exists():
        write_trajectory(path, {"sampled": sampled, "proved": proved}[method](options, case))
    return read_trajectory(path)


def proved(options: Robust, case: Case) -> JerkTrajectory:
    """Return a motion for which the tube proves that all plants keep the limits."""
    return improved(case, case.setting.limits(), tube(case), start(options, case, PROVED_MARGINS))


def tube(case: Case) -> Tube:
    """Return the proved tube of all plants."""
    loop, parts = case.loop(encoder()), (2, 1, 1, 1) if case.toy else CELLS
    law, box = case.setting.controller(), parameter_cells(case.setting.system(), parts)
    return Tube(law, encoder(), box, loop.period, loop.ticks, loop.repeats)


def start(
    options: Robust, case: Case, margins: tuple[float, float, float, float]
) -> JerkTrajectory:
    """Return a motion from random starts, with fixed margins for the deviations of the axis."""
    system = case.setting.system()
    axis = fixed_margins(system, 5 * case.intervals, margins)
    limits, boundary = case.setting.limits(), motor.boundary()
    task = Task(limits, boundary, case.intervals, motor.KNOT_PERIOD, axis)
    key = jax.random.fold_in(jax.random.key(options.seed), case.index)
    effort = TOY if case.toy else Effort()
    criterion = LeastSquaresError(system, case.parameter)
    return optimal_motion(task, criterion, key, effort=effort).trajectory


def improved(
    case: Case, limits: Limits, axis: Prediction, motion: JerkTrajectory
) -> JerkTrajectory:
    """Return a motion near a given one that keeps the limits of the axis, with minimal J*."""
    problem = Problem(case.planned(), limits, motor.boundary(), axis)
    effort = Effort(newton_rounds=1, newton_steps=2, programs=2) if case.toy else Effort()
    return improve(problem, motion, effort).trajectory


def sampled(options: Robust, case: Case) -> JerkTrajectory:
    """Return the best of the proved motion, a search from it, and one from random starts."""
    by_proof = motion(options, case.parameter, "proved")
    starts = (start(options, case, SAMPLED_MARGINS), by_proof)
    found = [inside_of_plants(options, case, begin) for begin in starts]
    kept = [by_proof, *(motion for motion in found if motion is not None)]
    return min(kept, key=lambda motion: planned(case, motion))


def inside_of_plants(options: Robust, case: Case, begin: JerkTrajectory) -> JerkTrajectory | None:
    """Return a motion for which no plant of one seed exceeds the limits, or None.

    The margins are increased from round to round.
    """
    limits, axis = case.setting.limits(), case.axis(IdealSensor())
    inwards = jnp.full(3, 1e-3)
    for _ in range(1 if case.toy else ROUNDS):
        found = improved(case, shrunk(limits, inwards), axis, begin)
        worst = np.max([part.max(axis=0) for part in beyond(options, case, found, options.seed)], 0)
        print(
            f"{case.parameter}, simulated plants: J* = {planned(case, found):.7g}, largest excess "
            f"of position, velocity and input limits: {worst} half-widths",
            flush=True,
        )
        if np.all(worst <= 0):
            return found
        inwards = inwards + 1.5 * jnp.maximum(jnp.asarray(worst), 0.0)
    return None


def planned(case: Case, motion: JerkTrajectory) -> float:
    """Return J* of the parameter of the case."""
    return float(planned_error(case.setting.system(), motion)[case.index])


def checked(options: Robust, name: str, method: str, motion: JerkTrajectory) -> tables.Row:
    """Return the table row of a motion: J*, whether the tube keeps the limits, and a final check.

    The final check counts the simulated plants that exceed each limit.

    Raises:
        ValueError: if the file of a proved motion holds one that exceeds its limits.
    """
    case = options.case(name)
    limits = case.setting.limits()
    holds = bool(
        Problem(case.planned(), limits, motor.boundary(), tube(case)).violation(motion) <= 0
    )
    require(
        holds or method != "proved",
        f"Argument `out`: the motion for {name} that is there as proved leaves its limits: "
        "remove its file, to search again.",
    )
    random, searched = beyond(options, case, motion, options.seed + 1)
    row: tables.Row = {"parameter": name, "N": options.horizon, "limits": method}
    row |= {"J_star": planned(case, motion), "proved": holds}
    for group, found in (("random", random), ("searched", searched)):
        row[f"{group}_plants"] = len(found)
        for k, side in enumerate(SIDES):
            row[f"{group}_beyond_{side}"] = int(np.sum(found[:, k] > 0))
    return row


def beyond(
    options: Robust, case: Case, motion: JerkTrajectory, seed: int
) -> tuple[Float[np.ndarray, "k sides"], Float[np.ndarray, "k sides"]]:
    """Return by how much random plants and worst-case plants exceed each limit, in half-widths.

    They are simulated with the encoder and ten Runge-Kutta steps per sample period.
    """
    system, limits = case.setting.system(), case.setting.limits()
    first, second = jax.random.split(jax.random.key(seed))
    against = AgainstTracking(case.setting.controller().k1)
    kinds: list[Disturbance] = [NoDisturbance(), motor.plant().disturbance, against]
    plants, attacks = (8, 6) if case.toy else (options.plants, options.attacks)
    ideal, real = case.loop(IdealSensor()), case.loop(encoder(), 1 if case.toy else 10)
    groups = (
        random_scenarios(first, system, kinds, real.repeats * real.ticks, plants),
        find_worst_case_plants(ideal, system, limits, motion, second, attacks),
    )
    one, other = (np.asarray(plant_violations(real, group, limits, motion)) for group in groups)
    return one, other


if __name__ == "__main__":
    configure()
    main(tyro.cli(Robust))
