import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid.design.criteria import LeastSquaresError, PlannedError
from jaxid.design.optimal_motion import optimal_motion
from jaxid.motion.feasibility import interior
from jaxid.motion.motion_space import motion_space
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.motion.violation import worst_violation
from jaxid.regression.error_of_motion import planned_error
from jaxid.regression.worst_case import individual, infinity
from jaxid.search.arc_structures import Arcs, jerk_of
from jaxid.search.augmented_lagrangian import stages
from jaxid.search.effort import Effort
from jaxid.search.initial_guesses import grown, rearranged
from jaxid.search.problem import Problem

T = motor.KNOT_PERIOD
SMALL = Effort(starts=16, generations=20, stages=2, rounds=1, variations=16, parents=4, finalists=1)
TASK = Task(motor.limits(), motor.boundary(), intervals=60, period=T)
PLAIN = SMALL._replace(generations=0)


@pytest.mark.usefixtures("quick_compilation")
def test_any_function_of_a_motion_can_be_designed_for(key):
    """The largest position at 0.15 s agrees with a linear program that HiGHS solves exactly."""

    def objective(trajectory: JerkTrajectory, smoothing):
        return -jnp.log(trajectory.states(jnp.array([0.15])).position[0] + 0.05)

    found = optimal_motion(TASK, objective, key, effort=PLAIN)
    reached = float(found.trajectory.states(jnp.array([0.15])).position[0])
    assert reached == pytest.approx(highest_at(15), rel=2e-4)
    assert worst_violation(motor.limits(), motor.boundary(), found.trajectory) <= 0


def highest_at(knot: int) -> float:
    from scipy.optimize import linprog

    from jaxid.motion.inequalities import responses

    n = 60
    Y, V, A = (M * 1000.0 for M in responses(n, T, T / 4 * np.arange(1, 4 * n + 1)))
    rows = np.vstack([Y, -Y, V, -V, A, -A, -Y[4 * 30 - 1 : 4 * 30]])
    sides = np.append(np.repeat([0.4, 0.01, 2.0, 2.0, 400 / 9, 400 / 9], 4 * n), -0.3)
    ends = np.vstack([Y[-1], V[-1], A[-1]])
    return -linprog(-Y[4 * knot - 1], rows, sides, ends, np.zeros(3), bounds=(-1, 1)).fun


@pytest.mark.usefixtures("quick_compilation")
def test_a_small_search_comes_near_the_best_known_within_the_limits(key):
    system = motor.system()
    found = optimal_motion(TASK, LeastSquaresError(system, "Fc"), key, effort=SMALL)
    # with seeds 0 to 2: 1.5 to 4.6 % above the best known J*, without dwells 1.5 to 6.7 %
    assert planned_error(system, found.trajectory)[2] < 1.05 * 0.2108
    assert worst_violation(TASK.limits, TASK.boundary, found.trajectory) <= 0
    assert found.history[-1] <= found.history[0]


@pytest.mark.usefixtures("quick_compilation")
def test_same_key_same_motion(key):
    args = (TASK, LeastSquaresError(motor.system(), "M"), key)
    tiny = SMALL._replace(starts=8, generations=3, steps=5, variations=8, parents=2, programs=5)
    one, other = (optimal_motion(*args, effort=tiny) for _ in range(2))
    np.testing.assert_array_equal(one.trajectory.jerk, other.trajectory.jerk)


