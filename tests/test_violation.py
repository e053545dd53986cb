"""Violations of the limits by a motion and by an axis, against a dense sampling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.model.interval_arithmetic import Range
from jaxid.motion.limits import Boundary, Limits, Via
from jaxid.motion.trajectory import uniform
from jaxid.motion.violation import Envelope, axis_violations, worst_violation

T, WIDE = 0.1, (-1e9, 1e9)
FREE = Boundary((0.0, 0.0, 0.0), ())
QUANTITIES = ("position", "velocity", "acceleration", "jerk")


def limits(**tight):
    every = (*QUANTITIES, "input", "input_rate")
    return Limits(**{name: tight.get(name, WIDE) for name in every})


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_of_each_limit_on_either_side(quantity, side, key):
    """Random motions with extrema between their knots, and limits that are not symmetric."""
    for one in jax.random.split(key, 10):
        jerk = jax.random.uniform(one, (8,), minval=-50.0, maxval=50.0)
        motion = uniform(jnp.array([0.0, 1.0, -2.0]), jerk, T)
        times = jnp.linspace(0.0, 8 * T, 8 * 2000 + 1)
        values = dict(zip(QUANTITIES, (*motion.states(times), jerk), strict=True))[quantity]
        # one end at half of the extreme value, the other end far away
        interval = (
            (0.5 * float(values.min()), 1e4) if side == 0 else (-1e4, 0.5 * float(values.max()))
        )
        if not interval[0] < 0 < interval[1]:
            continue
        half = (interval[1] - interval[0]) / 2
        beyond = float(values.max()) - interval[1] if side else interval[0] - float(values.min())
        found = worst_violation(limits(**{quantity: interval}), FREE, motion)
        assert float(found) * half == pytest.approx(beyond, rel=1e-6)


@pytest.mark.parametrize("side", [0, 1])
def test_of_via_points_on_either_side(side):
    """The position at half-time is 0.3 below the lower or above the upper end of a via point."""
    motion = uniform(jnp.zeros(3), jnp.full(4, 6.0), 0.5)  # y = t³
    lower, upper = jnp.full(3, -jnp.inf), jnp.full(3, jnp.inf)
    via = Via(0.5, lower.at[0].set((1.3, -2.0)[side]), upper.at[0].set((2.0, 0.7)[side]))
    found = worst_violation(
        limits(position=(-10.0, 10.0)), Boundary((0.0, 0.0, 0.0), (via,)), motion
    )
    assert float(found) == pytest.approx(0.03)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("which", range(4))
def test_of_an_axis_on_either_side(which, side):
    """In the second of three samples one limit is exceeded by a quarter of its half-width."""
    tight = {"position": (-2.0, 2.0), "velocity": (-4.0, 4.0), "input": (-8.0, 8.0)}
    given = limits(**tight, input_rate=(-16.0, 16.0))
    ends = np.zeros((4, 2, 3))
    ends[which, side, 1] = (-1.25, 1.25)[side] * 2.0 ** (which + 1)
    found = axis_violations(given, Envelope(*(Range(*pair) for pair in ends)))
    worst = np.array([float(jnp.max(x)) for x in found])
    expected = np.where(np.arange(4) == which, 0.25, -1.0)
    np.testing.assert_allclose(worst, expected)
