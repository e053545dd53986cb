"""The interior-point method agrees with HiGHS, also on degenerate and badly scaled programs."""

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import sparse
from scipy.optimize import linprog

from experiments.axes import linear_motor as motor
from jaxid.design.nominal_log import nominal_log
from jaxid.identification.interior_point import LeastDeviations
from jaxid.identification.joined_rows import rows_of_logs
from jaxid.identification.modulating_functions import program_of

# relative: 1e-9 is where iterations end; HiGHS itself allows violations of 1e-7
CLOSE = 1e-6
SHARES = st.sampled_from([0.0, 0.01, 0.5, 0.99, 2.0, 50.0])


def value(program, tilt, target, x, *, limited):
    """Return the value of a program at x, from its definition."""
    deviations = np.abs(program.spread @ x).sum() + np.abs(target - program.moments @ x).sum()
    return tilt @ x + deviations + (0.0 if limited else np.abs(x).sum())


def least(program, tilt, target, *, limited):
    """Return the least value by HiGHS, None if the program is unbounded.

    Variables are the upper and lower parts of x and of each deviation.
    """
    m, count = program.moments.shape
    rows = np.vstack([program.spread.toarray(), program.moments])
    own, others = np.full(2 * count, 0.0 if limited else 1.0), np.ones(2 * len(rows))
    own += np.concatenate([tilt, -tilt])
    parts = np.eye(len(rows))
    found = linprog(
        np.concatenate([own, others]),
        A_eq=np.hstack([rows, -rows, -parts, parts]),
        b_eq=np.concatenate([np.zeros(len(rows) - m), target]),
        A_ub=np.concatenate([np.ones(2 * count), np.zeros(2 * len(rows))])[None],
        b_ub=[1.0 if limited else 1e9],
        method="highs",
    )
    assert found.status == 0
    return None if found.fun < -1e6 else found.fun


def random_program(seed, count, noise, scale):
    """Return a program with second differences as `spread`, its tilt and its target."""
    draw = np.random.default_rng(seed)
    second = sparse.diags_array([1.0, -2.0, 1.0], offsets=[0, -1, -2], shape=(count + 2, count)) * (
        noise * 10.0 ** draw.uniform(-1, 1, (count + 2, 1))
    )
    kept = sparse.csr_array(second)[draw.random(count + 2) < 0.8] if noise else second.tocsr()[:0]
    moments = draw.normal(size=(3, count)) * scale * draw.choice([0.0, 0.1, 1.0, 10.0], (3, 1))
    program = LeastDeviations(sparse.csr_array(kept), moments)
    return program, draw.normal(size=count), draw.choice([-1.0, 0.0, 1.0], 3)


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1, 2, 3, 4, 17, 60]),
    st.sampled_from([0.0, 1e-3, 1.0, 100.0]),
    st.sampled_from([1e-3, 1.0, 1e3]),
    SHARES,
)
def test_values_are_those_of_highs(seed, count, noise, scale, share):
    program, tilt, target = random_program(seed, count, noise, scale)
    tilt = share * tilt
    expected = least(program, tilt, target, limited=False)
    found = program.minimum(tilt, target)
    if expected is None:
        assert found is None
        return
    assert found is not None
    reached = value(program, tilt, target, found.x, limited=False)
    assert abs(reached - expected) <= CLOSE * max(1.0, abs(expected))


@given(
    st.integers(0, 2**32 - 1), st.sampled_from([1, 3, 17, 60]), st.sampled_from([0.0, 1.0, 100.0])
)
def test_values_under_a_limit_are_those_of_highs(seed, count, noise):
    program, tilt, target = random_program(seed, count, noise, 1.0)
    target = np.zeros_like(target)
    found = program.minimum(tilt, target, limited=True)
    assert found is not None
    assert np.sum(np.abs(found.x)) <= 1 + 1e-12
    expected = least(program, tilt, target, limited=True)
    reached = value(program, tilt, target, found.x, limited=True)
    assert abs(reached - expected) <= CLOSE * max(1.0, abs(expected))


def test_multipliers_are_derivatives_of_the_minimum():
    """Central differences of the minimum by its target agree where the minimum is smooth."""
    program, tilt, target = random_program(5, 60, 1.0, 1.0)
    target = target + np.array([0.3, 0.1, -0.2])

    def minimum(target):
        found = program.minimum(0.1 * tilt, target)
        assert found is not None
        return value(program, 0.1 * tilt, target, found.x, limited=False)

    found, step = program.minimum(0.1 * tilt, target), 1e-4
    assert found is not None
    for k, unit in enumerate(np.eye(3)):
        slope = (minimum(target + step * unit) - minimum(target - step * unit)) / (2 * step)
        np.testing.assert_allclose(found.multipliers[k], slope, atol=1e-5)


@pytest.mark.parametrize("knots", [40, 400, 2999])
def test_programs_of_a_log_are_solved_to_rounding(motion, knots):
    """The multipliers prove how near each value is to the minimum, for a log of the motor."""
    system = motor.system()
    program, misfit = program_of(
        rows_of_logs(system, [nominal_log(system, motion, motor.servo())]), knots
    )
    noise = np.asarray(jax.random.normal(jax.random.key(0), misfit.shape))
    for tilt in (0 * program.delta, 1e-3 * (noise @ program.basis)):
        for unit in np.eye(len(system.names)):
            solver = program.deviations
            found = solver.minimum(tilt, unit)
            assert found is not None
            reached = value(solver, tilt, unit, found.x, limited=False)
            # weak duality: any multipliers within their bounds are a lower bound of the minimum
            assert np.all(np.abs(found.multipliers) <= 1 + 1e-9)
            assert reached <= unit @ found.multipliers + CLOSE


def test_a_program_without_knots_has_no_minimum():
    empty = LeastDeviations(sparse.csr_array((0, 0)), np.zeros((2, 0)))
    assert empty.minimum(np.zeros(0), np.ones(2)) is None
