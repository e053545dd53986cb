"""Regression rows of a log: every term of their bound is attained by a worst case, not exceeded."""

import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.identification.regression_rows import (
    Channel,
    RegressionRows,
    boxes,
    guaranteed_estimate,
    hats,
    upper_ends,
)
from jaxid.identification.state_bounds import StateBounds
from jaxid.loop.log import Log
from jaxid.loop.record import Record, Rows
from jaxid.model.disturbance_bound import SpeedBand
from jaxid.model.interval_arithmetic import Range, around
from jaxid.model.regressors import Coulomb, Sine, Viscous
from jaxid.model.system import System, Term

H, N = 0.01, 9
SYSTEM = System(
    (
        Term("m", "kg", (1.0, 2.0)),
        Term("b", "N s/m", (-3.0, 0.5), Viscous()),
        Term("c", "N", (-1.0, 4.0), Coulomb(20.0)),
        Term("g", "N", (-2.5, 1.0), Sine()),
    ),
    SpeedBand(0.6, 0.2, 0.1),
)
# two worst-case patterns of the signs of reading errors
TURNS = {1: np.tile([1.0, -1.0], N)[: N + 1], 2: np.tile([1.0, 1.0, -1.0, -1.0], N)[: N + 1]}
# rows, channel, index of parameter and column, worst-case pattern of the readings
READINGS = [
    (hats, "quantised ÿ", 0, 1),
    (hats, "quantised ẏ of b", 1, 2),
    (boxes, "quantised ÿ", 0, 1),
    (boxes, "quantised ẏ of b", 1, 1),
]


def brackets(position=0.0, speed=0.0, reading=0.0):
    still = around(jnp.zeros(N))
    place, velocity = (Range(*np.broadcast_to(x, (N, 2)).T) for x in (position, speed))
    return StateBounds(place, velocity, still, jnp.full(N + 1, reading))


def log_of(position, **more):
    return Log(jnp.zeros(N), jnp.asarray(position), H, 0.0, **more)


@pytest.mark.parametrize(("rows", "name", "column", "turns"), READINGS)
def test_wrong_readings_move_a_column_by_what_its_channel_says(rows, name, column, turns):
    """The bound of the channel holds for random reading errors, and the worst case attains it."""
    wrong, most = 1e-3, float(np.max(np.abs(SYSTEM.terms[column].interval)))
    counted = []
    for signs in (TURNS[turns], *np.random.default_rng(0).choice([-1.0, 1.0], (20, N + 1))):
        true, read = np.zeros(N + 1), wrong * signs
        exact, found = (rows(SYSTEM, log_of(y), brackets(reading=wrong)) for y in (true, read))
        moved = found.record.rows.columns[column] - exact.record.rows.columns[column]
        bound = found.channels[name].worst(jnp.eye(N - 1)) / most
        counted.append(np.max(np.abs(moved) / bound))
        assert counted[-1] <= 1 + 1e-9
    assert counted[0] == pytest.approx(1.0)


SPEEDS, PLACES = (0.05, 0.3), (-0.4, 0.7)  # on both sides of the jump of δ


@pytest.mark.parametrize("rows", [hats, boxes])
def test_brackets_and_delta_count_for_as_much_as_they_can_hide(rows):
    """δ of a row is the largest effect of regressors at the ends of their ranges, of θ and of Δ."""
    found = rows(SYSTEM, log_of(np.zeros(N + 1)), brackets(PLACES, SPEEDS))
    system, (*_, friction, gravity) = SYSTEM, found.record.rows.columns
    worst = 0.0
    thetas = itertools.product((-1.0, 4.0), (-2.5, 1.0))
    for (c, g), v, y, side in itertools.product(thetas, SPEEDS, PLACES, (-1.0, 1.0)):
        here = jnp.asarray(v), jnp.asarray(y)
        delta = 0.6 if v <= 0.1 else 0.2
        of_c, of_g = (system.terms[k].regressor(here[1], here[0]) for k in (2, 3))
        rest = c * (of_c - friction) + g * (of_g - gravity) + side * delta
        worst = np.maximum(worst, np.abs(rest))
    assert np.all(worst <= found.record.rows.delta + 1e-12)
    np.testing.assert_allclose(worst, found.record.rows.delta)


