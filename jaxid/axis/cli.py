"""The `jaxid` command: parse, call the library, print."""

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import tyro
from tqdm import tqdm

from jaxid._checks import require
from jaxid.axis.design import ALL, design_axis
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import Axis, Coordinate, example, read_axis
from jaxid.axis.identify import IdentifyResult, identify_axis
from jaxid.axis.prior import propose
from jaxid.axis.result import Result, write
from jaxid.axis.saved_designs import SavedDesign, designs_in, of_another_axis, read_design
from jaxid.axis.simulate import simulate_axis
from jaxid.axis.simulate_result import SimulateResult
from jaxid.axis.sweep import BANDWIDTHS, FACTORS, forget_blocks, sweep_axis
from jaxid.axis.sweep_result import SweepResult
from jaxid.axis.tradeoff import tradeoff
from jaxid.axis.tradeoff_result import TradeoffResult
from jaxid.io.files import write_bytes
from jaxid.io.log_file import Columns, read_log
from jaxid.io.manifest import sha256_of
from jaxid.io.results import require_writable
from jaxid.runtime import configure, connect, processors
from jaxid.search.effort import Effort

_QUICK = Effort(
    starts=16,
    generations=10,
    rounds=0,
    finalists=1,
    searches=1,
    predicted_smoothings=(1e-3, 1e-4),
)
CONTRADICTED = 3  # the exit code
_DESCRIPTION = (
    "From limits of a machine axis to guaranteed intervals of its parameters. Exit codes: 0 done, "
    "1 refused, 2 not understood, 3 the log contradicts the axis, 130 stopped."
)
EFFORTS = {"usual": Effort(), "quick": _QUICK}


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
    require(force or not axis.exists(), f"{axis} would be replaced: allow it with --force.")
    write_bytes(axis, example(coordinate).encode())
    print(f"{axis} describes an example: change it into your axis, then: jaxid design {axis}")


def prior(
    axis: tyro.conf.Positional[Path], log: tyro.conf.Positional[Path], run_python: bool = False
) -> None:
    """Propose intervals of the parameters and δ, from a log of any motion: a jog, a square wave.

    Example: jaxid prior slide.toml jog.csv

    Args:
        axis: the file that describes it; of its intervals and its disturbance nothing is used.
        log: CSV, MAT or HDF5.
        run_python: run the module that the file of the axis names.
    """
    known = read_axis(axis, run_python=run_python)
    print(propose(known, read_log(log, _columns(axis, known))).text())


def design(
    axis: tyro.conf.Positional[Path],
    out: Path,
    target: tuple[str, ...] = (ALL,),
    horizons: tuple[float, ...] = (),
    seed: int = 0,
    effort: Literal["usual", "quick"] = "usual",
    force: bool = False,
    run_python: bool = False,
) -> None:
    """Design the motion that an axis is identified by best, for the servo to play.

    Example: jaxid design slide.toml --out slide

    What would be gained by a longer one, or for one parameter alone?
    jaxid design slide.toml --out choice --target all M --horizons 0.5 0.6 1.2

    Args:
        axis: the file that describes it.
        out: the folder for the motion as CSV, MAT and C header, its numbers and a page to look at;
            of several motions, for a folder each, and a table and a page that compare them.
        target: the name of one parameter; all, by their floors; or wanted, by what the file wants.
        horizons: durations in s, in place of the file's.
        seed: of the search.
        effort: quick takes a tenth of the time, and is a few per cent worse.
        force: replace files that are there.
        run_python: run the module that the file of the axis names.
    """
    require(target, "Argument `target` must name what to design for, but is empty.")
    known = read_axis(axis, run_python=run_python)
    times = horizons or (known.task.intervals * known.task.period,)
    several = len(target) * len(times) > 1
    names = (TradeoffResult if several else DesignResult).names
    require_writable(out, names, replace=force)
    with tqdm(bar_format="{desc} ({elapsed})") as line:
        search = seed, EFFORTS[effort], line.set_description
        if several:
            result = TradeoffResult(tradeoff(known, target, times, out, *search, replace=force))
        else:
            result = DesignResult(design_axis(known.lasting(times[0]), target[0], *search))
    _finish(out, result, force)


