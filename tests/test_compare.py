"""Textbook excitations: their definitions, the fairness of their search, the printed results."""

import functools
import shutil

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import chirp

from experiments._support import excitations
from experiments._support.classical import Information
from experiments._support.family_search import Budget, best_members, polished_member
from experiments.axes import linear_motor as motor
from experiments.beyond import compare
from experiments.paper.designs import HORIZON
from jaxid.design.criteria import PlannedError
from jaxid.io.files import read_table, read_trajectory
from jaxid.motion.task import Task
from jaxid.motion.violation import worst_violation
from jaxid.regression.lower_bound import lower_bound
from jaxid.regression.worst_case import infinity
from jaxid.search.effort import Effort
from jaxid.search.problem import Problem
from jaxid.search.restoration import interior_motion, restored

TASK = Task(motor.limits(), motor.boundary(), 2 * HORIZON, motor.KNOT_PERIOD)


@functools.cache
def family(name):
    return compare.family_of(name, TASK)


@pytest.mark.parametrize("name", compare.FAMILIES)
def test_every_member_meets_the_end_conditions_and_has_a_slope(name, key):
    end = jnp.array([0.6])
    for numbers in jax.random.normal(key, (5, family(name).size)):
        states = family(name).trajectory(numbers).states(end)
        np.testing.assert_allclose(np.asarray(states).ravel(), 0.0, atol=1e-9)

        def jerk(z):
            return family(name).trajectory(z).jerk

        slopes = np.asarray(jax.jacfwd(jerk)(numbers))
        assert np.all(np.isfinite(slopes))
        # every number has an effect
        assert np.all(np.abs(slopes).max(axis=0) > 0)


def test_the_chirp_is_scipys():
    """With constant amplitude the acceleration equals `scipy.signal.chirp` with a linear sweep."""
    numbers, phase = jnp.array([-0.3, 0.4, 1.0, 1.0, 0.2, 0.0]), jnp.linspace(0.0, 1.0, 101)
    first, last = (float(family("chirp").cycles(z)) for z in numbers[:2])
    expected = chirp(np.asarray(phase), first, 1.0, last, phi=360 * 0.2 - 90)
    np.testing.assert_allclose(family("chirp").acceleration(numbers, phase), expected, atol=1e-9)


def test_the_binary_sequence_is_of_maximal_length():
    """The circular autocorrelation of its 31 entries is −1 at every shift except zero."""
    bits = np.array(excitations._register())
    assert bits.size == 31
    assert set(bits.tolist()) == {1.0, -1.0}
    assert [int(bits @ np.roll(bits, k)) for k in range(31)] == [31] + [-1] * 30


def test_the_bang_bang_motion_has_the_asked_levels():
    numbers = jnp.zeros(14).at[0].set(0.8).at[1].set(-0.6)
    steep = eqx.tree_at(lambda f: f.edge, family("bang_bang"), jnp.asarray(1e-6))
    found = np.asarray(steep.acceleration(numbers, (jnp.arange(12) + 0.5) / 12))
    np.testing.assert_allclose(found, np.tile([0.8, -0.6], 6), atol=1e-12)


@pytest.mark.parametrize("criterion", ["D", "A", "E"])
def test_information_criteria_are_those_of_the_textbooks(motion, criterion):
    """The criteria agree with a loop over the rows and the eigenvalues of the covariance."""
    system = motor.system()
    states, weights = motion.midpoints(256)
    P, half_widths = np.zeros((4, 4)), np.asarray(system.half_widths)
    for _, v, a, h in zip(*map(np.asarray, states), np.asarray(weights), strict=True):
        phi = np.array([a, v, 2 / np.pi * np.arctan(1000 * v), 1.0]) * half_widths
        P += h * np.outer(phi, phi) / (0.25 if abs(v) <= 0.1 else 0.15) ** 2
    axes = np.linalg.eigvalsh(np.linalg.inv(P))
    expected = {"D": np.mean(np.log(axes)), "A": np.log(axes.sum()), "E": np.log(axes.max())}
    found = Information(system, criterion, 2.0, 256)(motion, jnp.asarray(0.0))
    # the jump of δ is spread over the change of speed between two nodes
    assert float(found) == pytest.approx(expected[criterion] / 2, abs=2e-3)


