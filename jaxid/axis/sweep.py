"""Closed loops of an axis of a file: motions, gains and scenarios, filtered with many bandwidths.

What the errors of least squares come to by filter, controller and axis: the study of the paper, for
one's own axis. It takes no guarantee from a log; that is `axis_identify`.
"""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.axis.design import designs_in, played, read_design
from jaxid.axis.file import Axis
from jaxid.io import plots
from jaxid.io.files import read_trajectory, write_dataset
from jaxid.loop.controllers import ARC, Controller, undelayed
from jaxid.loop.disturbances import AgainstTracking, RandomForce
from jaxid.loop.scenarios import mixed
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.runtime import processors
from jaxid.sweep import blocks
from jaxid.sweep.dataset import Labels, labelled, names
from jaxid.sweep.grid import Grid, Swept, grid, item

FILES = ("sweep.nc", "sweep_bound.png", "sweep_tracking.png")
BANDWIDTHS = (30.0, 100.0, 300.0, 1000.0, 3000.0)  # rad/s
FACTORS = (0.5, 1.0, 2.0)  # of the gains
_USUAL = "× 1"


def sweep_axis(
    axis: Axis,
    folder: Path,
    bandwidths: Sequence[float] = BANDWIDTHS,
    factors: Sequence[float] = FACTORS,
    plants: int = 3,
    seed: int = 0,
    tell: Callable[[int, int], None] = lambda done, total: None,
) -> xr.Dataset | None:
    """Every motion in a folder with every factor of the gains in every scenario.

    Blocks that are done are kept in the folder until all are: it goes on where it was stopped. Of
    several processes the first returns all, the others nothing.

    Args:
        axis: from a file with a controller.
        folder: of `write_design` or of `tradeoff`.
        bandwidths: w of H_f, rad/s.
        factors: of the gains of the file.
        plants: random ones of the box, beside its middle, its lowest and its highest θ.
        seed: of these and of what disturbs them.
        tell: told how many blocks are done, and of how many.

    Raises:
        ValueError: if the axis has no controller, or the folder no motion.
    """
    swept, labels = study(axis, folder, bandwidths, factors, plants, seed)
    work = blocks.Work(item, swept, swept.count)
    blocks.compute(work, folder / "sweep.blocks", processors(), tell)
    if jax.process_index() > 0:
        return None
    attributes = {"title": "Closed loops: J_f, errors and extremes", "seed": seed}
    attributes["axis_sha256"] = axis.digest
    return labelled(swept, labels, blocks.collect(work, folder / "sweep.blocks"), attributes)


def write_sweep(folder: Path, found: xr.Dataset) -> None:
    """Write `FILES`, after which no block is needed any more."""
    write_dataset(folder / FILES[0], found)
    bounds_page(folder / FILES[1], found)
    tracking_page(folder / FILES[2], found)
    shutil.rmtree(folder / "sweep.blocks", ignore_errors=True)


def study(
    axis: Axis,
    folder: Path,
    bandwidths: Sequence[float],
    factors: Sequence[float],
    plants: int,
    seed: int,
) -> tuple[Grid, Labels]:
    """What is swept, and its names; the arguments are those of `sweep_axis`."""
    motions = motions_in(folder, axis.system.coordinate)
    require(motions, f"Argument `folder`: {folder} must hold designs of jaxid design.")
    gains = [f"× {factor:g}" for factor in factors]
    require(
        min(factors, default=0.0) > 0 and len(set(gains)) == len(gains),
        f"Argument `factors` must be above zero and differ, but they are {list(factors)}.",
    )
    require(plants >= 0, f"Argument `plants` must be 0 or more, but is {plants}.")
    known = scenarios(axis, plants, seed)
    thetas, shares = (jnp.asarray(np.array(x)) for x in zip(*known.values(), strict=True))
    swept = grid(
        axis.system,
        axis.servo.sensor,
        Swept(
            [played(axis, motion) for motion in motions.values()],
            [scaled(axis.servo.delayed(axis.tracking_controller), factor) for factor in factors],
            mixed(axis.system, thetas, (RandomForce(), AgainstTracking()), shares),
            bandwidths,
        ),
        axis.servo.period,
        seed=seed,
    )
    horizons = sorted({duration for _, duration in motions})
    about = "duration of the motion without its approach", "s"
    return swept, Labels(list(motions), horizons, gains, list(known), _labelled(shares), about)


def motions_in(folder: Path, coordinate: str) -> dict[tuple[str, float], JerkTrajectory]:
    """By what they were designed for, and their duration, s."""
    found = {}
    for path in designs_in(folder):
        motion = read_trajectory(path.parent / "trajectory.csv", coordinate)
        target = str(read_design(path)["target"])
        found[target, round(float(motion.duration), 12)] = motion
    return found


