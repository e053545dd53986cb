"""Design, run and identify the motor of the paper, and write its tables and figures to a folder."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from tqdm import tqdm

from experiments.axes import linear_motor as motor
from experiments.paper import (
    certificate_figures,
    certificate_tables,
    certificates,
    designs,
    figures,
    runs,
    tables,
)
from experiments.paper.designs import HORIZON, ONE_MOTION, STUDIED, Cell, trajectory_path
from jaxid.identification.assumptions import assumptions
from jaxid.io.files import read_trajectory, write_table, write_trajectory
from jaxid.motion.trajectory import JerkTrajectory, padded
from jaxid.regression.error_of_motion import planned_error
from jaxid.regression.lower_bound import lower_bound
from jaxid.runtime import configure
from jaxid.search.effort import Effort


@dataclass(frozen=True)
class Study:
    """The paper's experiment on its linear motor, from the design to the tables.

    Attributes:
        out: folder for the tables, trajectories and figures.
        seed: seed of every random choice.
        processes: number of searches that run in parallel; the results do not depend on it.
        redraw: use the trajectories in `out` instead of searching.
        toy: run with minimal effort, only to show that everything works.
    """

    out: Path = Path("figures")
    seed: int = 0
    processes: int = 2
    redraw: bool = False
    toy: bool = False

    @property
    def horizons(self) -> tuple[int, ...]:
        """The horizons N_i to try."""
        return motor.HORIZONS[:2] if self.toy else motor.HORIZONS

    @property
    def plants(self) -> int:
        """The number of random plants on which the bound (29) is tested."""
        return 4 if self.toy else 100


def main(study: Study) -> None:
    """Compute the study, and write and print its tables and figures."""
    if not study.redraw:
        search(study)
    trajectories = saved_trajectories(study)
    errors = {
        # padded to one length, for a single compilation
        cell: np.asarray(planned_error(motor.system(), padded(t, 2 * max(motor.HORIZONS))))
        for cell, t in trajectories.items()
    }
    chosen = choose(study, trajectories, errors)
    loops = {cell: runs.closed_loop(t) for cell, t in tqdm(chosen.items(), "closed loop")}
    sweeps = {cell: runs.sweep(loop) for cell, loop in loops.items()}
    amplitudes = sorted({*runs.AMPLITUDES, *motor.OPEN_LOOP_AMPLITUDES})
    pulses = {a: runs.open_loop(a) for a in tqdm(amplitudes, "open loop")}
    shown = save_tables(study, errors, loops, pulses)
    shown += kept(study, loops, chosen)
    shown += certify(study, trajectories)
    figures.desired(study.out, chosen)
    figures.tracking(study.out, loops)
    figures.open_loop(study.out, pulses)
    figures.bandwidth(study.out, sweeps, errors)
    figures.amplitudes(study.out, pulses)
    print("\n\n".join(shown))


def search(study: Study) -> None:
    """Search all designs, and write each motion as soon as it is found."""
    effort = designs.TOY if study.toy else Effort()
    chains = designs.study(study.horizons)
    total = sum(map(len, chains))
    found = designs.search(chains, effort, study.seed, study.processes)
    with tqdm(found, "designs", total) as progress:
        for result in progress:
            progress.set_postfix_str(f"{result.cell.target}, N = {result.cell.horizon}")
            if result.jerk is None:
                if result.cell.target == STUDIED[0]:
                    progress.write(f"N = {result.cell.horizon} is infeasible. {result.reason}")
            else:
                write_trajectory(trajectory_path(study.out, result.cell), result.trajectory())


def saved_trajectories(study: Study) -> dict[Cell, JerkTrajectory]:
    """Return the motions in the files of the search; an infeasible cell has none."""
    wanted = [cell for chain in designs.study(study.horizons) for cell in chain]
    paths = {cell: trajectory_path(study.out, cell) for cell in wanted}
    return {cell: read_trajectory(path) for cell, path in paths.items() if path.exists()}


def choose(
    study: Study, trajectories: Mapping[Cell, JerkTrajectory], errors: Mapping[Cell, tables.Errors]
) -> dict[Cell, JerkTrajectory]:
    """Return for each parameter the motion of the horizon with the smallest J*.

    Each motion is also written as trajectory_<name>.csv.
    """
    chosen = {}
    for index, name in enumerate(STUDIED):
        own = {c.horizon: float(e[index]) for c, e in errors.items() if c.target == name}
        cell = Cell(name, tables.chosen_horizon(own))
        chosen[cell] = trajectories[cell]
        write_trajectory(study.out / f"trajectory_{name}.csv", trajectories[cell])
    return chosen


def save_tables(
    study: Study,
    errors: Mapping[Cell, tables.Errors],
    loops: Mapping[Cell, runs.ClosedLoopRun],
    pulses: Mapping[float, runs.OpenLoopRun],
) -> list[str]:
    """Write the tables as CSV files, and return them as text."""
    made = {
        "table1": (
            tables.table_1(errors, STUDIED, study.horizons),
            "Table I: J* of the desired motion",
        ),
        "designs": (tables.designs_table(errors), "J of every parameter for every design"),
        "table2": (tables.table_2(loops, errors), "Table II: closed loop, exact signals"),
        "limits": (tables.limits_table(loops), LIMITS_TITLE),
        "table3": (tables.table_3(pulses), "Table III: open loop"),
    }
    for name, (table, _) in made.items():
        write_table(study.out / f"{name}.csv", table.header, table.rows)
    texts = [table.text(title) for table, title in made.values()]
    notes = tables.not_reduced(made["table2"][0], "J_f") + tables.not_reduced(
        made["table3"][0], "bound"
    )
    rests_on = (*assumptions(motor.system()), "All signals of Tables II and III are exact.")
    rests = "\n".join(
        ["The intervals of Tables II and III hold provided that:", *(f"  {x}" for x in rests_on)]
    )
    return [*texts, "\n".join(notes), rests]


def kept(
    study: Study, loops: Mapping[Cell, runs.ClosedLoopRun], chosen: Mapping[Cell, JerkTrajectory]
) -> list[str]:
    """Return sentences on whether (29) holds for random plants under the worst-case disturbance.

    It is tested with exact signals and with measured ones.
    """
    lines = []
    for cell, loop in loops.items():
        index = motor.system().index(cell.target)
        count = runs.misses(loop, chosen[cell], index, study.plants, study.seed)
        lines.append(
            f"{cell.target}: θ is outside θ̂ ± J_f in {int(count.exact[index])} of "
            f"{count.experiments} experiments with exact signals. With an encoder of "
            f"{motor.ENCODER_RESOLUTION * 1e6:g} µm it is outside in {int(count.printed[index])} "
            f"with (28) as printed, and in {int(count.measured[index])} with differences that have "
            "the same lag in every column."
        )
    return ["\n".join([f"Does (29) hold? Random plants, worst-case Δ, seed {study.seed}.", *lines])]


def certify(study: Study, trajectories: Mapping[Cell, JerkTrajectory]) -> list[str]:
    """Write and return the tables of optimality gaps and of the guaranteed intervals of one run."""
    least = lower_bound(motor.system(), motor.limits())
    motions = tqdm(trajectories.items(), "certificates")
    worths = {cell: certificates.worth(motion, least) for cell, motion in motions}
    motion = trajectories[Cell(ONE_MOTION, HORIZON)]
    proof = certificates.experiment(motion)
    proved = certificate_tables.proved(proof, np.asarray(least.value))
    for name, table in (("table4", certificate_tables.table_4(worths)), ("proved", proved)):
        write_table(study.out / f"{name}.csv", table.header, table.rows)
    compared = {name: worths[Cell(name, HORIZON)] for name in (*STUDIED, ONE_MOTION)}
    certificate_figures.above_floor(study.out, compared)
    certificate_figures.possible(study.out, proof)
    certificate_figures.overview(study.out, motion, proof)
    shown = {cell: one for cell, one in worths.items() if cell.horizon == HORIZON}
    rests = "\n".join(
        ["These intervals hold provided that:", *(f"  {line}" for line in proof.assumptions)]
    )
    return [
        certificate_tables.table_4(shown).text(TABLE_4_TITLE),
        proved.text("Guaranteed intervals from one experiment of 0.6 s, beside the paper's three"),
        rests,
    ]


TABLE_4_TITLE = (
    f"Table 4, N = {HORIZON}: worst-case errors by estimator, predicted half-widths with servo "
    "and encoder, proved lower bounds"
)
LIMITS_TITLE = (
    "Ranges of the axis (true position and velocity, commanded input): "
    "the design keeps the limits for the reference only"
)

if __name__ == "__main__":
    configure()
    main(tyro.cli(Study))
