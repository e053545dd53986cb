"""The gain of designs that account for the filter and the closed loop: table6.csv, table7.csv."""

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from tqdm import tqdm

from experiments._support import gain_maps
from experiments._support.cases import Case, worth
from experiments._support.processes import chained, make_room
from experiments._support.settings import HARDER, STUDY
from experiments._support.stages import EFFORTS, FILTERED, STAGES, Designs, by_18
from experiments.axes import linear_motor as motor
from experiments.paper import tables
from experiments.paper.designs import STUDIED
from jaxid.io.files import Cell as Value
from jaxid.io.files import read_table, write_table
from jaxid.motion.trajectory import JerkTrajectory, uniform
from jaxid.runtime import configure

BANDWIDTHS = (50.0, 100.0, 300.0, 1000.0)  # rad/s
HARDER_HORIZON = 40
Key = tuple[str, str, int, float, str]


@dataclass(frozen=True)
class EndToEnd:
    """All designs of table 6, and of table 7 with harder settings; a stopped run continues.

    Each motion is a row of endtoend.csv, with its evaluation and the duration of its search. Remove
    the file to search again.

    Attributes:
        out: folder for the tables.
        motions: folder with the trajectories of the study.
        processes: number of searches that run in parallel; the results do not depend on it.
        redraw: make the tables from endtoend.csv as it is, without a search.
        toy: run three cases with minimal effort, only to show that everything works.
    """

    out: Path = Path("figures")
    motions: Path = Path("figures")
    processes: int = 2
    redraw: bool = False
    toy: bool = False

    def table_6(self) -> list[Case]:
        """Return the cases of table 6: the study's motor, by parameter, horizon and bandwidth."""
        settings = [replace(STUDY, bandwidth=w) for w in BANDWIDTHS]
        horizons = motor.HORIZONS[1:]
        if self.toy:
            return [Case(s, "M", horizons[0], self.motions, True) for s in settings[:2]]
        return [
            Case(s, name, n, self.motions) for n in horizons for name in STUDIED for s in settings
        ]

    def table_7(self) -> list[Case]:
        """Return the cases of table 7: the harder settings at one horizon."""
        if self.toy:
            return [Case(HARDER[0], "M", motor.HORIZONS[1], self.motions, True)]
        return [Case(s, name, HARDER_HORIZON, self.motions) for s in HARDER for name in STUDIED]

    @property
    def prefix(self) -> str:
        """The prefix of the file names, so that a toy run overwrites no files of a full run."""
        return "toy_" if self.toy else ""


@dataclass
class Archive:
    """All designs that were found, in a file that is complete at any moment."""

    path: Path
    redraw: bool = False  # whether to use rows that were made from other inputs
    rows: dict[Key, tables.Row] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.path.exists():
            self.rows = {key_of(row): dict(row) for row in read_table(self.path)}

    def add(self, rows: list[tables.Row]) -> None:
        """Save rows; each replaces the row with the same key."""
        self.rows |= {key_of(row): row for row in rows}
        write_table(self.path, tables.SEARCHES, self.rows.values())

    def of(self, case: Case) -> dict[str, tables.Row]:
        """Return the rows of a case by design, without those that were made from other inputs."""
        keys = {name: key_of({**labels(case), "design": name}) for name in STAGES}
        rows = {name: self.rows[key] for name, key in keys.items() if key in self.rows}
        if self.redraw:
            return rows
        inputs = fingerprint(case)
        return {name: row for name, row in rows.items() if row["inputs"] == inputs}


def main(options: EndToEnd) -> None:
    """Search the missing designs, and write and print the tables."""
    archive = Archive(options.out / f"{options.prefix}endtoend.csv", options.redraw)
    if not options.redraw:
        complete(options, archive)
    for name, cases, draw in (
        ("table6", options.table_6(), gain_maps.study),
        ("table7", options.table_7(), gain_maps.harder),
    ):
        rows = [labels(case) | tables.gains(archive.of(case)) for case in cases]
        table = tables.Table(tables.GAINS[name], rows)
        write_table(options.out / f"{options.prefix}{name}.csv", table.header, table.rows)
        draw(options.out / f"{options.prefix}{name}.png", rows)
        print(table.text(f"{name}: J_f by design stage"), end="\n\n")