@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.parametrize("norm", [individual(0, 4), individual(3, 4), infinity(jnp.ones(4))])
def test_gradients_are_those_of_finite_differences(norm, key):
    """Gradients of objective and penalties, within the limits and beyond, where penalties dominate.

    The best of four steps agrees to 1e-7 of |∇|; 7e-14 to 2e-8 was measured.
    """
    limits, boundary = motor.limits(), motor.boundary()
    space = motion_space(limits, boundary, 60, T)
    problem = Problem(PlannedError(motor.system(), norm, 2.0, 5), limits, boundary)
    offset, direction = jax.random.normal(key, (2, space.basis.shape[1]))
    inside = interior(limits, boundary, 60, T)
    multipliers = jax.tree.map(lambda c: jnp.full(c.shape, 0.1), problem.violations(inside))

    @jax.jit
    def value(h, size):
        moved = space.coordinates(inside.jerk) + size * offset + h * direction
        motion = space.trajectory(moved)
        return problem.lagrangian(motion, multipliers, jnp.asarray(10.0), jnp.asarray(0.01))

    for size, beyond in ((0.001, False), (1.0, True)):
        motion = space.trajectory(space.coordinates(inside.jerk) + size * offset)
        assert (worst_violation(limits, boundary, motion) > 0) == beyond
        slope, steps = jax.jit(jax.grad(value))(0.0, size), 10.0 ** np.arange(-7.0, -3.0)
        errors = [abs((value(h, size) - value(-h, size)) / (2 * h) - slope) for h in steps]
        assert min(errors) <= 1e-7 * abs(slope)


def test_no_nan_at_rest():
    """The motion starts and ends at rest, where all regressors have kinks."""
    space = motion_space(motor.limits(), motor.boundary(), 60, T)
    objective = PlannedError(motor.system(), individual(0, 4), 2.0, 5)
    inside = interior(motor.limits(), motor.boundary(), 60, T)
    z = space.coordinates(inside.jerk)
    slope = jax.jit(jax.grad(lambda z: objective(space.trajectory(z), jnp.asarray(0.0))))(z)
    assert jnp.all(jnp.isfinite(slope))


def test_the_shipped_designs_are_as_good_as_they_claim(figures):
    """J* is at or below that of the paper, and at N = 30 within 1 % of the best known values."""
    from jaxid.io.files import read_table, read_trajectory

    best_known = {"M": 0.004694, "B": 0.182693, "Fc": 0.211324}
    paper = {("M", 30): 0.0055, ("B", 50): 0.1966, ("Fc", 30): 0.2598}
    rows = read_table(figures / "table1.csv")
    assert len(rows) == 15
    for row in rows:
        name, horizon = row["parameter"], int(row["N"])
        if horizon == 20:
            assert row["feasible"] == "false"
            assert row["J_star"] == ""
            continue
        index = motor.system().index(name)
        trajectory = read_trajectory(figures / f"trajectory_{name}_N{horizon}.csv")
        error = float(planned_error(motor.system(), trajectory)[index])
        assert float(row["J_star"]) == pytest.approx(error, rel=1e-12)
        halved = float(planned_error(motor.system(), trajectory, 512)[index])
        assert halved == pytest.approx(error, rel=1e-4)
        if (name, horizon) in paper:
            assert error <= paper[name, horizon]
        if horizon == 30:
            assert error <= 1.01 * best_known[name]


def test_the_shipped_designs_are_the_best_that_longer_searches_find(figures):
    """Three longer searches agree (`make crosscheck`), and the designs are within 1 % of them."""
    from jaxid.io.files import read_table

    searches = ("dwells_1", "dwells_2", "random")
    crosscheck = read_table(figures / "crosscheck.csv")
    shipped = [row for row in read_table(figures / "table1.csv") if row["J_star"]]
    for row, own in zip(crosscheck, shipped, strict=True):
        assert (row["parameter"], row["N"]) == (own["parameter"], own["N"])
        # the crosscheck is of these designs; another compilation changes J by 1e-11
        assert float(row["J_star"]) == pytest.approx(float(own["J_star"]), rel=1e-8)
        found = [float(row[name]) for name in searches]
        # 0.6 % at B, N = 50, where one of the three searches found a better order of dwells
        agree = 1.005 if row["N"] in ("40", "60") else 1.01
        assert max(found) <= agree * min(found)
        assert float(own["J_star"]) <= 1.01 * min(found)


