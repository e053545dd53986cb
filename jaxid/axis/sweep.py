"""Closed loops of an axis from a file: motions, gains and scenarios, filtered with many bandwidths.

They give the least-squares errors by filter, controller and plant: the study of the paper, for the
user's own axis. Guaranteed intervals from a log are computed in `jaxid.axis.identify`.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from jaxid._checks import require
from jaxid.axis.defaults import BANDWIDTHS, FACTORS
from jaxid.axis.design import played
from jaxid.axis.file import Axis
from jaxid.axis.saved_designs import SavedDesign, SavedDesigns
from jaxid.loop.controllers import ARC, Controller, undelayed
from jaxid.loop.disturbances import AgainstTracking, RandomForce
from jaxid.loop.scenarios import mixed
from jaxid.runtime import processors
from jaxid.sweep import blocks
from jaxid.sweep.dataset import Labels, labelled
from jaxid.sweep.grid import Grid, Swept, grid, item


class Sweep(NamedTuple):
    """Simulated closed loops with every motion of a folder of designs.

    Attributes:
        axis: axis from a file.
        saved: designs whose motions were simulated.
        data: results as a labelled data set, with units.
    """

    axis: Axis
    saved: SavedDesigns
    data: xr.Dataset


def sweep_axis(
    axis: Axis,
    saved: SavedDesigns,
    bandwidths: Sequence[float] = BANDWIDTHS,
    factors: Sequence[float] = FACTORS,
    plants: int = 3,
    seed: int = 0,
    tell: Callable[[int, int], None] = lambda done, total: None,
) -> Sweep | None:
    """Simulate every designed motion with every factor of the gains in every scenario.

    Blocks that are done are kept beside the folder until all are, so that an interrupted sweep
    continues where it stopped. Of several processes the first returns the result, the others None.

    Args:
        axis: axis from a file with a controller.
        saved: one or several designs.
        bandwidths: bandwidths w of H_f, rad/s.
        factors: factors of the feedback gains in the file.
        plants: number of random plants, beside the centre of the prior box, its lowest and its
            highest θ.
        seed: seed of the random plants and disturbances.
        tell: function that is called with the number of blocks done and their total number.

    Raises:
        ValueError: if the axis has no controller, or an argument is invalid.
    """
    swept, labels = study(axis, saved.designs, bandwidths, factors, plants, seed)
    work, kept = blocks.Work(item, swept, swept.count), blocks_of(saved.folder)
    blocks.compute(work, kept, processors(), tell)
    if jax.process_index() > 0:
        return None
    attributes = {"title": "Closed loops: J_f, errors and extremes", "seed": seed}
    attributes["axis_sha256"] = axis.digest
    data = labelled(swept, labels, blocks.collect(work, kept), attributes)
    return Sweep(axis, saved, data)


def blocks_of(folder: Path) -> Path:
    """Return the folder of the blocks of a sweep, which is beside the folder of its designs."""
    whole = folder.resolve()
    return whole.with_name(f"{whole.name}.sweep.blocks")


def forget_blocks(folder: Path) -> None:
    """Remove the blocks of a sweep whose result is written."""
    shutil.rmtree(blocks_of(folder), ignore_errors=True)


def study(
    axis: Axis,
    designs: Mapping[str, SavedDesign],
    bandwidths: Sequence[float],
    factors: Sequence[float],
    plants: int,
    seed: int,
) -> tuple[Grid, Labels]:
    """Return the closed loops of a sweep with their names; the arguments are those of `sweep_axis`.

    Raises:
        ValueError: if the factors are not above zero or repeat, or `plants` is below zero.
    """
    motions = {
        (one.summary.target, round(float(one.motion.duration), 12)): one.motion
        for one in designs.values()
    }
    gains = [f"× {factor:g}" for factor in factors]
    for name, values in (("bandwidths", bandwidths), ("factors", factors)):
        require(
            all(0 < x < np.inf for x in values) and len({f"{x:g}" for x in values}) == len(values),
            f"--{name} must be distinct numbers above zero, but are {list(values)}.",
        )
    require(plants >= 0, f"--plants must be 0 or more, but is {plants}.")
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


def _labelled(shares: Float[Array, "k 2"]) -> dict[str, tuple[str, list[float]]]:
    texts = {"random": "share of δ drawn at random", "against": "share of δ against tracking"}
    return {name: (text, shares[:, k].tolist()) for k, (name, text) in enumerate(texts.items())}


def scenarios(
    axis: Axis, plants: int, seed: int
) -> dict[str, tuple[np.ndarray, tuple[float, float]]]:
    """Return the scenarios of a sweep by name: true parameters θ and shares of disturbance.

    The two shares of δ are those of a random and of a worst-case disturbance.

    Args:
        axis: axis from a file.
        plants: number of random plants.
        seed: seed of the random plants.
    """
    system = axis.system
    shares = np.asarray(jax.random.uniform(jax.random.key(seed), (plants, len(system.names))))
    lower, upper = np.asarray(system.lower), np.asarray(system.upper)
    return {
        "middle of the box, no Δ": (np.asarray(system.centre), (0.0, 0.0)),
        "middle, worst-case Δ": (np.asarray(system.centre), (0.0, 1.0)),
        "lowest θ, worst-case Δ": (lower, (0.0, 1.0)),
        "highest θ, worst-case Δ": (upper, (0.0, 1.0)),
        **{
            f"random θ and Δ, {k}": (lower + s * (upper - lower), (1.0, 0.0))
            for k, s in enumerate(shares, 1)
        },
    }


def scaled(controller: Controller, factor: float) -> Controller:
    """Return a controller with its feedback gains times a factor: k1, k2 of ARC, or kp, kd."""
    names = ("k1", "k2") if isinstance(undelayed(controller), ARC) else ("kp", "kd")
    return eqx.tree_at(
        lambda c: [getattr(undelayed(c), name) for name in names],
        controller,
        replace_fn=lambda gain: factor * gain,
    )
