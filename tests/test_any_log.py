"""Identification from varied logs: slow and fast servos, input in A, no header, irregular rows."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.axis.file import read_axis
from jaxid.axis.identify import identify_axis
from jaxid.io.log_file import read_log
from jaxid.loop.closed_loop import run
from jaxid.loop.controllers import PDFeedforward
from jaxid.loop.disturbances import LowSpeedFriction
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant
from jaxid.motion.trajectory import uniform

TRUTH = (7.2, 21.0, 11.0, -1.5)  # kg, N s/m, N, N
NEWTONS = 25.0  # per ampere
AXIS = """
coordinate = "linear"
[input]
unit = "N"
gain = 25.0
[servo]
period = {period}
resolution = 2e-6
[[terms]]
kind = "inertia"
name = "m"
unit = "kg"
interval = [5.0, 10.0]
[[terms]]
kind = "viscous"
name = "b"
unit = "N s/m"
interval = [0.0, 60.0]
[[terms]]
kind = "coulomb"
name = "Fc"
unit = "N"
interval = [0.0, 30.0]
beta = 300.0
[[terms]]
kind = "constant"
name = "offset"
unit = "N"
interval = [-10.0, 10.0]
[disturbance]
level = 4.0
[limits]
position = [-0.2, 1.0]
velocity = [-1.5, 1.5]
input = [-8.0, 8.0]
jerk = [-400.0, 400.0]
[motion]
start = 0.0
end = 0.0
duration = {duration}
knot_period = {knot}
[log]
time = 1
position = 2
input = 3
time_unit = "ms"
position_unit = "mm"
"""


def jog(knot):
    """Return a motion there and back at about 1 m/s."""
    pattern = np.array([1, 1, -1, -1, 0, 0, -1, -1, 1, 1, -1, -1, 1, 1, 0, 0, 1, 1, -1, -1])
    return uniform(jnp.zeros(3), jnp.asarray(0.288 / knot**2 * pattern), knot)


@pytest.mark.parametrize(("rate", "knot"), [(150, 0.12), (5000, 0.012)])
def test_a_servo_of_any_rate(tmp_path, rate, knot):
    """The intervals contain the true parameters, at 150 Hz and at 5 kHz.

    The time stamps are off by up to 3 % of a period, one row is missing and one occurs twice.
    """
    period = 1 / rate
    motion = jog(knot)
    text = AXIS.format(period=period, duration=float(motion.duration), knot=knot)
    (tmp_path / "axis.toml").write_text(text)
    axis = read_axis(tmp_path / "axis.toml")
    law = PDFeedforward(axis.system, axis.system.centre, 3000.0, 250.0)
    plant = Plant(axis.system, TRUTH, LowSpeedFriction(amplitude=3.0, speed=0.05))
    log = run(plant, law, Servo(period, 2e-6), motion).log
    n = log.input.size
    rng = np.random.default_rng(rate)
    stamps = 1e3 * period * (np.arange(n) + rng.uniform(-0.03, 0.03, n))
    rows = np.stack(
        [stamps, 1e3 * np.asarray(log.position)[:n], np.asarray(log.input) / NEWTONS], 1
    )
    rows = np.delete(rows, n // 3, axis=0)
    rows = np.insert(rows, n // 2, rows[n // 2], axis=0)
    np.savetxt(tmp_path / "log.txt", rows, fmt="%.12g")
    found = identify_axis(axis, read_log(tmp_path / "log.txt", axis.columns)).result
    truth = np.array(TRUTH)
    assert np.all((found.estimate.lower <= truth) & (found.estimate.upper >= truth))
    assert np.all((found.lower <= truth) & (found.upper >= truth))
    # at every rate the interval of the mass is narrower than its prior interval
    assert float(found.upper[0] - found.lower[0]) < 0.8 * 5.0


def test_a_large_unknown_force_is_found_at_a_slow_rate_too(tmp_path):
    """A spring of 60 N/m that is not in the model makes the log inconsistent.

    It adds 30 N at 0.5 m, while δ is 4 N.
    """
    period, knot = 1 / 150, 0.12
    motion = jog(knot)
    text = AXIS.format(period=period, duration=float(motion.duration), knot=knot)
    (tmp_path / "axis.toml").write_text(text)
    axis = read_axis(tmp_path / "axis.toml")
    at = (jnp.arange(round(float(motion.duration) / period)) + 0.5) * period
    states = motion.states(at)
    push = sum(f * t for f, t in zip(axis.system.regressors(*states), TRUTH, strict=True))
    read = np.asarray(motion.states(jnp.arange(at.size) * period).position)
    force = np.asarray(push) + 60.0 * np.asarray(states.position)
    rows = np.stack([1e3 * period * np.arange(at.size), 1e3 * read, force / NEWTONS], 1)
    np.savetxt(tmp_path / "log.txt", rows, fmt="%.12g")
    found = identify_axis(axis, read_log(tmp_path / "log.txt", axis.columns))
    assert found.result is None
    assert found.inconsistency.factor > 1.2
