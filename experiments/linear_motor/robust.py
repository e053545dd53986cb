"""Limits that the axis itself keeps: sampled and proved, and what each costs beside (18)."""

from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Float

from experiments.linear_motor import figures, tables
from experiments.linear_motor.designs import STUDIED, TOY, Cell, trajectory_path
from experiments.linear_motor.runs import PERIODS
from jaxid import linear_motor as motor
from jaxid.adversary import adversaries
from jaxid.axis_conditions import perfect
from jaxid.bound import individual
from jaxid.design import Effort as SearchEffort
from jaxid.disturbance import AgainstTracking, Disturbance, NoDisturbance, square_wave
from jaxid.experiment import design_motion
from jaxid.files import read_trajectory, write_table, write_trajectory
from jaxid.limits import Limits, Prediction, acceleration_reach, shrunk
from jaxid.loop import (
    Loop,
    Sampled,
    Scenarios,
    every,
    excesses,
    random_scenarios,
    vertices,
)
from jaxid.objective import PlannedError, planned_error
from jaxid.problem import Problem, Task
from jaxid.refine import Effort, refine
from jaxid.runtime import configure
from jaxid.sensing import Encoder, IdealSensor, Sensor
from jaxid.trajectory import JerkTrajectory, ticks
from jaxid.tube import Tube, cells

CELLS = (8, 4, 4, 4)  # that Ω_θ is cut into for a proof
# what the axis is given to begin with beside its motion: m, m/s and V, near what a tube needs
PROVED_MARGINS, SAMPLED_MARGINS = (0.004, 0.04, 0.45, 0.0), (0.003, 0.03, 0.2, 0.0)
ROUNDS = 4  # of finding plants that leave the limits and keeping farther away
SIDES = ("position", "velocity", "input")
METHODS = ("18", "proved", "sampled")


@dataclass(frozen=True)
class Robust:
    """One motion per parameter whose limits hold for the axis: by (18), by sampling, by proof.

    Motions that are there already are checked, not searched for again: remove their files for that.

    Attributes:
        out: the folder that robust.csv and the motions are written to.
        motions: the folder with the trajectories of the study.
        horizon: N_i of the motions.
        plants: random plants of the final check.
        attacks: plants of the final check that are searched for.
        seed: of the designs; the final check has the next one.
        toy: search and check hardly at all: only shows that everything runs.
    """

    out: Path = Path("figures")
    motions: Path = Path("figures")
    horizon: int = 30
    plants: int = 1000
    attacks: int = 100
    seed: int = 0
    toy: bool = False

    @property
    def periods(self) -> int:
        """How often a motion is run."""
        return 1 if self.toy else PERIODS


