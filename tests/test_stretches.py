"""A log read stretch by stretch: truths inside, nothing wider than from a stretch alone."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.identification import batches as room
from jaxid.identification.batches import most_telling, prove, rounded_down, stretches
from jaxid.identification.feasible_parameter_set import MOST
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import log_of, run
from jaxid.loop.log import Log
from jaxid.loop.sensors import Encoder
from jaxid.model.disturbance_bound import ConstantBound

TRUTH = np.array(motor.TRUE_PARAMETERS)
PERIOD = motor.CONTROL_PERIOD


@pytest.fixture(scope="module")
def parts(figures):
    """Four logs of 749 ticks, cut from one of the motor."""
    motion = read_trajectory(figures / "trajectory_minimax.csv")
    encoder = Encoder(motor.ENCODER_RESOLUTION)
    _, signals = run(motor.plant(), motor.controller(), encoder, motion, PERIOD)
    whole = log_of(signals, encoder, PERIOD)
    return [cut(whole, first, 749) for first in range(0, 2996, 749)]


def cut(log, first, ticks):
    input, position = log.input[first : first + ticks], log.position[first : first + ticks + 1]
    return Log(input, position, log.period, log.resolution)


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Stretches and weights a fifth and a third of the usual."""
    monkeypatch.setattr(room, "STRETCH", 1500)
    monkeypatch.setattr(room, "_KNOTS", 300)
    monkeypatch.setattr(room, "_TOGETHER", 900)


def test_logs_are_read_as_many_together_as_are_a_stretch(parts):
    assert [len(part) for part in stretches(parts)] == [2, 2]
    assert [log for part in stretches(parts) for log in part] == parts
    assert [len(part) for part in stretches([*parts, cut(parts[0], 0, 3)])] == [2, 2, 1]
    many = [cut(parts[0], k, 4) for k in range(250)]
    assert [len(part) for part in stretches(many)] == [100, 100, 50]


def test_stretches_prove_what_the_whole_does(parts, monkeypatch):
    told = []
    found = prove(motor.system(), parts, told.append)
    assert found.contradiction is None
    assert (found.stretches, found.coarse) == (2, pytest.approx(1498 / 300))
    assert told[0] == "stretch 1 of 2: smallest δ that explains it"
    estimate = found.estimate
    for lower, upper in ((estimate.lower, estimate.upper), (found.lower, found.upper)):
        assert np.all((lower <= TRUTH) & (upper >= TRUTH))
    assert np.all((found.lower >= estimate.lower) & (found.upper <= estimate.upper))
    # no wider than either half alone
    monkeypatch.setattr(room, "STRETCH", 10_000)
    for half in (parts[:2], parts[2:]):
        alone = prove(motor.system(), half)
        assert np.all((found.lower >= alone.lower - 1e-9) & (found.upper <= alone.upper + 1e-9))
    whole = prove(motor.system(), parts)
    assert whole.stretches == 1
    widths = (found.upper - found.lower) / (whole.upper - whole.lower)
    assert np.all(widths < 1.01), widths
    # without reading both together too, what only they tell apart remains untold
    monkeypatch.setattr(room, "STRETCH", 1500)
    monkeypatch.setattr(room, "WHOLE", 2000)
    apart = prove(motor.system(), parts)
    assert np.all((apart.lower <= TRUTH) & (apart.upper >= TRUTH))
    widths = (apart.upper - apart.lower) / (whole.upper - whole.lower)
    assert np.all(widths < 1.5), widths
    assert np.any(widths > 1.1), widths


def test_one_bad_stretch_contradicts_the_axis(parts):
    """0.6 V more for a while, which no δ of 0.25 V explains; the factor is that of this stretch."""
    first, second, third, last = parts
    pushed = Log(third.input.at[300:600].add(0.6), third.position, PERIOD, third.resolution)
    found = prove(motor.system(), [first, second, pushed, last])
    assert found.estimate is None
    assert "times δ or more would be needed" in found.contradiction
    alone = prove(motor.system(), [pushed, last])
    assert found.factor == pytest.approx(alone.factor, rel=2e-3)
    assert found.factor > 1.0


