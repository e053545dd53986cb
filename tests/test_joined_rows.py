"""Several logs together: each keeps its own errors, and their joint bounds are the smallest."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from adversaries import exact_rows
from conftest import uniform_in_box

from experiments.axes import linear_motor as motor
from jaxid.identification.assumptions import assumptions
from jaxid.identification.feasible_parameter_set import feasible_set
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.identification.joined_rows import join_rows
from jaxid.identification.modulating_functions import Program, pieces
from jaxid.identification.regression_rows import boxes, guaranteed_estimate, hats
from jaxid.identification.state_bounds import state_bounds
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import run
from jaxid.loop.disturbances import AgainstTracking, NoDisturbance, random_shares
from jaxid.loop.log import Log, filled
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant

SYSTEM = motor.system()
# resolution, m, and period, s: the logs may have different servos
SERVOS = ((0.5e-6, 0.0002), (5e-6, 0.0004))
KNOTS = 60


def logs_of(figures, theta, disturbances):
    """Return logs of the motions for M and for B, recorded by two servos."""
    found = []
    for name, (resolution, period), disturbance in zip("MB", SERVOS, disturbances, strict=True):
        motion = read_trajectory(figures / f"trajectory_{name}_N30.csv")
        plant = Plant(SYSTEM, theta, disturbance)
        found.append(run(plant, motor.controller(), Servo(period, resolution), motion).log)
    return found


@pytest.fixture(scope="module")
def logs(figures):
    return logs_of(figures, jnp.asarray(motor.TRUE_PARAMETERS), (NoDisturbance(), NoDisturbance()))


def rows(way, log):
    return way(SYSTEM, log, state_bounds(SYSTEM, log))


@pytest.mark.parametrize("way", [hats, boxes])
def test_any_weights_mean_what_they_mean_log_by_log(way, logs, key):
    """Estimate and bound of random weights are the sums over the logs.

    Weights on the padding rows between them have no effect.
    """
    parts = [rows(way, log) for log in logs]
    together = join_rows(parts)
    counts = [part.record.input.size for part in parts]
    weights = 1e-3 * jax.random.normal(key, (4, sum(counts) + 2))
    split = [weights[:, : counts[0]], weights[:, counts[0] + 2 :]]
    found = guaranteed_estimate(together, weights)
    box = SYSTEM.half_widths
    mean, bound, taken = jnp.zeros(4), jnp.zeros(4), jnp.zeros((4, 4))
    for part, own in zip(parts, split, strict=True):
        phi, u = part.record.rows.regressors, part.record.input
        mean += own @ (u - phi @ SYSTEM.centre)
        taken += own @ phi
        bound += jnp.abs(own) @ part.record.rows.delta + part.shared(own)
    bound += jnp.abs(jnp.eye(4) - taken) @ box
    np.testing.assert_allclose(found.theta, SYSTEM.centre + mean, rtol=1e-9)
    np.testing.assert_allclose(found.bound, bound, rtol=1e-8)
    n = counts[0]
    assert pieces(together.record.rows.measure) == ((0, n), (n + 2, n + 2 + counts[1]))


def test_together_they_prove_more_than_each(logs):
    """The joint bounds are no larger than the best single ones, and that of B is smaller."""
    alone = [guaranteed_intervals(SYSTEM, [log], KNOTS) for log in logs]
    together = guaranteed_intervals(SYSTEM, logs, KNOTS)
    best = jnp.minimum(*(found.estimate.bound for found in alone))
    assert np.all(together.estimate.bound <= best * (1 + 1e-6))
    assert float(together.estimate.bound[1]) < 0.998 * float(best[1])
    left = feasible_set(together.rows, [together.estimate], KNOTS)
    for found in alone:
        own = feasible_set(found.rows, [found.estimate], KNOTS)
        assert np.all(left.upper - left.lower <= (own.upper - own.lower) * (1 + 1e-6))


def test_a_lucky_log_is_not_diluted_by_others(figures):
    """The joint bounds are never larger than those of any single log.

    At this corner of the box the short log alone narrows the box 1 % more than both logs together.
    """
    theta = jnp.array([0.08, 0.0, 0.5, -0.5])
    disturbances = (AgainstTracking(10.0), AgainstTracking(-10.0))
    first, second = logs_of(figures, theta, disturbances)
    short = Log(first.input[:600], first.position[:601], first.period, first.resolution)
    for logs in ([short, second], [first, second], [second, first, short]):
        alone = [guaranteed_intervals(SYSTEM, [log], KNOTS).estimate.bound for log in logs]
        together = guaranteed_intervals(SYSTEM, logs, KNOTS).estimate.bound
        assert np.all(together <= jnp.min(jnp.stack(alone), axis=0) * (1 + 1e-9))


def test_no_truth_is_outside_of_what_they_prove_together(figures, key):
    """The motors are random, and each log has another disturbance."""
    keys = jax.random.split(key, 5)
    for own, theta in zip(
        keys, uniform_in_box(key, SYSTEM.lower, SYSTEM.upper, len(keys)), strict=True
    ):
        logs = logs_of(figures, theta, (random_shares(own, 3000), AgainstTracking(10.0)))
        found = guaranteed_intervals(SYSTEM, logs, KNOTS)
        left = feasible_set(found.rows, [found.estimate], KNOTS)
        assert np.all(jnp.abs(found.estimate.theta - theta) <= found.estimate.bound)
        assert np.all((left.lower <= theta) & (theta <= left.upper))


@pytest.mark.parametrize("seed", range(3))
def test_a_log_in_pieces_proves_nearly_what_the_whole_proves(logs, seed):
    """A log cut into six pieces gives bounds at most 1 % larger than the whole log.

    Each cut loses the hat functions across it, together 0.5 %. The pieces are padded to one length,
    so that they are compiled once.
    """
    log, random = logs[0], np.random.default_rng(seed)
    n = log.input.size
    cuts = [0, *sorted(random.choice(np.arange(2, n - 1), 5, replace=False).tolist()), n]
    pieces = [
        filled(Log(log.input[a:b], log.position[a : b + 1], log.period, log.resolution), n)
        for a, b in itertools.pairwise(cuts)
    ]
    whole = guaranteed_intervals(SYSTEM, [log]).estimate.bound
    found = guaranteed_intervals(SYSTEM, pieces, KNOTS).estimate
    assert np.all(jnp.abs(found.theta - jnp.asarray(motor.TRUE_PARAMETERS)) <= found.bound)
    assert np.all(found.bound < 1.01 * whole)


def test_a_log_of_one_tick_takes_nothing_from_another(logs):
    log = logs[0]
    one = Log(log.input[:1], log.position[:2], log.period, log.resolution)
    with_one = guaranteed_intervals(SYSTEM, [one, log], KNOTS).estimate.bound
    alone = guaranteed_intervals(SYSTEM, [log], KNOTS).estimate.bound
    # two logs are processed in more passes, each with a smaller box
    assert np.all((with_one <= alone) & (alone < with_one * (1 + 1e-5)))


def test_logs_of_two_motors_contradict_each_other(figures, logs):
    """With M = 0.1 and M = 0.122 V s²/m each log alone is consistent, the pair is not."""
    heavy = jnp.asarray(motor.TRUE_PARAMETERS).at[0].set(0.1)
    other = logs_of(figures, heavy, (NoDisturbance(), NoDisturbance()))
    pair = [rows(hats, log) for log in (logs[0], other[0])]
    for single in pair:
        feasible_set(single, knots=KNOTS)
    with pytest.raises(ValueError, match="No parameter vector of the prior box explains the data"):
        feasible_set(join_rows(pair), knots=KNOTS)


def test_each_log_has_its_own_number_of_weights(logs):
    """None means one weight per row. One number holds for every log; a tuple has one per log."""
    together = join_rows([rows(hats, log) for log in logs])
    runs = pieces(together.record.rows.measure)
    args = (np.ones((together.record.input.size, 4)), np.ones(together.record.input.size))
    noise, box = np.ones(together.record.input.size + 2), np.ones(4)
    for knots, expected in ((None, 2999 + 1499), (50, 100), ((60, 20), 80)):
        assert Program(*args, noise, box, knots, runs).delta.size == expected
    with pytest.raises(ValueError, match=r"`knots` must be .* one for each of 2 logs, but has 3"):
        Program(*args, noise, box, (1, 2, 3), runs)


def test_what_cannot_be_joined_is_refused(logs):
    with pytest.raises(ValueError, match="`parts` must have one log at least"):
        join_rows([])
    with pytest.raises(ValueError, match="`logs` must hold one log at least of two ticks"):
        guaranteed_intervals(SYSTEM, [])
    one, other = (rows(hats, log) for log in logs)
    narrow = eqx.tree_at(lambda s: s.terms[0].interval, SYSTEM, jnp.array([0.11, 0.13]))
    strange = eqx.tree_at(lambda x: x.system, other, narrow)
    for wrong in (strange, rows(boxes, logs[1]), exact_rows(SYSTEM, other.record)):
        with pytest.raises(ValueError, match="rows of one kind, made with the same system"):
            join_rows([one, wrong])
    assert join_rows([one]) is one


def test_what_several_logs_rest_on_is_said_once(logs):
    said = assumptions(SYSTEM, logs[0], logs[1], logs[0])
    assert len(said) == 4 + 2 * 2 + 1
    assert "one axis with the same parameters and the same zero of position" in said[-1]
    assert [line for line in said if "0.4 ms" in line or "2.5 µm" in line] == list(said[6:8])
    assert len(assumptions(SYSTEM, logs[0])) == 6


def test_another_log_widens_no_interval(figures):
    """The joint intervals lie inside those of each log.

    At this corner of the box, with a coarse encoder, a simpler method widened the interval of F_c
    by 39 %.
    """
    theta = jnp.array([0.18, 0.0, 0.0, -0.5])
    for number, kind in enumerate((NoDisturbance(), AgainstTracking(10.0), AgainstTracking(-10.0))):
        logs = logs_of(figures, theta, (kind, random_shares(jax.random.key(number), 3000)))
        alone = [guaranteed_intervals(SYSTEM, [log], KNOTS).estimate for log in logs]
        together = guaranteed_intervals(SYSTEM, logs, KNOTS).estimate
        for one in alone:
            assert np.all((one.lower <= together.lower) & (together.upper <= one.upper))
            assert np.all(together.bound <= one.bound)
        assert np.all((together.lower <= theta) & (theta <= together.upper))


def test_logs_of_one_servo_are_described_together():
    """Periods of segments that differ slightly, by the clock of the logger, count as one servo."""
    periods = 1e-3, 1.0004e-3, 0.9997e-3
    parts = [Log(np.zeros(9), np.zeros(10), period, 1e-6, 2e-5) for period in periods]
    said = assumptions(SYSTEM, *parts)
    assert sum("zero-order hold" in line for line in said) == 1
    assert "each sample period of 0.9997 ms to 1 ms." in " ".join(said)
    assert sum("at most 20 µs" in line for line in said) == 1
