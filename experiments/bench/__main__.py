"""Run all benchmarks, and write and print ratios of times beside their targets."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro
from tqdm import tqdm

from experiments._support.processes import pin, processors
from experiments.axes import linear_motor as motor
from experiments.bench import (
    accuracy,
    batches,
    commands,
    compile_time,
    loop_against_c,
    simulated_run,
)
from experiments.bench.answers import Answer
from jaxid.io.files import Cell, write_table
from jaxid.io.text_tables import text_table
from jaxid.runtime import configure

COLUMNS = ("question", "case", "quantity", "least", "median", "target", "met")


@dataclass(frozen=True)
class Bench:
    """Times of the library, as ratios to those of C and CasADi.

    Attributes:
        out: folder for bench.csv.
        repetitions: number of interleaved repetitions of every action; targets apply to the
            minimum, and the median stands beside it.
        suites: also time `make reproduce` and `make test`, each twice: an hour.
        toy: run a few benchmarks with two repetitions, only to show that everything works.
    """

    out: Path = Path("figures")
    repetitions: int = 100
    suites: bool = False
    toy: bool = False


def main(bench: Bench) -> None:
    """Run the benchmarks, and write and print the table."""
    found = [answer for question in tqdm(asked(bench), "questions") for answer in question()]
    rows = [row(answer) for answer in found]
    write_table(bench.out / "bench.csv", COLUMNS, rows)
    print(text_table(COLUMNS, [[line[name] for name in COLUMNS] for line in rows], title()))
    print(verdict(found))


def asked(bench: Bench) -> list[Callable[[], list[Answer]]]:
    """Return the benchmarks in the order of the table; a toy run starts no other process."""
    available, count = processors(), bench.repetitions
    pin(available[0])
    configure()
    if bench.toy:
        return [
            lambda: commands.ask(("--help",), available),
            lambda: loop_against_c.ask(1, 2),
            lambda: batches.ask((1, 8), 2),
            accuracy.ask,
        ]
    suites = [lambda: commands.ask(commands.SUITES, available)] if bench.suites else []
    return [
        lambda: commands.ask(commands.COMMANDS, available),
        *suites,
        lambda: loop_against_c.ask(1, count),
        lambda: loop_against_c.ask(3, count),
        lambda: loop_against_c.ask_folding(1, count // 10),
        lambda: simulated_run.ask(count),
        lambda: batches.ask((1, 8, 64, 512), count // 10),
        lambda: batches.ask_both(8, available, count // 5),
        accuracy.ask,
        lambda: compile_time.ask(motor.HORIZONS[1:]),
    ]


def row(answer: Answer) -> dict[str, Cell]:
    """Return the table row of an answer."""
    target = None if answer.target is None else "{} {:g}".format(*answer.target)
    values = (answer.least, answer.median, target, answer.met)
    named = (answer.question, answer.case, answer.quantity, *values)
    return dict(zip(COLUMNS, named, strict=True))


def verdict(found: Sequence[Answer]) -> str:
    """Return a sentence on how many targets are met, and a list of those missed."""
    judged = [answer for answer in found if answer.met is not None]
    missed = [f"{a.question}: {a.quantity} ({a.case})" for a in judged if not a.met]
    return "\n".join(
        [f"{len(judged) - len(missed)} of {len(judged)} targets met; missed:", *missed]
        if missed
        else [f"All {len(judged)} targets met."]
    )


def title() -> str:
    """Return the title of the table, with the load of the machine.

    Other programs on the same processors affect the medians first.
    """
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return f"Ratios of times measured in this run, of minima and of medians; load {load}"


if __name__ == "__main__":
    main(tyro.cli(Bench))