def test_the_reported_quadrature_agrees_with_another_rule(figures, motion):
    """J* agrees with Gauss-Legendre quadrature in NumPy.

    Its intervals end at the knots and where the velocity crosses 0 and ±0.1 m/s.
    """
    v = np.asarray(motion.knot_states().velocity)
    a = np.asarray(motion.knot_states().acceleration)
    j, edges = np.asarray(motion.jerk), []
    for k in range(len(j)):
        cuts = [0.0, T]
        for level in (-0.1, 0.0, 0.1):
            roots = np.roots([j[k] / 2, a[k], v[k] - level])
            cuts += [r for r in roots[np.isreal(roots)].real if 0 < r < T]
        if np.sign(v[k]) != np.sign(v[k + 1]):  # S_f is steep there
            zero = [c for c in cuts if abs(v[k] + a[k] * c + j[k] * c * c / 2) < 1e-9]
            cuts += [z + s for z in zero for s in np.geomspace(1e-6, T, 30) if z + s < T]
            cuts += [z - s for z in zero for s in np.geomspace(1e-6, T, 30) if z - s > 0]
        edges.append(k * T + np.unique(cuts))
    nodes, shares = np.polynomial.legendre.leggauss(8)
    edges = np.concatenate(edges)
    low, wide = edges[:-1], np.diff(edges)
    keep = wide > 1e-13
    times = (low[keep, None] + wide[keep, None] * (nodes + 1) / 2).ravel()
    weights = (wide[keep, None] * shares / 2).ravel()
    _, v, a = (np.asarray(x) for x in motion.states(jnp.asarray(times)))
    phi = np.stack([a, v, 2 / np.pi * np.arctan(1000 * v), np.ones_like(v)], axis=1)
    delta = np.where(np.abs(v) <= 0.1, 0.25, 0.15)
    P = phi.T @ (phi * weights[:, None])
    expected = np.abs(np.linalg.solve(P, phi.T)) @ (weights * delta)
    np.testing.assert_allclose(planned_error(motor.system(), motion), expected, rtol=1e-4)


def test_rearranged_and_grown_motions_keep_their_parents(key, motion):
    space = motion_space(motor.limits(), motor.boundary(), 60, T)
    parents = [motion.jerk]
    again = rearranged(key, space, parents, T, 44.4, 4)
    np.testing.assert_allclose(space.trajectory(again[0]).jerk, motion.jerk, atol=1e-5)
    assert jnp.max(jnp.abs(again[1] - again[0])) > 0.01
    longer = motion_space(motor.limits(), motor.boundary(), 80, T)
    assert grown(key, longer, parents, 80, 3).shape == (3, longer.basis.shape[1])


def test_stages_get_harder():
    assert all(a.penalty < b.penalty for a, b in itertools.pairwise(stages(5)))
    assert all(a.smoothing > b.smoothing for a, b in itertools.pairwise(stages(5)))


def test_a_motion_of_dwells_holds_its_speeds_within_the_limits():
    """The motion holds the given speeds in order and ends at rest.

    There are padding and speeds with a share of zero.
    """
    limits = motor.limits()
    space = motion_space(limits, motor.boundary(), 80, T, 100)
    speeds = jnp.array([0.1, 2.0, 2.0, -2.0, 0.5, -0.05, 0.0])
    shares = jnp.array([2.0, 1.0, 0.0, 1.0, 0.0, 1.0, 1.0])
    jerk = jerk_of(Arcs(speeds, shares), limits, space)
    states = JerkTrajectory(space.start, jerk, space.durations).knot_states()
    speed, acceleration = np.asarray(states.velocity), np.asarray(states.acceleration)
    held = [v for v, _ in itertools.groupby(speed[np.abs(acceleration) < 1e-9].round(9))]
    assert held == [0.0, 0.1, 2.0, -2.0, 0.5, -0.05, 0.0]
    assert np.all(np.asarray(jerk)[80:] == 0)
    assert np.max(np.abs(jerk)) <= 1000.0 * (1 + 1e-9)
    assert np.max(np.abs(acceleration)) <= 400 / 9 * (1 + 1e-9)
