"""The `jaxid` command: parse, call the library, print."""

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import tyro
from tqdm import tqdm

from jaxid._checks import require
from jaxid.axis import design as axis_design
from jaxid.axis import identify as axis_identify
from jaxid.axis import prior as axis_prior
from jaxid.axis import simulate as axis_simulate
from jaxid.axis import sweep as axis_sweep
from jaxid.axis import tradeoff as axis_tradeoff
from jaxid.axis.design import ALL, design_axis, designs_in, of_another_axis
from jaxid.axis.file import Axis, Coordinate, example, read_axis
from jaxid.axis.identify import identify_axis
from jaxid.axis.prior import propose
from jaxid.axis.simulate import simulate_axis
from jaxid.axis.tradeoff import tradeoff
from jaxid.io.files import read_trajectory, write_bytes
from jaxid.io.log_file import Columns, read_log
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
    _keep([axis], force)
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
    found = propose(known, read_log(log, _columns(axis, known)))
    print(axis_prior.text(known, found))


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
    files = axis_tradeoff.FILES if several else axis_design.FILES
    _keep([out / name for name in files], force)
    with tqdm(bar_format="{desc} ({elapsed})") as line:
        search = seed, EFFORTS[effort], line.set_description
        if several:
            found = tradeoff(known, target, times, out, *search, replace=force)
        else:
            found = [design_axis(known.lasting(times[0]), target[0], *search)]
    if several:
        axis_tradeoff.write_tradeoff(out, found)
        print(axis_tradeoff.text(found))
    else:
        print(axis_design.text(found[0], axis_design.write_design(out, found[0])))
    print(f"Written to {out}: {', '.join(files)}")


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
    _keep([design / name for name in axis_simulate.FILES], force)
    known = read_axis(axis, run_python=run_python)
    motion = read_trajectory(design / "trajectory.csv", known.system.coordinate)
    with tqdm(bar_format="{desc} ({elapsed})", leave=False) as line:
        found = simulate_axis(known, motion, plants, logs, seed, line.set_description)
    axis_simulate.write_simulated(design, found)
    _tell_changed(axis, [design / "design.json"], known)
    print(axis_simulate.text(found))
    print(f"Written to {design}: {', '.join(axis_simulate.FILES)}")


def sweep(
    axis: tyro.conf.Positional[Path],
    design: tyro.conf.Positional[Path],
    bandwidths: tuple[float, ...] = axis_sweep.BANDWIDTHS,
    factors: tuple[float, ...] = axis_sweep.FACTORS,
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
    _keep([design / name for name in axis_sweep.FILES], force)
    connect(processors())
    known = read_axis(axis, run_python=run_python)
    with tqdm(unit="block") as line:

        def tell(done: int, total: int) -> None:
            line.total = total
            line.update(done - line.n)

        found = axis_sweep.sweep_axis(known, design, bandwidths, factors, plants, seed, tell)
    if found is None:  # another process has all of it
        return
    axis_sweep.write_sweep(design, found)
    _tell_changed(axis, designs_in(design), known)
    print(axis_sweep.text(found))
    print(f"Written to {design}: {', '.join(axis_sweep.FILES)}")


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
    _keep([out / name for name in axis_identify.FILES], force)
    known = read_axis(axis, run_python=run_python)
    recorded = read_log(log, _columns(axis, known))
    with tqdm(bar_format="{desc} ({elapsed})", leave=False) as line:
        found = identify_axis(known, recorded, line.set_description)
    axis_identify.write_identified(out, found)
    print(axis_identify.text(found))
    print(f"Written to {out}: {', '.join(axis_identify.FILES)}")
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


def _tell_changed(path: Path, designs: Iterable[Path], axis: Axis) -> None:
    """Of motions whose numbers are not of this axis."""
    for folder in of_another_axis([one for one in designs if one.exists()], axis):
        print(f"{folder} was designed for another axis file than {path} is now: see design.json.")


def _keep(paths: Iterable[Path], force: bool) -> None:
    """Refuse to replace what is there."""
    there = [str(path) for path in paths if path.exists()]
    require(force or not there, f"{', '.join(there)} would be replaced: allow it with --force.")
