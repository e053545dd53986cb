"""Problem (16) for IPOPT: sparse multiple shooting, exact derivatives, decreasing smoothing.

The unknowns are the states at the knots, the jerks, and the mixture c = P⁻¹eᵢ of (15). The mixture
has four equations of its own and keeps the Hessian sparse. Between the knots the states are exact
polynomials. The objective is that of `PlannedError`: the corners of |g| are rounded, and jumps are
spread by the smoothing and by the change of speed from node to node.

The following improved it, as tried on M at N = 30, B at N = 50 and F_c at N = 40: a barrier
parameter that starts at 1e-4 (from 0.1 nearly every start ends in the same local minimum, 7 %
higher), three stages of smoothing, and node functions that are mapped and compiled instead of
interpreted (0.6 of the time).
"""

import contextlib
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca  # pyright: ignore[reportMissingImports]  (only in the extra `bench`)
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.axes import linear_motor as motor
from experiments.bench.compiled import build
from jaxid.loop.record import rows_of
from jaxid.model.disturbance_bound import SpeedBand
from jaxid.model.regressors import Coulomb
from jaxid.model.system import smoothed
from jaxid.motion.trajectory import JerkTrajectory, uniform
from jaxid.regression.error_of_motion import planned_error

Vector = Float[np.ndarray, " n"]


class Stage(NamedTuple):
    """The smoothing of one stage, and its number of midpoint nodes per interval."""

    smoothing: float
    nodes: int


LADDER = (Stage(0.01, 5), Stage(0.001, 5), Stage(0.0001, 8))
_BARRIER = 1e-4
_OPTIONS = {
    "print_time": 0,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.linear_solver": "mumps",
    "ipopt.tol": 1e-6,
    "ipopt.acceptable_tol": 1e-5,
    "ipopt.acceptable_iter": 8,
    "ipopt.max_iter": 300,
    "ipopt.mu_init": _BARRIER,
    "ipopt.bound_push": _BARRIER,
    "ipopt.bound_frac": _BARRIER,
}
# each stage starts from the point and the multipliers of the one before
_WARM = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.warm_start_bound_push": 1e-6,
    "ipopt.warm_start_mult_bound_push": 1e-6,
    "ipopt.warm_start_slack_bound_push": 1e-6,
}
_BETWEEN = (0.25, 0.5, 0.75)  # shares of an interval at which position and velocity are limited too


class Program:
    """The nonlinear programs of one cell of Table I, one for each stage."""

    def __init__(self, target: str, intervals: int, ladder: tuple[Stage, ...] = LADDER) -> None:
        """Build and compile the programs."""
        self.index, self.intervals = motor.system().index(target), intervals
        self._ladder = ladder
        self._bounds = _bounds(intervals)
        with tempfile.TemporaryDirectory() as folder:
            libraries = {
                nodes: _library(Path(folder), self.index, intervals, nodes)
                for nodes in {stage.nodes for stage in ladder}
            }
            self._solvers = [
                ca.nlpsol(
                    f"stage_{k}", "ipopt", libraries[s.nodes], _OPTIONS | (_WARM if k else {})
                )
                for k, s in enumerate(ladder)
            ]

    def solve(self, start: Vector) -> Vector:
        """Return the jerk at which the last stage ends, from an initial jerk, m/s³."""
        jerk, multipliers = start, {}
        for stage, solver in zip(self._ladder, self._solvers, strict=True):
            x, corner, error = _guess(self.index, jerk, stage)
            parameters = [stage.smoothing * _top_speed(), corner, 1 / error]
            found = solver(x0=x, p=parameters, **self._bounds, **multipliers)
            multipliers = {"lam_x0": found["lam_x"], "lam_g0": found["lam_g"]}
            n = self.intervals
            jerk = np.asarray(found["x"]).ravel()[3 * (n + 1) : 4 * n + 3] * _units()[3]
        return np.clip(jerk, *np.asarray(motor.limits().jerk))


def _library(folder: Path, index: int, intervals: int, nodes: int) -> str:
    """Return a library with the objective, the equations and their exact derivatives in C."""
    program = ca.nlpsol("program", "ipopt", _problem(index, intervals, nodes), _OPTIONS)
    with contextlib.chdir(folder):  # the next call takes a name, not a path
        source = folder / program.generate_dependencies(f"nodes_{nodes}.c")
    return str(build(source, source.with_suffix(".so")))


def _top_speed() -> float:
    return float(jnp.max(jnp.abs(motor.limits().velocity)))


def _units() -> Vector:
    """Return scales of position, velocity, acceleration and jerk; scaled unknowns are about one."""
    limits = motor.limits()
    return np.abs(np.vstack([limits.motion, limits.jerk])).max(axis=1)


def _motion(jerk: Vector) -> JerkTrajectory:
    return uniform(motor.boundary().start, jnp.asarray(jerk), motor.KNOT_PERIOD)


