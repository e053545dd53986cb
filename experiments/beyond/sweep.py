"""J_f and tracking over horizons, bandwidths, gains and scenarios: a data set and heat maps."""

import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import tyro
import xarray as xr
from numpy.typing import ArrayLike
from tqdm import tqdm

from experiments._support import heat_maps
from experiments.axes import linear_motor as motor
from experiments.paper.designs import STUDIED, Cell, trajectory_path
from experiments.paper.runs import BANDWIDTHS, PERIODS
from jaxid.io.datasets import read_dataset, write_dataset
from jaxid.io.files import read_trajectory
from jaxid.loop.controllers import ARC
from jaxid.loop.disturbances import AgainstTracking, RandomForce
from jaxid.loop.scenarios import mixed
from jaxid.runtime import configure, connect, processors
from jaxid.sweep import blocks
from jaxid.sweep.dataset import Labels, labelled
from jaxid.sweep.grid import Grid, Swept, grid, item

COMMAND = "python -m experiments.beyond.sweep"


@dataclass(frozen=True)
class Sweep:
    """Closed loops on the motor: motions × gains × scenarios, each filtered with every bandwidth.

    A sweep may be interrupted or killed at any time: the same command continues it. No result
    depends on the devices and processes that share the work.

    Attributes:
        out: folder for sweep.nc and the heat maps, and for finished blocks during the sweep.
        motions: folder with the trajectories of the study.
        seed: seed of the random parameters and disturbances.
        redraw: draw the sweep.nc in `out` again instead of computing it.
        toy: run a few closed loops, only to show that everything works.
        devices: number of blocks that this process computes at once; default one per processor.
        coordinator: host:port with a free port of process 0, for several processes without Slurm.
        processes: number of processes that share the work, all with one `out`; Slurm sets it.
        process_id: number of this process, from 0; Slurm sets it.
    """

    out: Path = Path("figures")
    motions: Path = Path("figures")
    seed: int = 0
    redraw: bool = False
    toy: bool = False
    devices: int | None = None
    coordinator: str | None = None
    processes: int | None = None
    process_id: int | None = None

    @property
    def file(self) -> Path:
        """The file of the data set."""
        return self.out / "sweep.nc"

    @property
    def folder(self) -> Path:
        """The folder of the finished blocks of an unfinished sweep."""
        return self.out / "sweep.blocks"

    @property
    def cells(self) -> list[Cell]:
        """The designs to sweep; infeasible ones have no motion."""
        few = slice(2 if self.toy else None)
        return [Cell(name, horizon) for name in STUDIED[few] for horizon in motor.HORIZONS[few]]


def main(options: Sweep) -> None:
    """Compute the sweep, save it, draw the heat maps, and print a summary."""
    if options.redraw:
        dataset = read_dataset(options.file)
    else:
        dataset = compute(options)
        if dataset is None:
            return
        write_dataset(options.file, dataset)
        shutil.rmtree(options.folder)
    heat_maps.draw(options.out, dataset)
    print(summary(dataset))


def compute(options: Sweep) -> xr.Dataset | None:
    """Compute this process's share of the sweep; return the data set in process 0, else None."""
    devices = options.devices or processors()
    connect(devices, options.coordinator, options.processes, options.process_id)
    swept, labels = study(options)
    work = blocks.Work(item, swept, swept.count, lanes=2 if options.toy else 8)
    first = jax.process_index() == 0
    with tqdm(desc="sweep", total=work.blocks, unit="block", disable=not first) as progress:
        blocks.compute(
            work, options.folder, devices, lambda done, _: progress.update(done - progress.n)
        )
    if not first:
        return None
    attributes = {
        "title": "Closed loops on the linear motor: J_f, errors and extremes",
        "command": shlex.join([*COMMAND.split(), *sys.argv[1:]]),
        "seed": options.seed,
        "fingerprint": work.fingerprint,
    }
    return labelled(swept, labels, blocks.collect(work, options.folder), attributes)