def _labelled(shares: Float[Array, "k 2"]) -> dict[str, tuple[str, list[float]]]:
    texts = {"random": "share of δ drawn at random", "against": "share of δ against tracking"}
    return {name: (text, shares[:, k].tolist()) for k, (name, text) in enumerate(texts.items())}


def scenarios(
    axis: Axis, plants: int, seed: int
) -> dict[str, tuple[np.ndarray, tuple[float, float]]]:
    """True parameters, and the shares of a random force and of an adversary."""
    system = axis.system
    shares = np.asarray(jax.random.uniform(jax.random.key(seed), (plants, len(system.names))))
    lower, upper = np.asarray(system.lower), np.asarray(system.upper)
    return {
        "middle of the box, no Δ": (np.asarray(system.centre), (0.0, 0.0)),
        "middle, adversary": (np.asarray(system.centre), (0.0, 1.0)),
        "lowest θ, adversary": (lower, (0.0, 1.0)),
        "highest θ, adversary": (upper, (0.0, 1.0)),
        **{
            f"random θ and Δ, {k}": (lower + s * (upper - lower), (1.0, 0.0))
            for k, s in enumerate(shares, 1)
        },
    }


def scaled(controller: Controller, factor: float) -> Controller:
    """With its feedback gains times a factor."""
    names = ("k1", "k2") if isinstance(undelayed(controller), ARC) else ("kp", "kd")
    return eqx.tree_at(
        lambda c: [getattr(undelayed(c), name) for name in names],
        controller,
        replace_fn=lambda gain: factor * gain,
    )


def bounds_page(path: Path, found: xr.Dataset) -> None:
    """The worst J_f of each parameter over all scenarios, by motion and bandwidth."""
    parameters = names(found.parameter)
    canvas, panels = plots.figure(len(parameters), 1, (8.0, 2.4 * len(parameters)))
    for panel, name in zip(panels, parameters, strict=True):
        own = found.sel(gains=_usual(found), parameter=name)
        percent = 100 * (own.bound.max("scenario") / own.half_width)
        table = percent.stack(motion=("design", "horizon")).dropna("motion", how="all")
        rows = [f"{design}, {time:g} s" for design, time in table.motion.values]
        values = table.transpose("motion", "bandwidth").values
        plots.heat_map(panel, values, rows, names(found.bandwidth), "{:.1f}", highest=100.0)
        plots.label(panel, "", "", f"worst $J_f$ of {name}, % of half its prior interval")
    canvas.suptitle("motion by bandwidth; orange: the interval is not reduced", fontsize=12)
    panels[-1].set_xlabel("bandwidth w of the filter (rad/s)", fontsize=12)
    plots.save(canvas, path)


def tracking_page(path: Path, found: xr.Dataset) -> None:
    """Peak tracking error over gains and scenarios, at most over all motions."""
    canvas, (panel,) = plots.figure(1, 1, (9.0, 1.8 + 0.7 * found.gains.size))
    worst = found.tracking_error.max(["design", "horizon"]).transpose("gains", "scenario")
    rows, columns = names(found.gains), names(found.scenario)
    plots.heat_map(panel, worst.values, rows, columns, "{:.1e}", logarithmic=True)
    unit = found.tracking_error.attrs["units"]
    plots.label(panel, "", "gains", f"largest tracking error, {unit} (∞: the loop diverges)")
    panel.set_xticklabels(columns, rotation=25, ha="right")
    plots.save(canvas, path)


def summary(found: xr.Dataset) -> list[tuple[str, float, str, float, float, str]]:
    """For each motion and parameter the bandwidth with the least of the worst J_f, and that."""
    usual = found.sel(gains=_usual(found)).bound.max("scenario")
    rows = []
    for design in names(found.design):
        for time in found.horizon.values:
            own = usual.sel(design=design, horizon=time)
            if bool(own.isnull().all()):
                continue
            for name, unit in zip(names(found.parameter), found.unit.values, strict=True):
                best = own.sel(parameter=name)
                w = float(best.idxmin("bandwidth"))
                rows.append((design, float(time), name, w, float(best.min()), str(unit)))
    return rows


def text(found: xr.Dataset) -> str:
    """For people."""
    header = ("designed for", "duration_s", "parameter", "best w (rad/s)", "worst J_f", "unit")
    title = f"Least squares, worst of all scenarios, gains {_usual(found)}"
    table = plots.text_table(header, summary(found), title)
    count, diverged = int(found.tracking_error.count()), int(np.isinf(found.tracking_error).sum())
    loops = f"{count} closed loops, seed {found.seed}; {diverged} diverge."
    kept = found.outside.where(np.isfinite(found.tracking_error))
    misses = f"J_f is no guarantee: θ is outside of θ̂ ± J_f in {float(kept.mean()):.1%} of cases."
    return f"{table}\n{loops}\n{misses}"


def _usual(found: xr.Dataset) -> str:
    """The gains of the file, or those nearest to the beginning."""
    gains = names(found.gains)
    return _USUAL if _USUAL in gains else gains[0]