def test_stretches_that_contradict_one_another(parts, monkeypatch):
    """Each log alone has a plant of the box, but the second one another mass."""
    system, heavy = motor.system(), 1.45

    def scaled(log, factor):
        return Log(factor * log.input, log.position, PERIOD, log.resolution)

    other = [scaled(log, heavy) for log in parts[:2]]
    assert prove(system, other).contradiction is None
    found = prove(system, [*parts[:2], *other])
    assert found.estimate is None
    # what both together would take, though neither by itself takes more than δ
    assert found.factor > 1.0
    assert "times δ or more would be needed" in found.contradiction
    # of a log that is too long to be read together, no more than that is said
    monkeypatch.setattr(room, "STRETCH", 800)
    monkeypatch.setattr(room, "WHOLE", 1500)
    apart = prove(system, [parts[1], parts[0], *other])
    assert apart.estimate is None
    assert apart.factor <= found.factor * 1.001
    said = "Nothing within the box and δ can have left all of the first"
    assert apart.factor > 1.0 or said in apart.contradiction
    assert "at least" not in apart.contradiction


def test_what_one_stretch_tells_apart_is_told_apart(parts):
    """A stretch at one speed leaves M unseen; another one does not."""
    n, speed = 1200, 0.5
    u = jnp.full(n, TRUTH[1] * speed + TRUTH[2] + TRUTH[3])
    y = jnp.round((0.1 + speed * PERIOD * jnp.arange(n + 1)) / 1e-6) * 1e-6
    slow = Log(u, y, PERIOD, 1e-6)
    assert "M" in prove(motor.system(), [slow]).unseen
    found = prove(motor.system(), [slow, *parts[:2]])
    assert found.stretches == 2
    assert not found.unseen


def at_speed(speed):
    """400 ticks of the motor without acceleration."""
    u = jnp.full(400, TRUTH[1] * speed + TRUTH[2] + TRUTH[3])
    y = jnp.round(speed * PERIOD * jnp.arange(401) / 1e-6) * 1e-6
    return Log(u, y, PERIOD, 1e-6)


def test_what_only_two_stretches_together_tell_apart_is_told_apart(monkeypatch):
    """Two speeds tell friction from damping; one of them alone does not."""
    monkeypatch.setattr(room, "STRETCH", 500)
    box = motor.system()
    small = eqx.tree_at(lambda s: s.disturbance_bound, box, ConstantBound(0.02))
    slow, fast = at_speed(0.2), at_speed(1.5)
    assert "B" in prove(small, [slow]).unseen
    assert "B" in prove(small, [fast]).unseen
    found = prove(small, [slow, fast])
    assert found.stretches == 2
    assert "B" not in found.unseen
    assert "M" in found.unseen
    # also of a log that is too long to be read together, by the stretches that tell most
    monkeypatch.setattr(room, "WHOLE", 900)
    longer = [at_speed(v) for v in (0.2, 0.21, 0.2, 1.5, 0.2, 1.4)]
    chosen = most_telling(small, [[log] for log in longer])
    assert len(chosen) == 2
    assert sum(log is longer[3] for log in chosen) == 1
    found = prove(small, longer)
    assert found.stretches == 6
    assert "B" not in found.unseen


def test_short_pieces_take_no_weights_from_a_long_one(parts, monkeypatch):
    """A log of 749 ticks beside 60 pieces of 10: its intervals are as narrow as without them."""
    monkeypatch.setattr(room, "_KNOTS", 150)
    long, pieces = parts[0], [cut(parts[1], 10 * k, 10) for k in range(60)]
    alone, beside = prove(motor.system(), [long]), prove(motor.system(), [long, *pieces])
    assert beside.stretches == 1
    assert beside.coarse == pytest.approx(1349 / (83 + 60 * 2))
    widths = (beside.estimate.upper - beside.estimate.lower) / (
        alone.estimate.upper - alone.estimate.lower
    )
    assert np.all(widths < 1.01), widths


def test_what_no_disturbance_explains_is_a_contradiction(parts):
    """An input of the wrong sign and unit."""
    first = parts[0]
    wrong = Log(-1e4 * first.input, first.position, PERIOD, first.resolution)
    for logs in ([wrong], [*parts[:2], wrong]):
        found = prove(motor.system(), logs)
        assert found.factor == MOST
        assert found.estimate is None
        assert "1000 times δ or more would be needed: an input, a unit or a sign must be wrong" in (
            found.contradiction
        )


def test_what_is_needed_at_least_is_rounded_down():
    assert rounded_down(1.2399) == pytest.approx(1.23)
    assert rounded_down(0.0129999) == pytest.approx(0.0129)
    assert rounded_down(1.0) == 1.0
