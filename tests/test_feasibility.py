import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.axes import linear_motor as motor
from experiments.axes import one_link_arm as arm
from jaxid.io.files import read_table
from jaxid.motion.feasibility import InfeasibleError, interior, shortest_feasible
from jaxid.motion.inequalities import responses
from jaxid.motion.limits import Boundary, Limits, position_at_least, through
from jaxid.motion.motion_space import motion_space
from jaxid.motion.trajectory import uniform
from jaxid.motion.violation import worst_violation
from jaxid.search.problem import Problem
from jaxid.search.restoration import restored

T = motor.KNOT_PERIOD


def no_objective(trajectory, smoothing):
    return 0.0


def planned(limits, boundary) -> Problem:
    return Problem(no_objective, limits, boundary)


def test_horizon_20_is_proved_infeasible_and_22_is_the_shortest():
    with pytest.raises(
        InfeasibleError, match=r"no motion of 0\.4 s \(40 intervals of 0\.01 s\)"
    ) as error:
        interior(motor.limits(), motor.boundary(), 40, T)
    assert error.value.shortest == 44
    assert "proves" in str(error.value)
    assert shortest_feasible(motor.limits(), motor.boundary(), T, multiple=2) == 44


def test_the_shortest_motion_of_many_short_intervals_is_feasible():
    """It is found among motions with fewer, longer intervals, here of 8 ms."""
    with pytest.raises(InfeasibleError, match=r"The shortest one found lasts 0\.448 s") as error:
        interior(motor.limits(), motor.boundary(), 8, 1e-3)
    assert error.value.shortest == 448
    coarse = interior(motor.limits(), motor.boundary(), 56, 8e-3)
    fine = uniform(coarse.start, jnp.repeat(coarse.jerk, 8), 1e-3)
    assert float(worst_violation(motor.limits(), motor.boundary(), fine)) < 0


def test_a_length_without_any_room_is_not_the_shortest():
    """With half of the limits of the motor, 44 intervals reach 0.35 m only with zero margin."""
    full = motor.limits()
    half = Limits(
        full.position, full.velocity / 2, full.acceleration / 2, full.jerk / 2, full.input
    )
    there = Boundary((0.35, 0.0, 0.0), (through((0.0, 0.0, 0.0), at=1.0),))
    with pytest.raises(InfeasibleError) as error:
        interior(half, there, 20, T)
    assert error.value.shortest == 45
    with pytest.raises(
        ValueError, match=r"every motion of 0\.44 s \(44 intervals .* touches a limit"
    ):
        interior(half, there, 44, T)


def test_no_length_up_to_the_longest_that_is_tried_is_said_so():
    assert shortest_feasible(motor.limits(), motor.boundary(), T, multiple=2, most=42) is None
    refusal = InfeasibleError(40, T, 0.13, None)
    assert refusal.shortest is None
    assert str(refusal).endswith("None was found up to 20 s (2000 intervals).")


@pytest.mark.parametrize(
    ("start", "vias", "sentence"),
    [
        (
            (0, 0, 0),
            (through((10, 0, 0), at=1.0),),
            r"at 1 of the duration .* position .* in \[10, 10\]",
        ),
        (
            (0, 3, 0),
            (through((0, 0, 0), at=1.0),),
            r"at 0 of the duration .* velocity .* in \[3, 3\]",
        ),
        (
            (0, 0, 0),
            (position_at_least(9.0, at=0.5),),
            r"at 0\.5 of the duration .* position .* in \[9, inf\]",
        ),
    ],
)
def test_a_boundary_outside_the_limits_is_refused_at_once(start, vias, sentence):
    """The error is raised before linear programs for 2000 lengths are solved."""
    with pytest.raises(ValueError, match=sentence):
        interior(motor.limits(), Boundary(start, vias), 20, T)


def test_the_largest_reach_at_horizon_20_agrees_with_another_program():
    """A separate linear program with limits at the knots reaches 0.261 m instead of 0.3 m."""
    from scipy.optimize import linprog

    n = 40
    Y, V, A = (M * 1000.0 for M in responses(n, T, T * np.arange(1, n + 1)))
    rows = np.vstack([Y, -Y, V, -V, A, -A])
    sides = np.repeat([0.4, 0.01, 2.0, 2.0, 400 / 9, 400 / 9], n)
    ends = np.vstack([Y[-1], V[-1], A[-1]])
    best = linprog(-Y[19], rows, sides, ends, np.zeros(3), bounds=(-1, 1))
    assert -best.fun == pytest.approx(0.261, abs=5e-4)


@pytest.mark.parametrize(("axis", "intervals"), [(motor, 44), (motor, 60), (arm, 50)])
def test_the_interior_motion_is_strictly_inside_and_meets_the_ends(axis, intervals):
    trajectory = interior(axis.limits(), axis.boundary(), intervals, axis.KNOT_PERIOD)
    assert worst_violation(axis.limits(), axis.boundary(), trajectory) < 0
    assert ends_missed(axis, trajectory) < 1e-12