def main(options: Robust) -> None:
    """Design what is missing, check, save, print."""
    rows: list[tables.Row] = []
    table = tables.Table(tables.ROBUST, rows)
    for name in STUDIED[: 1 if options.toy else None]:
        for method in METHODS:
            rows.append(checked(options, name, method, motion(options, name, method)))
            print(", ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
            # after each: what was found is kept if the program is stopped
            write_table(options.out / "robust.csv", table.header, table.rows)
    draw(options, STUDIED[0])
    print(table.text("Limits of the axis itself: by (18), by proof, by sampled plants"))


def draw(options: Robust, name: str) -> None:
    """The tube of the proved motion, and what corners of the box do in it."""
    planned = motion(options, name, "proved")
    count = ticks(planned, motor.CONTROL_PERIOD)
    after = planned.states(motor.CONTROL_PERIOD * jnp.arange(1, count + 1))
    real = loop(options, Encoder(motor.ENCODER_RESOLUTION), count)
    seen = Sampled(real, corners(options, count))(planned)
    figures.tube(options.out, after, tube(options, count)(planned), seen, axis_limits(), name)


def motion(options: Robust, name: str, method: str) -> JerkTrajectory:
    """A motion that was found before, or a new one, left as a file."""
    by_18 = read_trajectory(trajectory_path(options.motions, Cell(name, options.horizon)))
    if method == "18":
        return by_18
    path = options.out / f"robust_{method}_{name}_N{options.horizon}.csv"
    if not path.exists():
        find = {"sampled": sampled, "proved": proved}[method]
        write_trajectory(path, find(options, name, ticks(by_18, motor.CONTROL_PERIOD)))
    return read_trajectory(path)


def proved(options: Robust, name: str, count: int) -> JerkTrajectory:
    """All plants keep the limits: the tube does."""
    begin = start(options, name, PROVED_MARGINS)
    return improved(options, name, axis_limits(), tube(options, count), begin)


def tube(options: Robust, count: int) -> Tube:
    """Of all plants, for motions of `count` ticks."""
    return Tube(
        motor.provable_controller(),
        Encoder(motor.ENCODER_RESOLUTION),
        cells(motor.system(), (2, 1, 1, 1) if options.toy else CELLS),
        motor.CONTROL_PERIOD,
        count,
        options.periods,
    )


def axis_limits() -> Limits:
    """Those of the motor, by the input itself instead of (18); its rate is left out.

    Nothing useful can be proved of the rate: neighbouring inputs of one plant differ far less than
    what is known of them.
    """
    box = {name: tuple(getattr(motor.limits(), name).tolist()) for name in SIDES}
    reach = acceleration_reach(motor.system(), **box)
    whole = motor.limits()
    return Limits(whole.position, whole.velocity, reach, whole.jerk, whole.input)


def start(options: Robust, name: str, margins: tuple[float, float, float, float]) -> JerkTrajectory:
    """A cold search with fixed margins for what the axis adds to its motion."""
    system, intervals = motor.system(), 2 * options.horizon
    axis = perfect(system, 5 * intervals, margins)
    task = Task(axis_limits(), motor.boundary(), intervals, motor.KNOT_PERIOD, axis)
    key = jax.random.fold_in(jax.random.key(options.seed), system.index(name))
    effort = TOY if options.toy else SearchEffort()
    return design_motion(system, task, name, key, effort=effort).trajectory


def improved(
    options: Robust, name: str, limits: Limits, axis: Prediction, motion: JerkTrajectory
) -> JerkTrajectory:
    """The motion in the limits of the axis, and J* made as small as they allow."""
    system = motor.system()
    norm = individual(system.index(name), len(system.names))
    objective = PlannedError(system, norm, jnp.max(jnp.abs(limits.velocity)), 64)
    problem = Problem(objective, limits, motor.boundary(), axis)
    effort = Effort(rounds=1, steps=2, polish_steps=2) if options.toy else Effort()
    return refine(problem, motion, effort).trajectory


def sampled(options: Robust, name: str, count: int) -> JerkTrajectory:
    """The better of two searches: one begins cold, one from the motion that was proved."""
    starts = (start(options, name, SAMPLED_MARGINS), motion(options, name, "proved"))
    found = [inside_of_plants(options, name, count, begin) for begin in starts]
    return min(found, key=lambda motion: planned(name, motion))


def inside_of_plants(
    options: Robust, name: str, count: int, begin: JerkTrajectory
) -> JerkTrajectory:
    """Farther and farther inside until none of the plants of one seed leaves the limits."""
    limits, axis = (
        axis_limits(),
        Sampled(loop(options, IdealSensor(), count), corners(options, count)),
    )
    found, inwards = begin, jnp.full(3, 1e-3)
    for _ in range(1 if options.toy else ROUNDS):
        found = improved(options, name, shrunk(limits, inwards), axis, begin)
        worst = np.max([part.max(axis=0) for part in beyond(options, found, options.seed)], 0)
        print(f"{name} sampled, J* {planned(name, found):.7g}, beyond by {worst}", flush=True)
        if np.all(worst <= 0):
            break
        inwards = inwards + 1.5 * jnp.maximum(jnp.asarray(worst), 0.0)
    return found


def corners(options: Robust, count: int) -> Scenarios:
    """Every corner of the box, each with three disturbances."""
    system = motor.system()
    kinds = [NoDisturbance(), pushing(), square_wave(options.periods * count, 100)]
    return every(system, vertices(system), kinds)


def planned(name: str, motion: JerkTrajectory) -> float:
    """J* of its own parameter."""
    return float(planned_error(motor.system(), motion)[motor.system().index(name)])


def checked(options: Robust, name: str, method: str, motion: JerkTrajectory) -> tables.Row:
    """J* and how many plants of the final check leave which limit."""
    random, searched = beyond(options, motion, options.seed + 1)
    row: tables.Row = {"parameter": name, "N": options.horizon, "limits": method}
    row["J_star"] = planned(name, motion)
    for group, found in (("random", random), ("searched", searched)):
        row[f"{group}_plants"] = len(found)
        for k, side in enumerate(SIDES):
            row[f"{group}_beyond_{side}"] = int(np.sum(found[:, k] > 0))
    return row


def beyond(
    options: Robust, motion: JerkTrajectory, seed: int
) -> tuple[Float[np.ndarray, "k sides"], Float[np.ndarray, "k sides"]]:
    """The excess of random plants and of plants searched for: encoder, ten steps per tick."""
    system, limits = motor.system(), axis_limits()
    count = ticks(motion, motor.CONTROL_PERIOD)
    first, second = jax.random.split(jax.random.key(seed))
    kinds: list[Disturbance] = [NoDisturbance(), motor.plant().disturbance, pushing()]
    plants, attacks = (8, 6) if options.toy else (options.plants, options.attacks)
    ideal = loop(options, IdealSensor(), count)
    groups = (
        random_scenarios(first, system, kinds, options.periods * count, plants),
        adversaries(ideal, system, limits, motion, second, attacks),
    )
    real = loop(options, Encoder(motor.ENCODER_RESOLUTION), count, 1 if options.toy else 10)
    one, other = (np.asarray(excesses(real, group, limits, motion)) for group in groups)
    return one, other


def pushing() -> AgainstTracking:
    """The adversary of Theorem 4."""
    return AgainstTracking(motor.provable_controller().k1)


def loop(options: Robust, sensor: Sensor, count: int, substeps: int = 1) -> Loop:
    """The experiment of the paper, with the law that has a tube."""
    law = motor.provable_controller()
    return Loop(law, sensor, motor.CONTROL_PERIOD, count, options.periods, substeps)


if __name__ == "__main__":
    configure()
    main(tyro.cli(Robust))
