"""The tube of a few samples, source by source, against closed loops written by hand."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.loop.controllers import ARC
from jaxid.loop.sensors import Encoder, IdealSensor
from jaxid.loop.tube import Tube, _Cell, _within
from jaxid.model.disturbance_bound import ConstantBound, SpeedBand
from jaxid.model.interval_arithmetic import Range, exactly
from jaxid.model.regressors import Constant, Spring, Viscous
from jaxid.model.system import System, Term
from jaxid.motion.trajectory import uniform

# only constant forces: the acceleration is constant in each half of a sample period
H, TICKS, K1, K2, EPSILON = 0.01, 6, 20.0, 15.0, 2.0
LOWER, UPPER = np.array([1.0, -1.0]), np.array([1.5, 1.5])
CENTRE, HALF = (UPPER + LOWER) / 2, (UPPER - LOWER) / 2
SHARES = np.linspace(0.0, 1.0, 9)[:, None]


def motion(place):
    """Return a motion from rest at some position."""
    return uniform(jnp.array([place, 0.0, 0.0]), jnp.full(TICKS, 300.0), H)


def by_hand(place, theta, hat, delta, reach, level, q):
    """Return positions, velocities and inputs within each sample period, of several loops.

    Args:
        place: initial position.
        theta: mass and offset of the axis.
        hat: estimates that the controller uses.
        delta: disturbance of each loop in each half of a sample period.
        reach: largest |θ̂ − θ| that the controller allows for.
        level: δ that the controller allows for.
        q: reading errors at the samples, from the one before the first; None for exact
            positions and velocities.
    """
    at = [np.asarray(x) for x in motion(place).states(jnp.arange(TICKS) * H)]
    v = np.zeros(len(delta[0]))
    y = before = place + v
    found = []
    for k in range(TICKS):
        read, rate = y, v
        if q is not None:
            read, rate = y + q[k + 1], (y + q[k + 1] - before - q[k]) / H
        e, e_rate = read - at[0][k], rate - at[1][k]
        wanted, p = at[2][k] - K1 * e_rate, e_rate + K1 * e
        h = reach[0] * np.abs(wanted) + reach[1] + level
        u = hat[0] * wanted + hat[1] - K2 * p - h**2 * p / (4 * EPSILON)
        before, t = y, SHARES * H / 2
        for half in range(2):
            a = (u - theta[1] - delta[2 * k + half]) / theta[0]
            found.append(
                (y + t * (v + t * a / 2), v + t * a, np.broadcast_to(u, t.shape[:1] + y.shape))
            )
            y, v = found[-1][0][-1], found[-1][1][-1]
    return [np.stack(x).reshape(TICKS, -1, y.size) for x in zip(*found, strict=True)]


def signs(count):
    return np.array(list(itertools.product((-1.0, 1.0), repeat=count))).T


CORNERS = LOWER[:, None] + (UPPER - LOWER)[:, None] * (signs(2) + 1) / 2
INSIDE = np.array([[1.1], [0.4]])
NONE, COUNT, LEVEL = 1e-15, 2e-4, 0.5
# cell of θ, estimates θ̂, δ, resolution of the encoder (None for an exact sensor), and initial
# position: far from zero, a difference of positions loses digits
SOURCES = {
    "nothing": (INSIDE, CENTRE[:, None], NONE, None, 0.0),
    "rounding": (INSIDE, CENTRE[:, None], NONE, 0.0, 1e3),
    "encoder": (INSIDE, CENTRE[:, None], NONE, COUNT, 0.0),
    "disturbance": (INSIDE, CENTRE[:, None], LEVEL, None, 0.0),
    "parameters": (CORNERS, CENTRE[:, None], NONE, None, 0.0),
    "estimates": (INSIDE, CORNERS, NONE, None, 0.0),
}


@pytest.mark.parametrize("source", SOURCES)
def test_no_loop_by_hand_leaves_the_tube_and_the_worst_ones_fill_it(source):
    """No loop leaves the tube.

    Position, velocity and input reach 85 % of the half-width in some sample, unless rounding is the
    only source.
    """
    thetas, hats, level, count, place = SOURCES[source]
    terms = (Term("m", "kg", (1.0, 1.5)), Term("d", "N", (-1.0, 1.5), Constant()))
    # with adaptation, an estimate may be anywhere in the box
    moves = source == "estimates"
    law = ARC(System(terms, ConstantBound(level)), K1, K2, EPSILON, jnp.full(2, float(moves)))
    cell = Range(*(end(thetas, axis=1)[None] for end in (np.min, np.max)))
    sensor = IdealSensor() if count is None else Encoder(count)
    position, velocity, input, _ = Tube(law, sensor, cell, H, TICKS)(motion(place))
    pushes = level * signs(2 * TICKS)
    q = None
    if count is not None:
        q = count / 2 * signs(TICKS + 1)
        pushes = np.zeros((2 * TICKS, q.shape[1]))
    filled = []
    for theta, hat in itertools.product(thetas.T, hats.T):
        reached = by_hand(place, theta, hat, pushes, (1 + moves) * HALF, level, q)
        for values, tube in zip(reached, (position, velocity, input), strict=True):
            lower, upper = (np.asarray(end)[:, None, None] for end in tube)
            assert np.all((lower <= values) & (values <= upper))
            half = np.maximum((upper - lower) / 2, 1e-300)
            away = np.abs(values - (upper + lower) / 2) / half
            filled.append(np.max(away, axis=(1, 2)))
    most = np.max(np.reshape(filled, (-1, 3, TICKS)), axis=0)
    assert source in ("nothing", "rounding") or np.all(np.max(most, axis=1) > 0.85), most


# effects within a sample period: regressor, δ, θ, and initial y and v of a unit mass
WITHIN = {
    "friction": (Viscous(), ConstantBound(NONE), 30.0, 0.0, 1.0),
    "spring": (Spring(), ConstantBound(NONE), 900.0, 0.02, 1.0),
    "jump of δ": (Viscous(), SpeedBand(2.0, NONE, 0.5), 0.0, 0.0, 0.51),
}


@pytest.mark.parametrize("name", WITHIN)
def test_what_changes_within_a_tick_is_counted(name):
    """Exact motions with friction, with a spring, and with a δ that increases at low speed."""
    regressor, bound, theta, y, v = WITHIN[name]
    terms = (Term("m", "kg", (0.5, 2.0)), Term("k", "N", (0.0, 1e3), regressor))
    law = ARC(System(terms, bound), K1, K2, EPSILON, jnp.zeros(2))
    there = tuple(exactly(jnp.asarray(x)) for x in (1.0, theta))
    cell = _Cell(law, jnp.asarray(H), there, there, IdealSensor().error())
    u, t = (-3.0 if name == "jump of δ" else 0.0), np.linspace(0.0, H, 101)
    if name == "friction":
        speed = v * np.exp(-theta * t)
        force = -theta * speed
    elif name == "spring":
        w = np.sqrt(theta)
        speed = v * np.cos(w * t) - w * y * np.sin(w * t)
        force = -theta * (y * np.cos(w * t) + v / w * np.sin(w * t))
    else:
        speed = v + u * t
        force = np.stack([np.where(speed <= 0.5, side, 0.0) for side in (-2.0, 2.0)])
    during, acceleration, push = _within(cell, *(exactly(jnp.asarray(x)) for x in (y, v, u)))
    for found, values in ((during, speed), (acceleration, u + force), (push, force)):
        assert float(found.lower) <= np.min(values)
        assert np.max(values) <= float(found.upper)


def test_a_reading_is_within_the_error_of_its_encoder():
    """The largest reading error is half a count, and some readings attain it."""
    encoder = Encoder(COUNT)
    y = jnp.linspace(-5 * COUNT, 5 * COUNT, 1001)
    off = float(jnp.max(jnp.abs(encoder.quantise(y) - y)))
    assert off == pytest.approx(float(encoder.error().position))