def test_a_family_is_given_at_least_the_starts_and_evaluations_of_a_design():
    """The evaluations of a design are counted stage by stage.

    After each of the first two stages of a descent, the worse half of the motions is dropped.
    """
    effort, evaluations = Effort(), 0
    assert effort.stages == 3
    lanes = [effort.starts, *[effort.variations] * effort.rounds]
    for count in lanes:
        evaluations += effort.steps * (count + max(16, count // 2) + max(16, count // 4))
    bred = (effort.starts - effort.starts // 8) * 12
    given = compare.budget(effort)
    assert given.starts == bred + effort.starts // 8 + effort.rounds * effort.variations
    assert given.evaluations >= evaluations + bred * effort.generations


@pytest.mark.slow
def test_a_search_in_a_family_improves_and_keeps_the_limits(key):
    objective = PlannedError(motor.system(), infinity(motor.system().half_widths), 2.0, 5)
    problem, one = Problem.of(TASK, objective), family("bang_bang")
    deep = interior_motion(problem, TASK.intervals, TASK.period)
    random = jax.random.normal(key, (128, one.size))
    start = min(float(problem.value(restored(problem, deep, one.trajectory(z)))) for z in random)
    z, second = best_members(problem, deep, one, key, Budget(128, 128 + 224 * 120), 2)
    searched = float(problem.value(restored(problem, deep, one.trajectory(z))))
    assert searched < start - 0.005
    other = float(problem.value(restored(problem, deep, one.trajectory(second))))
    assert searched <= other
    # the polish starts from the second-best member: it does not improve the best one
    z, found = polished_member(problem, deep, one, second, 15, (1e-3, 1e-4))
    np.testing.assert_array_equal(restored(problem, deep, one.trajectory(z)).jerk, found.jerk)
    assert float(problem.violation(found)) <= 0
    assert float(problem.value(found)) < other - 0.003


def test_the_table_is_that_of_the_motions_in_the_files(figures, tmp_path):
    """The printed table agrees with the one recomputed from the committed motions.

    All motions keep every limit. Only the minimax design is within the permitted error of all
    parameters.
    """
    for path in figures.glob("compare_*.csv"):
        shutil.copy(path, tmp_path)
    options = compare.Compare(tmp_path, figures, redraw=True)
    compare.main(options)
    assert (tmp_path / "table5.png").exists()
    again, printed = (read_table(folder / "table5.csv") for folder in (tmp_path, figures))
    assert len(printed) == 4 * len(compare.EXCITATIONS)
    least, relative = np.asarray(lower_bound(motor.system(), motor.limits()).value), {}
    for row, other in zip(printed, again, strict=True):
        assert row["excitation"] == other["excitation"]
        assert row["parameter"] == other["parameter"]
        for column in ("J_lse", "predicted"):
            assert float(row[column]) == pytest.approx(float(other[column]), rel=1e-4)
        k = motor.system().names.index(row["parameter"])
        gap = float(row["predicted"]) / least[k] - 1
        assert float(row["gap"]) == pytest.approx(gap, abs=1e-12)
        allowed = compare.ALLOWED[k]
        relative.setdefault(row["excitation"], []).append((1 + float(row["gap"])) / allowed)
    for name in compare.EXCITATIONS:
        found = read_trajectory(options.path(name))
        assert worst_violation(motor.limits(), motor.boundary(), found) <= 0
        assert found.jerk.size == TASK.intervals
    assert max(relative.pop("minimax")) < 1.0
    assert all(max(others) > 1.0 for others in relative.values())


@pytest.mark.slow
def test_an_excitation_of_each_kind_is_searched():
    options = compare.Compare(toy=True)
    assert options.path("prbs").name == "toy_compare_prbs.csv"
    for name in ("prbs", "e_optimal"):
        found, motion = compare.searched(options, name)
        assert found == name
        assert worst_violation(motor.limits(), motor.boundary(), motion) <= 0
