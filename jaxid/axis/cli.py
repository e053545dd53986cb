"""The `jaxid` command: what can be typed, and its help.

The library is imported when a command runs, so that help and mistakes are answered at once.
"""

import shlex
import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro

from jaxid.axis.defaults import ALL, BANDWIDTHS, FACTORS
from jaxid.axis.texts import example, guide_page

INCONSISTENT = 3  # exit code
_DESCRIPTION = (
    "Optimal experiments and guaranteed parameter intervals for machine axes. The pages of `jaxid "
    "guide` explain every step. Exit codes: 0 success, 1 invalid input, 2 usage error, 3 log "
    "inconsistent with the model, 130 interrupted."
)
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


def init(
    axis: AxisFile, coordinate: Literal["linear", "rotary"] = "linear", force: bool = False
) -> None:
    """Write an example axis file with comments, to be edited.

    Example: jaxid init slide.toml

    Args:
        axis: axis file to write.
        coordinate: kind of axis: linear (m) or rotary (rad).
        force: overwrite an existing file.
    """
    if axis.exists() and not force:
        raise ValueError(f"{axis} already exists; use --force to overwrite.")
    from jaxid.io.files import write_bytes

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
    known = _read(axis, run_python)
    from jaxid.axis.commands import prior as command

    command.run(known, axis, log)


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
    _require_seed(seed)
    if not target:
        raise ValueError("--target must be a parameter name, all or wanted, but is empty.")
    known = _read(axis, run_python)
    from jaxid.axis.commands import design as command

    command.run(known, axis, out, target, durations, seed, effort, force=force)


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
    _require_seed(seed)
    if plants < 1 or logs < 0:
        raise ValueError(
            f"--plants must be 1 or more and --logs 0 or more, but are {plants}, {logs}."
        )
    known = _read(axis, run_python)
    from jaxid.axis.commands import simulate as command

    command.run(known, axis, design, plants, logs, seed, force=force)


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
    _require_seed(seed)
    from jaxid.runtime import configure, connect, processors

    configure()
    connect(processors())
    known = _read(axis, run_python)
    from jaxid.axis.commands import sweep as command

    command.run(known, axis, design, bandwidths, factors, plants, seed, force=force)


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
    known = _read(axis, run_python)
    from jaxid.axis.commands import identify as command

    if not command.run(known, axis, log, out, force=force):
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
    except OSError as error:
        print(f"jaxid: {_of_place(error)}", file=sys.stderr)
        raise SystemExit(1) from None
    except ValueError as error:
        from jaxid.axis.wording import in_words_of_files

        print(f"jaxid: {in_words_of_files(str(error))}", file=sys.stderr)
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        print("jaxid: interrupted; no file was left half-written", file=sys.stderr)
        raise SystemExit(130) from None


def _of_place(error: OSError) -> str:
    """Return an error of the file system as a sentence; the library has its own sentences."""
    if error.filename is None:
        return str(error)
    path = Path(error.filename)
    if isinstance(error, FileNotFoundError):
        return f"there is no file {path.name} in {path.absolute().parent}."
    return f"{path} cannot be used: {error.strerror}."


def _require_seed(seed: int) -> None:
    if not 0 <= seed < 2**63:
        raise ValueError(f"--seed must be from 0 to 2^63 − 1, but is {seed}.")


def _read(path: Path, run_python: bool):
    """Return the axis of a file; a mistake in its entries is found before JAX is imported."""
    from jaxid.axis.tables import read_tables

    read_tables(path)
    from jaxid.axis.file import read_axis
    from jaxid.runtime import configure

    configure()
    return read_axis(path, run_python=run_python)
