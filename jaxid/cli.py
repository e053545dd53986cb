"""The `jaxid` command: parse, call the library, print."""

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import tyro
from tqdm import tqdm

from jaxid.axis_design import ALL, FILES, AxisDesign, design_axis, write_design
from jaxid.axis_file import Coordinate, example, read_axis
from jaxid.checks import require
from jaxid.design import Effort
from jaxid.files import write_bytes
from jaxid.motion_design import GuaranteedEffort
from jaxid.report import text_table
from jaxid.runtime import configure

_QUICK = GuaranteedEffort(1, Effort(starts=16, generations=10, rounds=0, polished=1), (1e-3, 1e-4))
EFFORTS = {"usual": GuaranteedEffort(), "quick": _QUICK}


def init(
    axis: tyro.conf.Positional[Path], coordinate: Coordinate = "linear", force: bool = False
) -> None:
    """Write a commented example of an axis, to be changed into yours.

    Example: jaxid init slide.toml

    Args:
        axis: the file to write.
        coordinate: of the axis.
        force: replace a file that is there.
    """
    _keep([axis], force)
    write_bytes(axis, example(coordinate).encode())
    print(f"{axis} describes an example: change it into your axis, then: jaxid design {axis}")


def design(
    axis: tyro.conf.Positional[Path],
    out: Path,
    target: str = ALL,
    seed: int = 0,
    effort: Literal["usual", "quick"] = "usual",
    force: bool = False,
) -> None:
    """Design the motion that an axis is identified by best, for the servo to play.

    Example: jaxid design slide.toml --out slide

    Args:
        axis: the file that describes it.
        out: the folder for the motion as CSV, MAT and C header, its numbers and a page to look at.
        target: the name of one parameter, or all.
        seed: of the search.
        effort: quick takes a tenth of the time, and is a few per cent worse.
        force: replace files that are there.
    """
    _keep([out / name for name in FILES], force)
    known = read_axis(axis)
    with tqdm(bar_format="{desc} ({elapsed})") as line:
        found = design_axis(known, target, seed, EFFORTS[effort], line.set_description)
    left = write_design(out, found)
    print(_table(found))
    print("Left of the limits:", ", ".join(f"{name} {x:.2%}" for name, x in left.items()))
    print(f"Written to {out}: {', '.join(FILES)}")


def main(arguments: list[str] | None = None) -> None:
    """What the command runs; errors are sentences, and their exit code is 1."""
    configure()
    try:
        tyro.extras.subcommand_cli_from_dict(
            {"init": init, "design": design},
            prog="jaxid",
            description="From limits of a machine axis to guaranteed intervals of its parameters.",
            args=arguments,
        )
    except (ValueError, OSError) as error:
        print(f"jaxid: {error}", file=sys.stderr)
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        print("jaxid: stopped; nothing was left half-written", file=sys.stderr)
        raise SystemExit(130) from None


def _table(found: AxisDesign) -> str:
    system, worth = found.axis.system, found.worth
    header = ("parameter", "unit", "J", "guaranteed", "floor", "gap")
    columns = (worth.error, worth.guaranteed, worth.floor, worth.gap)
    numbers = zip(*(column.tolist() for column in columns), strict=True)
    rows = [(*head, *row) for *head, row in zip(system.names, system.units, numbers, strict=True)]
    return text_table(header, rows, "What its log can be expected to prove")


def _keep(paths: Iterable[Path], force: bool) -> None:
    """Refuse to replace what is there."""
    there = [str(path) for path in paths if path.exists()]
    require(force or not there, f"{', '.join(there)} would be replaced: allow it with --force.")
