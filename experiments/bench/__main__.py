"""Ratios of times measured in the same run, beside their targets: printed, and left in a folder."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro
from tqdm import tqdm

from experiments._support.processes import pin, processors
from experiments.axes import linear_motor as motor
from experiments.bench import accuracy, batches, compile_time, loop_against_c
from experiments.bench.answers import Answer
from jaxid.io.files import Cell, write_table
from jaxid.io.plots import text_table
from jaxid.runtime import configure

COLUMNS = ("question", "case", "quantity", "least", "median", "target", "met")


@dataclass(frozen=True)
class Bench:
    """How fast is it, and compared with what?

    Attributes:
        out: the folder of bench.csv.
        repetitions: interleaved, of every action; the minimum counts, the median stands beside it.
        toy: two repetitions of a few: only shows that everything runs.
    """

    out: Path = Path("figures")
    repetitions: int = 100
    toy: bool = False


def main(bench: Bench) -> None:
    """Ask, save, print."""
    found = [answer for question in tqdm(asked(bench), "questions") for answer in question()]
    rows = [row(answer) for answer in found]
    write_table(bench.out / "bench.csv", COLUMNS, rows)
    print(text_table(COLUMNS, [[line[name] for name in COLUMNS] for line in rows], title()))
    print(verdict(found))


def asked(bench: Bench) -> list[Callable[[], list[Answer]]]:
    """The questions in the order of the table. A toy starts no other process."""
    available, count = processors(), bench.repetitions
    pin(available[0])
    configure()
    if bench.toy:
        return [lambda: loop_against_c.ask(1, 2), lambda: batches.ask((1, 8), 2), accuracy.ask]
    return [
        lambda: loop_against_c.ask(1, count),
        lambda: loop_against_c.ask(3, count),
        lambda: loop_against_c.ask_folding(1, count // 10),
        lambda: batches.ask((1, 8, 64, 512), count // 10),
        lambda: batches.ask_both(8, available, count // 5),
        accuracy.ask,
        lambda: compile_time.ask(motor.HORIZONS[1:]),
    ]


def row(answer: Answer) -> dict[str, Cell]:
    """A line of the table."""
    target = None if answer.target is None else "{} {:g}".format(*answer.target)
    values = (answer.least, answer.median, target, answer.met)
    named = (answer.question, answer.case, answer.quantity, *values)
    return dict(zip(COLUMNS, named, strict=True))


def verdict(found: Sequence[Answer]) -> str:
    """How many targets are met."""
    judged = [answer for answer in found if answer.met is not None]
    missed = [f"{a.question}: {a.quantity} ({a.case})" for a in judged if not a.met]
    return "\n".join(
        [f"{len(judged) - len(missed)} of {len(judged)} targets met; missed:", *missed]
        if missed
        else [f"All {len(judged)} targets met."]
    )


def title() -> str:
    """With the load: others on the same processors show in the medians first."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return f"Ratios of times measured in this run, of minima and of medians; load {load}"


if __name__ == "__main__":
    main(tyro.cli(Bench))
