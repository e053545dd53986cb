"""Closed loops over motions, gains and scenarios, each filtered with many bandwidths."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxid._checks import require
from jaxid._types import Scalar
from jaxid.loop.controllers import Controller
from jaxid.loop.record import Record
from jaxid.loop.scenarios import Scenarios
from jaxid.loop.sensors import Sensor
from jaxid.loop.simulate import Plant, Signals, simulate
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory, padded, reference, ticks
from jaxid.regression.estimate import least_squares_estimate
from jaxid.regression.filters import filtered

Tree = TypeVar("Tree")


class Swept(NamedTuple):
    """The lists that a sweep combines: every motion with every controller, scenario and bandwidth.

    Attributes:
        motions: motions.
        controllers: controllers, all of one class.
        scenarios: plants, with their disturbances.
        bandwidths: bandwidths w of H_f, rad/s.
    """

    motions: Sequence[JerkTrajectory]
    controllers: Sequence[Controller]
    scenarios: Scenarios
    bandwidths: Sequence[float]


class Grid(eqx.Module):
    """The closed loops of a sweep: one item per motion, controller and scenario.

    Motions, controllers and scenarios are stacked along a first axis, so that an item is given by
    indices and one compilation serves all items.

    Attributes:
        system: axis with its prior box and disturbance bound δ.
        sensor: sensor that the controllers read.
        motions: stacked motions, padded to one number of intervals.
        ticks: number of samples of each motion, run once.
        controllers: stacked controllers, all of one class.
        scenarios: plants; random disturbances are drawn for each item.
        bandwidths: bandwidths w of H_f, rad/s.
        period: sample period of the controllers, s.
        seed: seed of the random disturbances.
        repeats: number of times that each motion is run, back to back.
        size: number of samples of the longest run.
    """

    system: System
    sensor: Sensor
    motions: JerkTrajectory
    ticks: Int[Array, " motions"]
    controllers: Controller
    scenarios: Scenarios
    bandwidths: Float[Array, " w"]
    period: Scalar
    seed: Int[Array, ""]
    repeats: int = eqx.field(static=True)
    size: int = eqx.field(static=True)

    @property
    def shape(self) -> tuple[int, int, int]:
        """The numbers of motions, controllers and scenarios."""
        controllers = jax.tree.leaves(self.controllers)[0].shape[0]
        return self.ticks.size, controllers, self.scenarios.theta.shape[0]

    @property
    def count(self) -> int:
        """The number of items: motions times controllers times scenarios."""
        return math.prod(self.shape)


def grid(
    system: System,
    sensor: Sensor,
    swept: Swept,
    period: float,
    *,
    repeats: int = 1,
    seed: int = 0,
) -> Grid:
    """Return the closed loops of a sweep, stacked.

    Args:
        system: axis with its prior box and disturbance bound δ.
        sensor: sensor that the controllers read.
        swept: motions, controllers, scenarios and bandwidths.
        period: sample period of the controllers, s.
        repeats: number of times that each motion is run, back to back.
        seed: seed of the random disturbances.

    Raises:
        ValueError: if one of the lists is empty, the controllers are of different kinds, or a
            motion does not last a whole number of sample periods.
    """
    motions, controllers, scenarios, bandwidths = swept
    for name, count in (
        ("motions", len(motions)),
        ("controllers", len(controllers)),
        ("scenarios", scenarios.theta.shape[0]),
        ("bandwidths", len(bandwidths)),
    ):
        require(count > 0, f"Argument `{name}` must have at least one entry, but has none.")
    kinds = {jax.tree.structure(controller) for controller in controllers}
    require(
        len(kinds) == 1,
        "Argument `controllers` must be of one class and alike but for their numbers, but there "
        f"are {len(kinds)} kinds: sweep each kind by itself.",
    )
    lengths = [ticks(motion, period) for motion in motions]
    intervals = max(motion.jerk.size for motion in motions)
    return Grid(
        system,
        sensor,
        _stacked([padded(motion, intervals) for motion in motions]),
        jnp.asarray(lengths),
        _stacked(controllers),
        scenarios,
        jnp.asarray(bandwidths, float),
        jnp.asarray(period, float),
        jnp.asarray(seed),
        repeats,
        repeats * max(lengths),
    )


def item(grid: Grid, index: Int[Array, ""]) -> dict[str, Array]:
    """Simulate one closed loop, and return its least-squares errors for every bandwidth.

    The random disturbance depends only on the seed and the index. A loop that diverges to NaN or
    infinity has infinite errors and extremes.

    Args:
        grid: closed loops of a sweep.
        index: index of the item, from 0.

    Returns:
        `bound` (J_f), `error` |θ̂ − θ| and `outside`, whether the error exceeds its bound, each of
        shape (w, m); `tracking_error`, the peak; `lowest_` and `highest_` `position`, `velocity`
        (true, at the samples) and `input` (commanded).
    """
    motion, gains, scenario = jnp.unravel_index(index, grid.shape)
    once, scenarios = grid.ticks[motion], grid.scenarios
    theta = scenarios.theta[scenario]
    running = jnp.arange(grid.size) < grid.repeats * once
    longest = grid.size // grid.repeats
    desired = reference(_entry(grid.motions, motion), grid.period, longest, grid.repeats)
    controller = _entry(grid.controllers, gains)
    key = jax.random.fold_in(jax.random.key(grid.seed), index)
    disturbance = _entry(scenarios.disturbance, scenario).drawn(key, grid.size, controller.k1_of_p)
    plant = Plant(grid.system, theta, disturbance)
    record, signals = simulate(plant, controller, grid.sensor, desired, grid.period)
    # zero in all columns: if a loop diverges after its motion, 0·inf would be NaN
    record = jax.tree.map(lambda column: jnp.where(running, column, 0.0), record)
    return _identified(grid, record, theta) | _extremes(signals, running)


def _identified(grid: Grid, record: Record, theta: Float[Array, " m"]) -> dict[str, Array]:
    def one(w: Scalar) -> dict[str, Array]:
        """Return bound, error and misses of least squares with one bandwidth of the filter."""
        estimate = least_squares_estimate(filtered(record, w, grid.period), grid.system)
        error = jnp.abs(estimate.theta - theta)
        # tolerance for rounding of θ̂
        inside = error <= estimate.bound * (1 + 1e-9)
        finite = jnp.isfinite(estimate.bound) & jnp.isfinite(error)
        return {
            "bound": jnp.where(finite, estimate.bound, jnp.inf),
            "error": jnp.where(finite, error, jnp.inf),
            "outside": ~inside,
        }

    # one after the other: together they do not fit into the cache and take three times as long
    return jax.lax.map(one, grid.bandwidths)


def _extremes(signals: Signals, running: Bool[Array, " n"]) -> dict[str, Array]:
    """Return the extremes over the samples of the motion, including its end."""
    until_end = jnp.append(running[:1], running)
    error = signals.position[:-1] - signals.reference.position
    found = {"tracking_error": jnp.max(jnp.abs(_span(error, running)))}
    for name, values, counted in (
        ("position", signals.position, until_end),
        ("velocity", signals.velocity, until_end),
        ("input", signals.input, running),
    ):
        found[f"lowest_{name}"], found[f"highest_{name}"] = _span(values, counted)
    return found


def _span(values: Float[Array, " n"], counted: Bool[Array, " n"]) -> Float[Array, "2"]:
    """Return the smallest and largest value, infinite if any is not finite: XLA may ignore NaN."""
    lowest = jnp.min(jnp.where(counted, values, jnp.inf))
    highest = jnp.max(jnp.where(counted, values, -jnp.inf))
    finite = jnp.all(jnp.isfinite(values) | ~counted)
    return jnp.where(finite, jnp.stack([lowest, highest]), jnp.array([-jnp.inf, jnp.inf]))


def _stacked(trees: Sequence[Tree]) -> Tree:
    return jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *trees)


def _entry(tree: Tree, index: Any) -> Tree:
    return jax.tree.map(lambda leaf: leaf[index], tree)