@pytest.mark.parametrize("rows", [hats, boxes])
def test_inputs_that_are_not_held_as_commanded_are_part_of_delta(rows):
    """At both ends of a period, the step of the input times jitter / period is added to δ."""
    u = jnp.asarray(np.random.default_rng(0).normal(size=N))
    still, jitter = brackets(), 0.1 * H
    exact, late = (
        rows(SYSTEM, Log(u, jnp.zeros(N + 1), H, 0.0, j, jnp.zeros(2)), still).record.rows.delta
        for j in (0.0, jitter)
    )
    steps = np.abs(np.diff(np.concatenate([[0.0], u, [0.0]])))
    ticks = 0.1 * (steps[:-1] + steps[1:])
    expected = (ticks[1:] + ticks[:-1]) / 2 if rows is hats else ticks[1:]
    np.testing.assert_allclose(late - exact, expected)


def any_rows(seed):
    """Return random rows with two channels of shared errors, two matrices, and the generator."""
    random = np.random.default_rng(seed)
    columns = tuple(jnp.asarray(x) for x in random.normal(size=(4, N)))
    rows = Rows(columns, jnp.asarray(random.uniform(0.1, 1.0, N)), jnp.ones(N))
    channels = {
        str(length): Channel(
            jnp.asarray(random.normal(size=length)),
            jnp.asarray(random.uniform(0.1, 1.0, N + length - 1)),
        )
        for length in (2, 3)
    }
    record = Record(rows, jnp.zeros(N), None)
    alone = jnp.asarray(random.uniform(0.0, 0.1, N))
    return RegressionRows(SYSTEM, record, alone, channels), *random.normal(size=(2, 4, N)), random


def disturbed(logged, weights, signs, theta, size=1.0):
    """Return the rows with the input of θ, worst-case Δ and shared errors for some weights."""
    rows = logged.record.rows
    u = np.asarray(rows.regressors) @ theta + size * signs * rows.delta * np.sign(weights)
    for channel in logged.channels.values():
        wrong = signs * channel.bound * np.sign(np.convolve(weights, channel.stencil))
        u = u + size * np.convolve(wrong, channel.stencil[::-1], mode="valid")
    return eqx.tree_at(lambda x: x.record.input, logged, jnp.asarray(u))


@pytest.mark.parametrize("seed", range(5))
def test_the_bound_of_any_weights_is_reached_by_the_worst_of_everything(seed):
    """Worst-case Δ, shared errors and corner of the box attain the bound; no corner exceeds it."""
    logged, weights, _, _ = any_rows(seed)
    weights = jnp.asarray(0.1 * weights)
    rest = np.eye(4) - weights @ logged.record.rows.regressors
    centre, half = np.asarray(SYSTEM.centre), np.asarray(SYSTEM.half_widths)
    for k, sign in itertools.product(range(4), (-1.0, 1.0)):
        for corner in itertools.product((-1.0, 1.0), repeat=4):
            theta = centre + half * corner
            found = guaranteed_estimate(disturbed(logged, weights[k], sign, theta), weights)
            assert abs(found.theta[k] - theta[k]) <= found.bound[k]
        theta = centre - sign * half * np.sign(rest[k])
        found = guaranteed_estimate(disturbed(logged, weights[k], sign, theta), weights)
        assert abs(found.theta[k] - theta[k]) == pytest.approx(float(found.bound[k]), rel=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_the_upper_end_of_any_weights_is_reached_by_the_worst_of_everything(seed):
    """The weights are small, so that the upper ends differ from those of the box.

    The part due to δ is Σ|g|δ.
    """
    logged, weights, _, random = any_rows(seed)
    phi = np.asarray(logged.record.rows.regressors)
    centre, half = np.asarray(SYSTEM.centre), np.asarray(SYSTEM.half_widths)
    for g in 0.01 * weights:
        c = phi.T @ g + 0.01 * random.normal(size=4)
        theta = centre + half * np.sign(c - phi.T @ g)
        u = np.asarray(disturbed(logged, g, -1.0, theta).record.input)
        arguments = (jnp.asarray(x) for x in (g[None], u - phi @ centre, c[None]))
        end, of_delta = upper_ends(logged, *arguments)
        # centre ± half-width may differ from an end of the box in the last bit
        beyond, size = float(end[0]) - float(c @ theta), float(np.abs(c) @ half)
        assert -1e-15 <= beyond <= 1e-7 * size
        assert float(end[0]) <= c @ centre + size + 1e-15
        assert float(of_delta[0]) == pytest.approx(np.abs(g) @ np.asarray(logged.delta))