def _guess(index: int, jerk: Vector, stage: Stage) -> tuple[Vector, float, float]:
    """Return the unknowns of a motion, the rounding of |g| for its smoothing, and its J."""
    system, trajectory = motor.system(), _motion(jerk)
    half = np.asarray(system.half_widths)
    states, weights = trajectory.midpoints(stage.nodes)
    step = jnp.abs(states.acceleration) * weights / 2
    rows = rows_of(smoothed(system, stage.smoothing * _top_speed() + step), states, weights)
    phi, weights = np.asarray(rows.regressors) * half, np.asarray(weights)
    mixture = np.linalg.solve(phi.T * weights @ phi, np.eye(len(half))[index])
    square = float((phi @ mixture) ** 2 @ weights) / float(weights.sum())
    corner = 2 * stage.smoothing * square**0.5
    knots = [np.asarray(x) for x in trajectory.knot_states()]
    scaled = [x / unit for x, unit in zip([*knots, jerk], _units(), strict=True)]
    error = float(planned_error(system, trajectory, 64)[index])
    return np.concatenate([*scaled, mixture]), corner, error


def _problem(index: int, n: int, nodes: int) -> dict[str, Any]:
    """Return objective and equations.

    Their parameters are the smoothing of jumps, the rounding of |g|, and the scale of J.
    """
    half, unit, T = np.asarray(motor.system().half_widths), _units(), motor.KNOT_PERIOD
    scaled = [
        ca.MX.sym(name, size) for name, size in zip("yvaj", (n + 1, n + 1, n + 1, n), strict=True)
    ]
    mixture, parameters = ca.MX.sym("c", 4), ca.MX.sym("p", 3)
    y, v, a, j = (x * u for x, u in zip(scaled, unit, strict=True))

    def after(t: float) -> tuple[Any, Any, Any]:
        y0, v0, a0 = y[:-1], v[:-1], a[:-1]
        position = y0 + t * (v0 + t * (a0 / 2 + t * j / 6))
        return position, v0 + t * (a0 + t * j / 2), a0 + t * j

    at = [after((q + 0.5) * T / nodes) for q in range(nodes)]
    speeds, accelerations = (ca.vertcat(*(x[k] for x in at)) for k in (1, 2))
    node = _node(half, T / nodes).map(n * nodes)
    errors, moments = node(
        ca.horzcat(speeds, accelerations).T,
        ca.repmat(mixture, 1, n * nodes),
        ca.repmat(parameters, 1, n * nodes),
    )
    dynamics = [(x[1:] - end) / u for x, end, u in zip((y, v, a), after(T), unit[:3], strict=True)]
    between = [after(share * T) for share in _BETWEEN]
    limited = [x[1] / unit[1] for x in between] + [x[0] / unit[0] for x in between]
    equations = ca.sum2(moments) - ca.DM(np.eye(4)[index])
    return {
        "x": ca.vertcat(*scaled, mixture),
        "p": parameters,
        "f": ca.sum2(errors) * half[index] * parameters[2],
        "g": ca.vertcat(*dynamics, equations, *limited),
    }


def _node(half: Vector, weight: float) -> Any:
    """Return the function of one midpoint node: its terms of J and P c, φ scaled by the box."""
    system = motor.system()
    friction, delta = system.terms[2].regressor, system.disturbance_bound
    assert isinstance(friction, Coulomb)
    assert isinstance(delta, SpeedBand)
    state, mixture, parameters = ca.SX.sym("s", 2), ca.SX.sym("c", 4), ca.SX.sym("p", 3)
    v, a = state[0], state[1]
    # |a| and |v| with rounded corners; the rounding is far too small to matter
    width = parameters[0] + ca.sqrt(a**2 + 0.01) * weight / 2
    sign = 2 / np.pi * ca.atan(float(friction.beta) * v) * v**2 / (v**2 + width**2)
    below = [(1 + ca.tanh((float(delta.threshold) + s * v) / (2 * width))) / 2 for s in (1, -1)]
    level = float(delta.fast) + float(delta.slow - delta.fast) * below[0] * below[1]
    phi = ca.vertcat(a, v, sign, 1) * half
    g = ca.dot(mixture, phi)
    error = weight * ca.sqrt(g**2 + parameters[1] ** 2) * level
    return ca.Function("node", [state, mixture, parameters], [error, weight * g * phi])


def _bounds(n: int) -> dict[str, Vector]:
    """Return the limits at the knots and between them, rest at both ends, and the via point."""
    limits, unit = motor.limits(), _units()
    (y_low, y_high), (v_low, v_high), (a_low, a_high) = np.asarray(limits.motion) / unit[:3, None]
    j_low, j_high = np.asarray(limits.jerk) / unit[3]
    low = [np.full(n + 1, x) for x in (y_low, v_low, a_low)]
    high = [np.full(n + 1, x) for x in (y_high, v_high, a_high)]
    for x in (*low, *high):
        x[[0, n]] = 0.0
    low[0][n // 2] = float(motor.boundary().vias[0].lower[0]) / unit[0]
    free, equal, count = np.full(4, np.inf), np.zeros(3 * n + 4), n * len(_BETWEEN)
    return {
        "lbx": np.concatenate([*low, np.full(n, j_low), -free]),
        "ubx": np.concatenate([*high, np.full(n, j_high), free]),
        "lbg": np.concatenate([equal, np.full(count, v_low), np.full(count, y_low)]),
        "ubg": np.concatenate([equal, np.full(count, v_high), np.full(count, y_high)]),
    }
