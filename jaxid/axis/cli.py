"""The `jaxid` command: it parses arguments, calls the library and prints results."""

import shlex
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

import tyro
from tqdm import tqdm

from jaxid._checks import require
from jaxid.axis.design import ALL, design_axis
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import Axis, Coordinate, example, read_axis
from jaxid.axis.guide import guide_page
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
from jaxid.axis.wording import in_words_of_files
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
INCONSISTENT = 3  # exit code
_DESCRIPTION = (
    "Optimal experiments and guaranteed parameter intervals for machine axes. The pages of `jaxid "
    "guide` explain every step. Exit codes: 0 success, 1 invalid input, 2 usage error, 3 log "
    "inconsistent with the model, 130 interrupted."
)
EFFORTS = {"usual": Effort(), "quick": _QUICK}

AxisFile = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="AXIS")]
LogFile = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG")]
DesignFolder = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DESIGN")]
OutputFolder = Annotated[Path, tyro.conf.arg(metavar="FOLDER")]
Seconds = Annotated[
    tuple[float, ...],
    tyro.conf.arg(metavar="SECONDS", help_behavior_hint="(default: that of the axis file)"),
]


def guide(page: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PAGE")] = "") -> None:
    """Print a page of the guide; without a page, the list of pages.

    Example: jaxid guide tutorial. The log of the tutorial: jaxid guide jog.csv > jog.csv

    Args:
        page: name of the page.
    """
    print(guide_page(page), end="")


def init(axis: AxisFile, coordinate: Coordinate = "linear", force: bool = False) -> None:
    """Write an example axis file with comments, to be edited.

    Example: jaxid init slide.toml

    Args:
        axis: axis file to write.
        coordinate: kind of axis: linear (m) or rotary (rad).
        force: overwrite an existing file.
    """
    require(force or not axis.exists(), f"{axis} already exists; use --force to overwrite.")
    write_bytes(axis, example(coordinate).encode())
    words = shlex.join(["jaxid", "design", str(axis), "--out", str(axis.with_suffix(""))])
    print(f"Wrote {axis}. Edit it to describe your axis, then run: {words}")


def prior(axis: AxisFile, log: LogFile, run_python: bool = False) -> None:
    """Propose prior intervals of the parameters and a disturbance bound δ, from a log.

    Any motion will do, such as a jog in both directions. Example: jaxid prior slide.toml jog.csv

    Args:
        axis: axis file; its prior intervals and its table [disturbance] are not used.
        log: log file: CSV, MAT or HDF5.
        run_python: run the Python module that the axis file names.
    """
    known = read_axis(axis, run_python=run_python)
    print(propose(known, read_log(log, _columns(axis, known))).text())


def design(
    axis: AxisFile,
    out: OutputFolder,
    target: Annotated[tuple[str, ...], tyro.conf.arg(metavar="TARGET")] = (ALL,),
    durations: Seconds = (),
    seed: int = 0,
    effort: Literal["usual", "quick"] = "usual",
    force: bool = False,
    run_python: bool = False,
) -> None:
    """Design the optimal identification motion of an axis, and export it as set-points.

    Example: jaxid design slide.toml --out slide

    To compare durations and targets:
    jaxid design slide.toml --out choice --target all M --durations 0.5 0.6 1.2

    Args:
        axis: axis file.
        out: output folder for the motion as CSV, MAT and C header, its predicted errors and a
            picture. Several motions get a folder each, and a table and a picture that compare them.
        target: what to minimise: a parameter name (the error of this parameter); all (the largest
            optimality gap of all parameters); or wanted (the largest error relative to the
            accuracies in the table [wanted]).
        durations: durations of the motions, s.
        seed: seed of the random search.
        effort: effort of the search; quick is a shorter one, whose errors are larger: compare their
            optimality gaps.
        force: overwrite existing files.
        run_python: run the Python module that the axis file names.
    """
    require(target, "--target must be a parameter name, all or wanted, but is empty.")
    known = read_axis(axis, run_python=run_python)
    target = tuple(dict.fromkeys(target))
    times = tuple(dict.fromkeys(durations)) or (known.task.intervals * known.task.period,)
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
    axis: AxisFile,
    design: DesignFolder,
    plants: int = 200,
    logs: int = 10,
    seed: int = 0,
    force: bool = False,
    run_python: bool = False,
) -> None:
    """Simulate the closed loop for random plants from the prior box, and report limit violations.

    Example: jaxid simulate slide.toml slide

    Args:
        axis: axis file; its table [controller] gives the controller.
        design: folder of `jaxid design`, into which the results are written.
        plants: number of random plants.
        logs: number of simulated logs that are also identified, at most --plants.
        seed: seed of the random plants and disturbances.
        force: overwrite existing files.
        run_python: run the Python module that the axis file names.
    """
    known = read_axis(axis, run_python=run_python)
    saved = read_design(design, known.system.coordinate)
    require_writable(design, SimulateResult.names, replace=force)
    with tqdm(bar_format="{desc} ({elapsed})", leave=False) as line:
        found = simulate_axis(known, saved.motion, plants, logs, seed, line.set_description)
    _tell_changed(axis, [saved], known)
    _finish(design, SimulateResult(found, saved.part.digest), force)


