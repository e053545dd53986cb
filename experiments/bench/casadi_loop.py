"""The same loop in CasADi's own best way: a tick as SX, `mapaccum` over all ticks, generated C."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca  # pyright: ignore[reportMissingImports]  (only in the extra `bench`)
import numpy as np
from jaxtyping import Float

from experiments.bench import closed_loop, compiled
from jaxid.loop import simulate

# ticks per level of `mapaccum`: of 4, 10, 30, 100 and 300 the fastest gradient
_BASE = 100

Vector = Float[np.ndarray, " n"]


class Loop:
    """`loop_error` and its reverse gradient as generated C, compiled with the flags of loop.c."""

    def __init__(self, repeats: int, theta: Vector, intervals: int = closed_loop.INTERVALS) -> None:
        """Build, generate, compile, load."""
        jerk = ca.MX.sym("jerk", intervals)
        error = _log_error(closed_loop.numbers(repeats, intervals), jerk, theta)
        value = ca.Function("value", [jerk], [error])
        both = ca.Function("both", [jerk], [error, ca.gradient(error, jerk)])
        with tempfile.TemporaryDirectory() as folder:
            generator = ca.CodeGenerator("loop.c")
            generator.add(value)
            generator.add(both)
            generator.generate(f"{folder}/")
            library = compiled.build(Path(folder) / "loop.c", Path(folder) / "loop.so")
            self._value = ca.external("value", str(library))
            self._both = ca.external("both", str(library))

    def value(self, jerk: Vector) -> Callable[[], Vector]:
        """Log J."""
        run, (value,) = _bound(self._value, jerk)

        def call() -> Vector:
            run()
            return value

        return call

    def value_and_gradient(self, jerk: Vector) -> Callable[[], tuple[float, Vector]]:
        """Log J and its gradient."""
        run, (value, gradient) = _bound(self._both, jerk)

        def call() -> tuple[float, Vector]:
            run()
            return float(value[0]), gradient

        return call


def _bound(function: Any, jerk: Vector) -> tuple[Callable[[], None], list[Vector]]:
    """The function on fixed memory, without the cost of converting arguments."""
    buffer, run = function.buffer()
    argument = np.array(jerk)
    results = [np.zeros(function.size1_out(k)) for k in range(function.n_out())]
    buffer.set_arg(0, _view(argument))
    for k, result in enumerate(results):
        buffer.set_res(k, _view(result))

    def call(keep: object = (buffer, argument)) -> None:
        run()

    return call, results


def _view(array: Any) -> memoryview:
    return memoryview(array)


def _log_error(c: closed_loop.Numbers, jerk: Any, theta: Vector) -> Any:
    ticks = c.intervals * c.per_interval * c.repeats
    roll = _tick(c, theta).mapaccum("roll", ticks, {"base": _BASE})
    centre = [(a + b) / 2 for a, b in zip(c.lower, c.upper, strict=True)]
    states = roll(ca.vertcat(0, 0, *centre, 0, 0, 0, 0, 0), _reference(c, jerk))
    phi, delta = states[6:10, :], states[10, :]
    unit = ca.DM.zeros(4)
    unit[c.target] = 1
    mixture = ca.mtimes(ca.inv(ca.mtimes(phi, phi.T) * c.period), unit)
    g = ca.mtimes(mixture.T, phi) * c.period
    corner = c.smoothing * ca.sqrt(ca.sumsqr(g) / ticks)
    return ca.log(ca.sum2(ca.sqrt(g**2 + corner**2) * delta))


def _reference(c: closed_loop.Numbers, jerk: Any) -> Any:
    """Desired position, velocity and acceleration at every tick, one column per tick."""
    T, t = c.knot_period, ca.DM(np.arange(c.per_interval) * c.period).T
    a = ca.vertcat(0, ca.cumsum(jerk * T))
    v = ca.vertcat(0, ca.cumsum(a[:-1] * T + jerk * T**2 / 2))
    y = ca.vertcat(0, ca.cumsum(v[:-1] * T + a[:-1] * T**2 / 2 + jerk * T**3 / 6))
    y, v, a = (ca.repmat(x[:-1], 1, c.per_interval) for x in (y, v, a))
    j, t = ca.repmat(jerk, 1, c.per_interval), ca.repmat(t, c.intervals, 1)
    states = (y + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j)
    rows = [ca.reshape(x.T, 1, c.intervals * c.per_interval) for x in states]
    return ca.repmat(ca.vertcat(*rows), 1, c.repeats)


def _tick(c: closed_loop.Numbers, theta: Vector) -> Any:
    """State (y, v, θ̂, filtered φ and δ) after one tick, from the state before it."""
    state, desired, h = ca.SX.sym("state", 11), ca.SX.sym("desired", 3), c.period
    y, v, *hat = ca.vertsplit(state[:6])
    sign, delta = _friction(c, v)
    rate = v - desired[1]
    p = rate + c.k1 * (y - desired[0])
    phi = (desired[2] - c.k1 * rate, v, sign, 1)
    widths = [b - a for a, b in zip(c.lower, c.upper, strict=True)]
    mismatch = sum((ca.fabs(f) * w for f, w in zip(phi, widths, strict=True)), start=delta)
    feedforward = sum((f * t for f, t in zip(phi, hat, strict=True)), start=ca.SX(0))
    u = feedforward - c.k2 * p - mismatch**2 * p / (4 * c.epsilon)
    adapted = [
        ca.fmin(ca.fmax(t - h * g * f * p, low), high)
        for t, g, f, low, high in zip(hat, c.gamma, phi, c.lower, c.upper, strict=True)
    ]
    gain, mean = ca.SX(0), ca.SX.zeros(5)
    for k, (node, weight) in enumerate(zip(simulate.NODES, simulate.WEIGHTS, strict=True)):
        speed = v + node * h * gain
        s, d = (sign, delta) if k == 0 else _friction(c, speed)
        gain = (u - theta[1] * speed - theta[2] * s - theta[3]) / theta[0]
        mean += weight * ca.vertcat(gain, speed, s, 1, d)
    passed = c.keep * state[6:] + (1 - c.keep) * mean
    after = ca.vertcat(y + h * mean[1], v + h * mean[0], *adapted, passed)
    return ca.Function("tick", [state, desired], [after], {"cse": True})


def _friction(c: closed_loop.Numbers, v: Any) -> tuple[Any, Any]:
    """S_f and δ, both softened."""
    sign = 2 / np.pi * ca.atan(c.beta * v) * v**2 / (v**2 + c.blend**2)
    # the derivative of an overflowing exponential is no number
    share = 1 / (1 + ca.exp(ca.fmin((ca.fabs(v) - c.threshold) / c.blend, 300)))
    return sign, c.fast + (c.slow - c.fast) * share
