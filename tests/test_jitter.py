"""Logs with jitter: state bounds and intervals from them contain the true states and parameters."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.identification.assumptions import assumptions
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.identification.state_bounds import state_bounds
from jaxid.io.setpoints import sampled
from jaxid.loop.log import Log
from jaxid.loop.scenarios import random_parameters

H, Q = 0.001, motor.ENCODER_RESOLUTION
PLANTS, STEPS = 12, 20


def experiments(key, motion, jitter):
    """Return logs of random plants with a random disturbance, and the true states.

    The loop is written here, since the simulation of the library has no jitter: classical
    Runge-Kutta steps from one instant τ_k to the next. Half of the plants have instants anywhere
    within the jitter, half of them only at its ends.
    """
    theta = np.asarray(random_parameters(key, motor.system(), PLANTS)).T
    wanted = sampled(motion, H)
    n, random = len(wanted.time) - 1, np.random.default_rng(0)
    shares = random.uniform(-1.0, 1.0, (n + 1, PLANTS))
    shares[:, ::2] = np.sign(shares[:, ::2])
    instants = wanted.time[:, None] + jitter * shares
    disturbed = random.uniform(-1.0, 1.0, (n, PLANTS))

    def slope(y, v, u, share):
        delta = share * np.where(np.abs(v) < 0.1, 0.25, 0.15)  # δ of the motor
        friction = theta[1] * v + theta[2] * 2 / np.pi * np.arctan(1000.0 * v)
        return v, (u - friction - theta[3] - delta) / theta[0]

    y, v = (np.zeros(PLANTS) for _ in range(2))
    reads, inputs, times, speeds = [], [], [], []
    previous = wanted.position[0]
    for k in range(n + 1):
        read = Q * np.round(y / Q)
        rate, previous = (read - previous) / H, read
        ahead = 0.13 * wanted.acceleration[k] + 0.25 * wanted.velocity[k]
        u = ahead + 300.0 * (wanted.position[k] - read) + 8.0 * (wanted.velocity[k] - rate)
        reads.append(read)
        inputs.append(np.clip(u, -10.0, 10.0))
        if k == n:
            break
        h = (instants[k + 1] - instants[k]) / STEPS
        for step in range(STEPS):
            arguments = inputs[-1], disturbed[k]
            a = slope(y, v, *arguments)
            b = slope(y + h / 2 * a[0], v + h / 2 * a[1], *arguments)
            c = slope(y + h / 2 * b[0], v + h / 2 * b[1], *arguments)
            d = slope(y + h * c[0], v + h * c[1], *arguments)
            y, v = (x + h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]) for i, x in enumerate((y, v)))
            times.append(instants[k] + (step + 1) * h)
            speeds.append(v)
    return theta.T, np.array(reads).T, np.array(inputs).T, np.array(times).T, np.array(speeds).T


def log_of(read, input, jitter):
    """Return the log without its first and last sample.

    With jitter, their inputs act in the neighbouring sample periods; they are given as `outer`.
    """
    return Log(
        jnp.asarray(input[1:-2]),
        jnp.asarray(read[1:-1]),
        H,
        Q,
        jitter,
        jnp.asarray(input[[0, -2]]),
    )


# left: limit of half-width / prior half-width of M; measured: 0.072, 0.083 and 0.217
@pytest.mark.parametrize(("share", "left"), [(1e-4, 0.08), (1e-2, 0.1), (0.1, 0.25)])
def test_what_is_proved_of_a_log_with_jitter_is_true(motion, key, share, left):
    jitter, system = share * H, motor.system()
    lengths = []
    for theta, read, input, times, speeds in zip(*experiments(key, motion, jitter), strict=True):
        log = log_of(read, input, jitter)
        velocity = state_bounds(system, log).velocity
        tick = np.floor(times / H).astype(int) - 1
        inside = (tick >= 0) & (tick < log.input.size)
        low, high = (np.asarray(end)[tick[inside]] for end in velocity)
        assert np.all((low <= speeds[inside]) & (speeds[inside] <= high))
        found = guaranteed_intervals(system, [log]).estimate
        assert np.all((found.lower <= theta) & (theta <= found.upper))
        lengths.append(found.half_widths / system.half_widths)
    assert np.max(lengths, axis=0)[0] < left


@pytest.mark.parametrize("share", [1e-2, 0.1])
def test_a_log_with_jitter_that_is_read_without_it_is_refused_or_wrong(motion, key, share):
    """Without its jitter term, the bound is refuted or misses a true parameter for every plant."""
    system = motor.system()
    for theta, read, input, *_ in zip(*experiments(key, motion, share * H), strict=True):
        try:
            found = guaranteed_intervals(system, [log_of(read, input, 0.0)]).estimate
        except ValueError:
            continue
        assert not np.all((found.lower <= theta) & (theta <= found.upper))


def test_jitter_costs_nothing_where_there_is_none_and_is_said_otherwise(motion, key):
    _, read, input, *_ = experiments(key, motion, 0.0)
    log = log_of(read[0], input[0], 0.0)
    plain = eqx.tree_at(lambda x: x.outer, log, None)
    one, other = (guaranteed_intervals(motor.system(), [x]).estimate.bound for x in (log, plain))
    assert np.array_equal(one, other)
    assert not any("deviate" in sentence for sentence in assumptions(motor.system(), log))
    late = eqx.tree_at(lambda x: x.jitter, log, jnp.asarray(2e-5))
    assert any(
        "deviate from equal spacing by at most 20 µs" in x
        for x in assumptions(motor.system(), late)
    )
    with pytest.raises(ValueError, match=r"`jitter` of a log must be 0.1 of its period at most"):
        log_of(read[0], input[0], 0.11 * H)
