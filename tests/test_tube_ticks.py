"""The tube of a few ticks, share by share: beside loops by hand under the worst of each."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.loop.controllers import ARC
from jaxid.loop.sensors import Encoder, IdealSensor
from jaxid.loop.tube import Tube
from jaxid.model.disturbance_bound import ConstantBound
from jaxid.model.interval_arithmetic import Range
from jaxid.model.regressors import Constant
from jaxid.model.system import System, Term
from jaxid.motion.trajectory import uniform

# of constant forces alone: in each tick the acceleration is one number
H, TICKS, K1, K2, EPSILON = 0.01, 6, 20.0, 15.0, 2.0
LOWER, UPPER = np.array([1.0, -1.0]), np.array([1.5, 1.5])
CENTRE, HALF = (UPPER + LOWER) / 2, (UPPER - LOWER) / 2
MOTION = uniform(jnp.zeros(3), jnp.full(TICKS, 300.0), H)
SHARES = np.linspace(0.0, 1.0, 9)[:, None]


def by_hand(theta, hat, delta, reach, level, q):
    """Input, and positions and velocities within each tick, of loops side by side.

    Args:
        theta: mass and offset of the axis.
        hat: those that the law takes them for.
        delta: what disturbs each loop in each tick.
        reach: how far the law allows θ̂ to be from θ.
        level: δ, that the law allows for.
        q: errors of the readings at the ticks, from the one before the first on; None for exact
            positions and velocities.
    """
    at = [np.asarray(x) for x in MOTION.states(jnp.arange(TICKS) * H)]
    y, v, before = (np.zeros(len(delta[0])) for _ in range(3))
    found = []
    for k in range(TICKS):
        read, rate = y, v
        if q is not None:
            read, rate = y + q[k + 1], (y + q[k + 1] - before - q[k]) / H
        e, e_rate = read - at[0][k], rate - at[1][k]
        wanted, p = at[2][k] - K1 * e_rate, e_rate + K1 * e
        h = reach[0] * np.abs(wanted) + reach[1] + level
        u = hat[0] * wanted + hat[1] - K2 * p - h**2 * p / (4 * EPSILON)
        a = (u - theta[1] - delta[k]) / theta[0]
        t = SHARES * H
        found.append((y + t * (v + t * a / 2), v + t * a, np.broadcast_to(u, (len(t), len(y)))))
        before, y, v = y, y + H * (v + H * a / 2), v + H * a
    return [np.stack(x) for x in zip(*found, strict=True)]


def signs(count):
    return np.array(list(itertools.product((-1.0, 1.0), repeat=count))).T


CORNERS = LOWER[:, None] + (UPPER - LOWER)[:, None] * (signs(2) + 1) / 2
INSIDE = np.array([[1.1], [0.4]])
NONE, COUNT, LEVEL = 1e-9, 2e-4, 0.5
# the cell of θ, the estimates θ̂, δ and the counts of the encoder: None for an exact sensor
SOURCES = {
    "nothing": (INSIDE, CENTRE[:, None], NONE, None),
    "encoder": (INSIDE, CENTRE[:, None], NONE, COUNT),
    "disturbance": (INSIDE, CENTRE[:, None], LEVEL, None),
    "parameters": (CORNERS, CENTRE[:, None], NONE, None),
    "estimates": (INSIDE, CORNERS, NONE, None),
}


@pytest.mark.parametrize("source", SOURCES)
def test_no_loop_by_hand_leaves_the_tube_and_the_worst_ones_fill_it(source):
    """At some tick, position and velocity to 80 %; the whole input, but for what is exact at 0."""
    thetas, hats, level, count = SOURCES[source]
    terms = (Term("m", "kg", (1.0, 1.5)), Term("d", "N", (-1.0, 1.5), Constant()))
    # an estimate that may move is anywhere in the box
    moves = source == "estimates"
    law = ARC(System(terms, ConstantBound(level)), K1, K2, EPSILON, jnp.full(2, float(moves)))
    cell = Range(*(end(thetas, axis=1)[None] for end in (np.min, np.max)))
    sensor = IdealSensor() if count is None else Encoder(count)
    position, velocity, input, _ = Tube(law, sensor, cell, H, TICKS)(MOTION)
    pushes = level * signs(TICKS)
    q = None
    if count is not None:
        q = count / 2 * signs(TICKS + 1)
        pushes = np.zeros((TICKS, q.shape[1]))
    filled = []
    for theta, hat in itertools.product(thetas.T, hats.T):
        reached = by_hand(theta, hat, pushes, (1 + moves) * HALF, level, q)
        for values, tube in zip(reached, (position, velocity, input), strict=True):
            lower, upper = (np.asarray(end)[:, None, None] for end in tube)
            assert np.all((lower <= values) & (values <= upper))
            away = np.abs(values - (upper + lower) / 2) / ((upper - lower) / 2)
            filled.append(np.max(away, axis=(1, 2)))
    most = np.max(np.reshape(filled, (-1, 3, TICKS)), axis=0)
    assert source == "nothing" or np.all(np.max(most, axis=1) > 0.85), most