def simulate(
    axis: tyro.conf.Positional[Path],
    design: tyro.conf.Positional[Path],
    plants: int = 200,
    logs: int = 10,
    seed: int = 0,
    force: bool = False,
    run_python: bool = False,
) -> None:
    """Let random axes of the box track a designed motion in closed loop: what will happen?

    Example: jaxid simulate slide.toml slide

    Args:
        axis: the file that describes it; its table [controller] says what tracks the motion.
        design: the folder of `jaxid design`, which the results are put into.
        plants: how many axes.
        logs: of how many of them what their logs prove is found too.
        seed: of the axes and of what disturbs them.
        force: replace files that are there.
        run_python: run the module that the file of the axis names.
    """
    known = read_axis(axis, run_python=run_python)
    saved = read_design(design, known.system.coordinate)
    require_writable(design, SimulateResult.names, replace=force)
    with tqdm(bar_format="{desc} ({elapsed})", leave=False) as line:
        found = simulate_axis(known, saved.motion, plants, logs, seed, line.set_description)
    _tell_changed(axis, [saved], known)
    _finish(design, SimulateResult(found, saved.part.digest), force)


def sweep(
    axis: tyro.conf.Positional[Path],
    design: tyro.conf.Positional[Path],
    bandwidths: tuple[float, ...] = BANDWIDTHS,
    factors: tuple[float, ...] = FACTORS,
    plants: int = 3,
    seed: int = 0,
    force: bool = False,
    run_python: bool = False,
) -> None:
    """Which filter, which gains, which motion? Closed loops with many of them, as one data set.

    It goes on where it was stopped. Example: jaxid sweep slide.toml choice

    Args:
        axis: the file that describes it; its table [controller] says what tracks the motions.
        design: the folder of `jaxid design`, for one motion or for several.
        bandwidths: of the first-order filter of input and regressors, rad/s.
        factors: of the feedback gains.
        plants: random ones of the box, beside its middle, its lowest and its highest θ.
        seed: of these and of what disturbs them.
        force: replace files that are there.
        run_python: run the module that the file of the axis names.
    """
    connect(processors())
    known = read_axis(axis, run_python=run_python)
    saved = designs_in(design, known.system.coordinate)
    require_writable(design, SweepResult.names, replace=force)
    with tqdm(unit="block") as line:

        def tell(done: int, total: int) -> None:
            line.total = total
            line.update(done - line.n)

        found = sweep_axis(known, saved, bandwidths, factors, plants, seed, tell)
    if found is None:  # another process has all of it
        return
    _tell_changed(axis, saved.designs.values(), known)
    _finish(design, SweepResult(found), force)
    forget_blocks(design)


def identify(
    axis: tyro.conf.Positional[Path],
    log: tyro.conf.Positional[Path],
    out: Path,
    force: bool = False,
    run_python: bool = False,
) -> None:
    """Read a log of an axis: intervals that hold for its parameters, and whether it contradicts δ.

    The exit code is 3 if it does. Example: jaxid identify slide.toml run1.csv --out run1

    Args:
        axis: the file that describes it; its table [log] says which column is what.
        log: CSV, MAT or HDF5, of a motion that was designed or of any other.
        out: the folder for the result and a picture of what least squares leaves.
        force: replace files that are there.
        run_python: run the module that the file of the axis names.
    """
    require_writable(out, IdentifyResult.names, replace=force)
    known = read_axis(axis, run_python=run_python)
    recorded = read_log(log, _columns(axis, known))
    with tqdm(bar_format="{desc} ({elapsed})", leave=False) as line:
        found = identify_axis(known, recorded, line.set_description)
    _finish(out, IdentifyResult(found, sha256_of(log)), force)
    if found.result is None:
        raise SystemExit(CONTRADICTED)


def main(arguments: list[str] | None = None) -> None:
    """What the command runs; errors are sentences, and their exit code is 1."""
    configure()
    try:
        tyro.extras.subcommand_cli_from_dict(
            {
                "init": init,
                "prior": prior,
                "design": design,
                "simulate": simulate,
                "identify": identify,
                "sweep": sweep,
            },
            prog="jaxid",
            description=_DESCRIPTION,
            args=arguments,
        )
    except (ValueError, OSError) as error:
        print(f"jaxid: {error}", file=sys.stderr)
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        print("jaxid: stopped; nothing was left half-written", file=sys.stderr)
        raise SystemExit(130) from None


def _columns(path: Path, axis: Axis) -> Columns:
    if axis.columns is None:
        raise ValueError(f"File {path} must say in a table [log] which column is what: jaxid init.")
    return axis.columns


def _tell_changed(path: Path, designs: Iterable[SavedDesign], axis: Axis) -> None:
    """Of motions whose numbers are not of this axis."""
    for folder in of_another_axis(designs, axis):
        print(f"{folder} was designed for another axis file than {path} is now: see design.json.")


def _finish(folder: Path, result: Result, replace: bool) -> None:
    """Write a result and print it, even if it is refused by now: it may have taken long."""
    try:
        write(folder, result, replace=replace)
    finally:
        print(result.text())
    print(f"Written to {folder}: {', '.join(result.names)}")