def summary(dataset: xr.Dataset) -> str:
    """Return a sentence on how often true parameters are outside θ̂ ± J_f, in violation of (29)."""
    loops, diverged = dataset.tracking_error.count(), np.isinf(dataset.tracking_error).sum()
    kept = dataset.outside.where(np.isfinite(dataset.tracking_error))
    return (
        f"{int(loops)} closed loops, of which {int(diverged)} diverge. In the others, θ is outside "
        f"θ̂ ± J_f in {int(kept.sum())} of {int(kept.count())} estimates of one parameter."
    )


def study(options: Sweep) -> tuple[Grid, Labels]:
    """Return the grid of the sweep, and the names along its axes."""
    paths = {cell: trajectory_path(options.motions, cell) for cell in options.cells}
    motions = {cell: read_trajectory(path) for cell, path in paths.items() if path.exists()}
    few = slice(3 if options.toy else None)
    controllers = dict(list(gains().items())[few])
    plants = dict(list(scenarios(options.seed).items())[few])
    thetas, shares = (np.array(column) for column in zip(*plants.values(), strict=True))
    parts = (RandomForce(), motor.plant().disturbance, AgainstTracking())
    swept = grid(
        motor.system(),
        motor.servo().sensor,
        Swept(
            list(motions.values()),
            list(controllers.values()),
            mixed(motor.system(), jnp.asarray(thetas), parts, jnp.asarray(shares)),
            BANDWIDTHS[few],
        ),
        motor.CONTROL_PERIOD,
        repeats=1 if options.toy else PERIODS,
        seed=options.seed,
    )
    names = [(cell.target, cell.horizon) for cell in motions]
    horizons = sorted({cell.horizon for cell in options.cells})
    return swept, Labels(names, horizons, list(controllers), list(plants), labelled_shares(shares))


def gains() -> dict[str, ARC]:
    """Return the gains of the study, and variants of them with one gain changed."""
    chosen = motor.controller()

    def with_(name: str, factor: float) -> ARC:
        return eqx.tree_at(lambda arc: getattr(arc, name), chosen, replace_fn=lambda g: g * factor)

    return {
        heat_maps.NOMINAL: chosen,
        "k₁ / 4": with_("k1", 1 / 4),
        "k₁ × 2": with_("k1", 2.0),
        "k₂ / 4": with_("k2", 1 / 4),
        "k₂ × 4": with_("k2", 4.0),
        "ε / 10": with_("epsilon", 1 / 10),
        "ε × 10": with_("epsilon", 10.0),
        "Γ = 0": with_("gamma", 0.0),
        "Γ × 10": with_("gamma", 10.0),
    }


def labelled_shares(shares: np.ndarray) -> dict[str, tuple[str, list[float]]]:
    """Return the shares of each disturbance, with descriptions for the data set."""
    kinds = {
        "own": ("share of the axis's own disturbance", 1),
        "random": ("share of δ drawn at random", 0),
        "against": ("share of δ against tracking", 2),
    }
    return {name: (text, shares[:, k].tolist()) for name, (text, k) in kinds.items()}


def scenarios(seed: int) -> dict[str, tuple[ArrayLike, ArrayLike]]:
    """Return true parameters and shares of the disturbances, by the name of the scenario."""
    system = motor.system()
    shares = np.asarray(jax.random.uniform(jax.random.key(seed), (3, len(system.names))))
    lower, upper = np.asarray(system.lower), np.asarray(system.upper)
    true, centre = motor.TRUE_PARAMETERS, np.asarray(system.centre)
    random, own, against = np.eye(3).tolist()
    return {
        "no Δ": (true, (0.0, 0.0, 0.0)),
        "cogging, friction": (true, own),
        "random Δ": (true, random),
        "worst-case Δ": (true, against),
        "centre of the box": (centre, own),
        "lowest θ, worst-case Δ": (lower, against),
        "highest θ, worst-case Δ": (upper, against),
        **{
            f"random θ and Δ, {k}": (lower + share * (upper - lower), random)
            for k, share in enumerate(shares, 1)
        },
    }


if __name__ == "__main__":
    configure()
    try:
        main(tyro.cli(Sweep))
    except KeyboardInterrupt:
        sys.exit("Interrupted: the same command goes on with the blocks that are missing.")