def sweep(
    axis: AxisFile,
    design: DesignFolder,
    bandwidths: tuple[float, ...] = BANDWIDTHS,
    factors: tuple[float, ...] = FACTORS,
    plants: int = 3,
    seed: int = 0,
    force: bool = False,
    run_python: bool = False,
) -> None:
    """Simulate closed loops for many filters, feedback gains and motions, as one data set.

    An interrupted sweep continues where it stopped. Example: jaxid sweep slide.toml choice

    Args:
        axis: axis file; its table [controller] gives the controller.
        design: folder of `jaxid design`, for one motion or for several.
        bandwidths: bandwidths of the first-order filter of input and regressors, rad/s.
        factors: factors of the feedback gains.
        plants: number of random plants, in addition to the centre of the prior box, its lowest and
            its highest θ.
        seed: seed of the random plants and disturbances.
        force: overwrite existing files.
        run_python: run the Python module that the axis file names.
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
    if found is None:  # only the first process has the result
        return
    _tell_changed(axis, saved.designs.values(), known)
    try:
        _finish(design, SweepResult(found), force)
    except ValueError:  # another run has written its result: the blocks are no longer needed
        forget_blocks(design)
        raise
    forget_blocks(design)


def identify(
    axis: AxisFile,
    log: LogFile,
    out: OutputFolder,
    force: bool = False,
    run_python: bool = False,
) -> None:
    """Compute guaranteed parameter intervals from a log, after a test of its consistency with δ.

    The exit code is 3 if the log is inconsistent. Example: jaxid identify slide.toml run1.csv --out
    run1

    Args:
        axis: axis file; its table [log] names the columns of the log.
        log: log file of a designed or any other motion: CSV, MAT or HDF5.
        out: output folder for result.json and a plot of the least-squares residual.
        force: overwrite existing files.
        run_python: run the Python module that the axis file names.
    """
    require_writable(out, IdentifyResult.names, replace=force)
    known = read_axis(axis, run_python=run_python)
    recorded = read_log(log, _columns(axis, known))
    with tqdm(bar_format="{desc} ({elapsed})", leave=False) as line:
        found = identify_axis(known, recorded, line.set_description)
    _finish(out, IdentifyResult(found, sha256_of(log)), force)
    if found.result is None:
        raise SystemExit(INCONSISTENT)


def main(arguments: list[str] | None = None) -> None:
    """Run the `jaxid` command.

    Errors are printed as sentences. The exit code is 1 for invalid input, 2 for a usage error, 3
    for an inconsistent log, 130 if the command is interrupted.

    Args:
        arguments: words of the command line without the program; default those of this process.

    Raises:
        SystemExit: with the exit code, if the command fails or only prints its help.
    """
    configure()
    try:
        tyro.extras.subcommand_cli_from_dict(
            {
                "guide": guide,
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
            config=(tyro.conf.FlagCreatePairsOff,),
        )
    except FileNotFoundError as error:
        place = Path.cwd() if error.filename is None else Path(error.filename).absolute().parent
        print(
            f"jaxid: there is no file {Path(error.filename or '?').name} in {place}.",
            file=sys.stderr,
        )
        raise SystemExit(1) from None
    except (ValueError, OSError) as error:
        print(f"jaxid: {in_words_of_files(str(error))}", file=sys.stderr)
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        print("jaxid: interrupted; no file was left half-written", file=sys.stderr)
        raise SystemExit(130) from None


def _columns(path: Path, axis: Axis) -> Columns:
    if axis.columns is None:
        raise ValueError(
            f"File {path} has no table [log]. Add one that names the columns of position and "
            "input; the file that `jaxid init` writes has an example."
        )
    return axis.columns


def _tell_changed(path: Path, designs: Iterable[SavedDesign], axis: Axis) -> None:
    """Print which motions were designed for another axis file."""
    for folder in of_another_axis(designs, axis):
        print(f"Warning: {path} has changed since the design in {folder} was made.")


def _finish(folder: Path, result: Result, replace: bool) -> None:
    """Write a result and print it; it is also printed if it cannot be written."""
    try:
        write(folder, result, replace=replace)
    finally:
        print(result.text())
    print(f"Wrote to {folder}: {', '.join(result.names)}")
