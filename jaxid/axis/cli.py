"""The `jaxid` command: it parses arguments, calls the library and prints results."""

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
    """Write an example axis file with comments, to be edited.

    Example: jaxid init slide.toml

    Args:
        axis: axis file to write.
        coordinate: kind of axis: linear (m) or rotary (rad).
        force: replace an existing file.
    """
    require(force or not axis.exists(), f"{axis} would be replaced: allow it with --force.")
    write_bytes(axis, example(coordinate).encode())
    print(f"{axis} describes an example: change it into your axis, then: jaxid design {axis}")


def prior(
    axis: tyro.conf.Positional[Path], log: tyro.conf.Positional[Path], run_python: bool = False
) -> None:
    """Propose prior intervals of the parameters and a disturbance bound δ from a log.

    Any motion will do, such as a jog. Example: jaxid prior slide.toml jog.csv

    Args:
        axis: axis file; its prior intervals and its disturbance bound are not used.
        log: log file: CSV, MAT or HDF5.
        run_python: run the Python module that the axis file names.
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
    """Design the optimal identification motion of an axis, and export it as set-points.

    Example: jaxid design slide.toml --out slide

    To compare durations and targets:
    jaxid design slide.toml --out choice --target all M --horizons 0.5 0.6 1.2

    Args:
        axis: axis file.
        out: output folder for the motion as CSV, MAT and C header, its predicted errors and a
            picture; of several motions, for one folder each, with a table and a picture that
            compare them.
        target: what to minimise: the error of one parameter, by its name; all: the largest error
            relative to its lower bound; or wanted: the largest error relative to the accuracies in
            the table [wanted].
        horizons: durations of the motions in s, instead of the one in the axis file.
        seed: seed of the random search.
        effort: effort of the search; quick takes a tenth of the time, and is a few per cent worse.
        force: replace existing files.
        run_python: run the Python module that the axis file names.
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
    """Simulate the closed loop of random axes from the prior box along a designed motion.

    Example: jaxid simulate slide.toml slide

    Args:
        axis: axis file; its table [controller] gives the controller.
        design: folder of `jaxid design`, into which the results are written.
        plants: number of random axes.
        logs: number of these axes whose logs are also identified, at most --plants.
        seed: seed of the random axes and disturbances.
        force: replace existing files.
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
    axis: tyro.conf.Positional[Path],
    design: tyro.conf.Positional[Path],
    bandwidths: tuple[float, ...] = BANDWIDTHS,
    factors: tuple[float, ...] = FACTORS,
    plants: int = 3,
    seed: int = 0,
    force: bool = False,
    run_python: bool = False,
) -> None:
    """Simulate closed loops with many filters, gains and motions, as one data set.

    An interrupted sweep continues where it stopped. Example: jaxid sweep slide.toml choice

    Args:
        axis: axis file; its table [controller] gives the controller.
        design: folder of `jaxid design`, for one motion or for several.
        bandwidths: bandwidths of the first-order filter of input and regressors, rad/s.
        factors: factors of the feedback gains.
        plants: number of random axes, beside the centre of the prior box, its lowest and its
            highest θ.
        seed: seed of the random axes and disturbances.
        force: replace existing files.
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
    """Compute guaranteed parameter intervals from a log, and test whether it is consistent with δ.

    The exit code is 3 if it is not. Example: jaxid identify slide.toml run1.csv --out run1

    Args:
        axis: axis file; its table [log] names the columns of the log.
        log: log file of a designed or any other motion: CSV, MAT or HDF5.
        out: output folder for the result and a picture of the least-squares residual.
        force: replace existing files.
        run_python: run the Python module that the axis file names.
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
    """Print which motions were designed for another axis file."""
    for folder in of_another_axis(designs, axis):
        print(f"{folder} was designed for another axis file than {path} is now: see design.json.")


def _finish(folder: Path, result: Result, replace: bool) -> None:
    """Write a result and print it, even if it cannot be written: it may have taken long."""
    try:
        write(folder, result, replace=replace)
    finally:
        print(result.text())
    print(f"Written to {folder}: {', '.join(result.names)}")
