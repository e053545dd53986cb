"""What designing through the filter and the closed loop gains: table6.csv, table7.csv."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import jax.numpy as jnp
import numpy as np
import tyro
from tqdm import tqdm

from experiments.linear_motor import gain_maps, tables
from experiments.linear_motor.designs import STUDIED, Cell, trajectory_path
from experiments.linear_motor.settings import HARDER, STUDY
from experiments.linear_motor.stages import STAGES, Case, Motions, errors
from experiments.processes import each
from jaxid import linear_motor as motor
from jaxid.files import read_table, read_trajectory, write_table
from jaxid.runtime import configure
from jaxid.trajectory import JerkTrajectory, uniform

BANDWIDTHS = (50.0, 100.0, 300.0, 1000.0)  # rad/s
HARDER_HORIZON = 40
SHARED = ("by_18", "two_stage")  # that do not know the filter
Item = TypeVar("Item")
Rows = list[tables.Row]


@dataclass(frozen=True)
class EndToEnd:
    """Every design of table 6, and of harder settings; goes on where it stopped.

    Each motion is a row of endtoend.csv, with what it is worth and how long the search took: remove
    the file to search again.

    Attributes:
        out: the folder that the tables are written to.
        motions: the folder with the trajectories of the study.
        processes: how many searches run side by side; the results do not depend on it.
        toy: two cells, hardly searched: only shows that everything runs.
    """

    out: Path = Path("figures")
    motions: Path = Path("figures")
    processes: int = 2
    toy: bool = False

    def table_6(self) -> list[Case]:
        """The study's motor: parameters, horizons, bandwidths."""
        settings = [replace(STUDY, bandwidth=w) for w in BANDWIDTHS]
        horizons = motor.HORIZONS[1:]
        found = [Case(s, name, n, self.toy) for name in STUDIED for n in horizons for s in settings]
        return found[: 1 if self.toy else None]

    def table_7(self) -> list[Case]:
        """The harder settings, at one horizon."""
        horizon = motor.HORIZONS[1] if self.toy else HARDER_HORIZON
        found = [Case(s, name, horizon, self.toy) for s in HARDER for name in STUDIED]
        return found[: 1 if self.toy else None]


@dataclass
class Archive:
    """Everything that was found, in a file that is whole at any moment."""

    path: Path
    rows: Rows = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.path.exists():
            self.rows = [dict(row) for row in read_table(self.path)]

    def add(self, rows: Rows) -> None:
        """Keep them."""
        self.rows += rows
        write_table(self.path, tables.SEARCHES, self.rows)

    def of(self, case: Case) -> dict[str, tables.Row]:
        """Its rows, by design."""
        same = [row for row in self.rows if _names(row) == _names(_labels(case))]
        return {str(row["design"]): row for row in same}


def main(options: EndToEnd) -> None:
    """Search what is missing, save, print."""
    archive = Archive(options.out / "endtoend.csv")
    complete(options, archive)
    for name, cases, draw in (
        ("table6", options.table_6(), gain_maps.study),
        ("table7", options.table_7(), gain_maps.harder),
    ):
        rows = [tables.gains(archive.of(case)) for case in cases]
        table = tables.Table(tables.GAINS[name], rows)
        write_table(options.out / f"{name}.csv", table.header, table.rows)
        draw(options.out / f"{name}.png", rows)
        print(table.text(f"{name}: J_f by stages of the design; per cent of the stage before"))
        print()


def complete(options: EndToEnd, archive: Archive) -> None:
    """First the designs that several cases share, then those of each case."""
    # horizon by horizon: each has compilations of its own
    cases = sorted(options.table_6() + options.table_7(), key=lambda case: case.horizon)
    groups: dict[tuple[str, str, int], list[Case]] = {}
    for case in cases:
        groups.setdefault((case.setting.label, case.parameter, case.horizon), []).append(case)
    missing = [group for group in groups.values() if not archive.of(group[-1])]
    begin = partial(first_designs, options.motions)
    keep(archive, "without filter and loop", begin, missing, options.processes)
    rest = [(case, archive.of(case)) for case in cases]
    rest = [(case, rows) for case, rows in rest if len(rows) < len(STAGES)]
    keep(archive, "through filter and loop", last_designs, rest, options.processes)


def keep(
    archive: Archive,
    title: str,
    search: Callable[[Item], Rows],
    items: Sequence[Item],
    processes: int,
) -> None:
    """Each result is in the file as soon as it is there."""
    with tqdm(each(search, items, processes), title, len(items), disable=not items) as found:
        for rows in found:
            archive.add(rows)
            found.set_postfix_str(f"{rows[-1]['setting']}, {rows[-1]['parameter']}")


def first_designs(folder: Path, group: Sequence[Case]) -> Rows:
    """Rows of the designs that do not know the filter, for several filters."""
    case, motions, seconds = group[0], Motions(), {}
    if case.setting.label == STUDY.label:
        path = trajectory_path(folder, Cell(case.parameter, case.horizon))
        motions["table_1"] = read_trajectory(path)
    for name in SHARED:
        motions[name], seconds[name] = timed(name, case, motions)
    return [to_row(other, name, motions[name], seconds[name]) for other in group for name in SHARED]


def last_designs(begun: tuple[Case, dict[str, tables.Row]]) -> Rows:
    """Rows of the designs of one case that know the filter."""
    case, rows = begun
    motions = {name: to_motion(row) for name, row in rows.items()}
    found = []
    for name in STAGES:
        if name not in motions:
            motions[name], seconds = timed(name, case, motions)
            found.append(to_row(case, name, motions[name], seconds))
    return found


def timed(name: str, case: Case, motions: Motions) -> tuple[JerkTrajectory, float]:
    """A design and the seconds that its search took, compilations included."""
    begin = time.perf_counter()
    return STAGES[name](case, motions), time.perf_counter() - begin


def to_row(case: Case, name: str, motion: JerkTrajectory, seconds: float) -> tables.Row:
    """Of the archive."""
    jerk = " ".join(f"{x:.17g}" for x in np.asarray(motion.jerk))
    found = dict(zip(tables.SEARCHES[6:11], errors(case, motion), strict=True))
    return {**_labels(case), "design": name, "seconds": seconds, **found, "jerk_m_s3": jerk}


def to_motion(row: tables.Row) -> JerkTrajectory:
    """That a row of the archive holds."""
    jerk = jnp.asarray([float(x) for x in str(row["jerk_m_s3"]).split()])
    return uniform(motor.boundary().start, jerk, motor.KNOT_PERIOD)


def _labels(case: Case) -> tables.Row:
    return {
        "setting": case.setting.label,
        "parameter": case.parameter,
        "N": case.horizon,
        "w_rad_s": case.setting.bandwidth,
    }


def _names(row: tables.Row) -> tuple[str, str, int, float]:
    """Numbers from a file and numbers from here compare as equal."""
    return (
        str(row["setting"]),
        str(row["parameter"]),
        int(row["N"] or 0),
        float(row["w_rad_s"] or 0),
    )


if __name__ == "__main__":
    configure()
    main(tyro.cli(EndToEnd))