def complete(options: EndToEnd, archive: Archive) -> None:
    """Search every design that the archive lacks, and save each as soon as it is found."""
    groups: dict[tuple[str, str, int], list[Case]] = {}
    for case in options.table_6() + options.table_7():
        groups.setdefault((case.setting.label, case.parameter, case.horizon), []).append(case)
    chains = [missing(archive, group) for group in groups.values()]
    found = chained(searched, chains, options.processes)
    with tqdm(found, "designs", sum(map(len, chains))) as progress:
        for state in progress:
            archive.add([state.row])
            progress.set_postfix_str(" ".join(map(str, key_of(state.row))))


class Search(NamedTuple):
    """One design to search, with the known designs of its own and of earlier cases of its group."""

    case: Case
    design: str
    earlier: Designs
    own: Designs


class State(NamedTuple):
    """The designs that a chain of searches has found, for one axis and one filter after another."""

    row: tables.Row
    designs: dict[str, JerkTrajectory]


def missing(archive: Archive, group: Sequence[Case]) -> list[Search]:
    """Return the chain of missing searches for cases that differ in their filter."""
    chain, earlier = [], {}
    for case in group:
        own = {name: to_motion(row) for name, row in archive.of(case).items()}
        chain += [Search(case, name, earlier, own) for name in STAGES if name not in own]
        earlier = {**earlier, **own}
    return chain


def searched(search: Search, last: State | None) -> State:
    """Return the state of a chain after the search of one design.

    Designs that do not depend on the filter are searched once for all filters.
    """
    make_room()
    designs = {**search.earlier, **(last.designs if last else {}), **search.own}
    begin = time.perf_counter()
    if search.design in FILTERED or search.design not in designs:
        designs[search.design] = STAGES[search.design](search.case, designs)
    seconds = time.perf_counter() - begin
    return State(to_row(search.case, search.design, designs[search.design], seconds), designs)


def to_row(case: Case, name: str, motion: JerkTrajectory, seconds: float) -> tables.Row:
    """Return the archive row of a design; its seconds include compilation."""
    jerk = " ".join(f"{x:.17g}" for x in np.asarray(motion.jerk))
    made = {"design": name, "inputs": fingerprint(case), "seconds": seconds}
    return {**labels(case), **made, **worth(case, motion)._asdict(), "jerk_m_s3": jerk}


def to_motion(row: tables.Row) -> JerkTrajectory:
    """Return the motion of an archive row."""
    jerk = jnp.asarray([float(x) for x in str(row["jerk_m_s3"]).split()])
    return uniform(motor.boundary().start, jerk, motor.KNOT_PERIOD)


def labels(case: Case) -> tables.Row:
    """Return the columns that identify a case in tables."""
    values = case.setting.label, case.parameter, case.horizon, case.setting.bandwidth
    return dict(zip(tables.LABELS, values, strict=True))


def fingerprint(case: Case) -> str:
    """Return a digest of the inputs of a case; rows with another digest are searched again."""
    digest = hashlib.sha256(repr((case.setting, case.toy, EFFORTS)).encode())
    for array in jax.tree.leaves((case.setting.limits(), case.setting.controller())):
        digest.update(np.asarray(array).tobytes())
    if case.setting.planned_as_in_study:
        digest.update(np.asarray(by_18(case, {}).jerk).tobytes())
    return digest.hexdigest()[:16]


def key_of(row: Mapping[str, Value]) -> Key:
    """Return the key of a row; it is the same for numbers from a file and for computed ones."""
    setting, parameter, horizon, bandwidth = (row[name] or 0 for name in tables.LABELS)
    return str(setting), str(parameter), int(horizon), float(bandwidth), str(row["design"])


if __name__ == "__main__":
    configure()
    main(tyro.cli(EndToEnd))