def ends_missed(axis, trajectory) -> float:
    """Return the largest violation of the equality conditions, in half-widths of the limits."""
    scale = (axis.limits().motion[:, 1] - axis.limits().motion[:, 0]) / 2
    worst = 0.0
    for via in axis.boundary().vias:
        state = jnp.stack(trajectory.states(via.at * trajectory.duration[None]))[:, 0]
        fixed = via.lower == via.upper
        missed = jnp.where(fixed, jnp.abs(state - via.lower) / scale, 0.0)
        worst = max(worst, float(jnp.max(missed)))
    return worst


@pytest.mark.parametrize(("axis", "intervals"), [(motor, 60), (arm, 50)])
def test_coordinates_keep_the_equalities_and_come_back(axis, intervals, key):
    space = motion_space(axis.limits(), axis.boundary(), intervals, axis.KNOT_PERIOD, 64)
    z = jax.random.normal(key, (space.basis.shape[1],)).at[intervals - 3 :].set(0.0)
    trajectory = space.trajectory(z)
    assert ends_missed(axis, trajectory) < 1e-11
    np.testing.assert_allclose(space.coordinates(trajectory.jerk), z, atol=1e-8)


@given(st.integers(0, 10_000), st.floats(0.01, 3.0))
def test_walking_back_always_ends_inside_all_limits(seed, size):
    limits, boundary = motor.limits(), motor.boundary()
    space = motion_space(limits, boundary, 60, T)
    inside = interior(limits, boundary, 60, T)
    z = size * jax.random.normal(jax.random.key(seed), (space.basis.shape[1],))
    found = restored(planned(limits, boundary), inside, space.trajectory(z))
    assert worst_violation(limits, boundary, found) <= 0
    assert ends_missed(motor, found) < 1e-11
    # it stops at the limits: the largest violation is nearly zero
    if worst_violation(limits, boundary, space.trajectory(z)) > 1e-6:
        assert worst_violation(limits, boundary, found) > -1e-9


def test_an_admissible_candidate_is_left_alone():
    limits, boundary = motor.limits(), motor.boundary()
    inside = interior(limits, boundary, 60, T)
    found = restored(planned(limits, boundary), inside, inside)
    np.testing.assert_array_equal(found.jerk, inside.jerk)


def test_every_committed_motion_keeps_every_limit_from_its_jerk_column_alone(figures):
    """The jerk is integrated with NumPy; extrema between the knots are roots of polynomials."""
    limits = [(-0.01, 0.4), (-2.0, 2.0), (-400 / 9, 400 / 9)]
    paths = sorted(figures.glob("trajectory_*.csv"))
    assert len(paths) >= 14
    for path in paths:
        jerk = np.array([float(row["jerk_m_s3"]) for row in read_table(path)])[:-1]
        assert np.max(np.abs(jerk)) <= 1000.0
        states = [np.zeros(3)]
        for j in jerk:
            y, v, a = states[-1]
            polynomial = np.poly1d([j / 6, a / 2, v, y])
            for order, (low, high) in enumerate(limits):
                curve = polynomial.deriv(order) if order else polynomial
                turns = curve.deriv().roots if curve.order else np.zeros(0)
                real = turns[np.isreal(turns)].real
                times = np.concatenate([[0.0, T], real[(real > 0) & (real < T)]])
                values = curve(times)
                assert np.max(values) <= high + 1e-9 * (high - low)
                assert np.min(values) >= low - 1e-9 * (high - low)
            states.append(
                np.array([polynomial.deriv(k)(T) if k else polynomial(T) for k in range(3)])
            )
        states = np.array(states)
        assert np.all(np.abs(states[-1]) <= 1e-9 * np.array([0.4, 2.0, 44.4]))
        assert states[len(jerk) // 2, 0] >= 0.3 - 1e-9 * 0.4


def test_a_via_point_may_lie_between_the_knots():
    limits, boundary = motor.limits(), motor.boundary()
    trajectory = interior(limits, boundary, 61, T)
    assert trajectory.states(jnp.array([0.305])).position[0] >= 0.3


def test_start_need_not_be_at_rest():
    import equinox as eqx

    boundary = eqx.tree_at(lambda b: b.start, motor.boundary(), jnp.array([0.05, 0.2, 1.0]))
    trajectory = interior(motor.limits(), boundary, 60, T)
    assert worst_violation(motor.limits(), boundary, trajectory) < 0
    np.testing.assert_allclose(jnp.stack(trajectory.knot_states())[:, 0], [0.05, 0.2, 1.0])
    space = motion_space(motor.limits(), boundary, 60, T)
    end = jnp.stack(space.trajectory(jnp.ones(space.basis.shape[1])).knot_states())[:, -1]
    np.testing.assert_allclose(end, 0.0, atol=1e-11)


def test_uniform_is_what_the_interior_returns():
    trajectory = interior(motor.limits(), motor.boundary(), 60, T)
    same = uniform(jnp.zeros(3), trajectory.jerk, T)
    np.testing.assert_array_equal(same.durations, trajectory.durations)
