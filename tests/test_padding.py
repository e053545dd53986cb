"""Padding, which gives arrays one shape, changes no result of any function."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from adversaries import exact_rows

from experiments.axes import linear_motor as motor
from jaxid.design.criteria import FilteredError, PerfectTracking, PlannedError, ThroughLoop
from jaxid.design.nominal_log import nominal_log, nominal_log_model
from jaxid.design.predicted_error import PredictedError
from jaxid.identification.feasible_parameter_set import feasible_set
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.identification.state_bounds import state_bounds
from jaxid.io.files import read_trajectory, write_trajectory
from jaxid.io.setpoints import sampled
from jaxid.loop.closed_loop import ClosedLoop, SampledPlants, plant_violations
from jaxid.loop.log import filled
from jaxid.loop.scenarios import every
from jaxid.loop.sensors import Encoder, IdealSensor
from jaxid.loop.servo import Servo
from jaxid.loop.tube import Tube, parameter_cells
from jaxid.motion.task import Task
from jaxid.motion.ticks import Ticks
from jaxid.motion.trajectory import JerkTrajectory, ticks, uniform
from jaxid.motion.violation import violations, worst_violation
from jaxid.regression.error_of_motion import planned_error
from jaxid.regression.filtered_least_squares import filtered_least_squares
from jaxid.regression.minimax import minimax
from jaxid.regression.worst_case import infinity

H, T = 1e-3, 0.01  # s: sample period, knot period
SYSTEM = motor.system()
NORM = infinity(SYSTEM.half_widths)
MOTION = uniform(
    jnp.zeros(3), jnp.array([900.0, -900.0, -900.0, 900.0, 0.0, -900.0, 900.0, 900.0, -900.0]), T
)
TICKS, MOST = ticks(MOTION, H), 130  # number of samples of this motion, and of a longer one


def stuffed(motion: JerkTrajectory, places: list[int], jerk: float) -> JerkTrajectory:
    """Return the motion with intervals of zero duration inserted at some places."""
    return JerkTrajectory(
        motion.start,
        jnp.asarray(np.insert(np.asarray(motion.jerk), places, jerk)),
        jnp.asarray(np.insert(np.asarray(motion.durations), places, 0.0)),
    )


PADDED = {
    # as many as in the others, for a single compilation
    "at the end": stuffed(MOTION, [9] * 6, 0.0),
    "everywhere": stuffed(MOTION, [0, 0, 4, 9, 9, 9], 0.0),
    "with a jerk": stuffed(MOTION, [0, 0, 4, 9, 9, 9], 1500.0),
}
CRITERIA = {
    "planned": lambda most: PlannedError(SYSTEM, NORM, 2.0),
    "perfect": lambda most: PerfectTracking(
        SYSTEM, FilteredError(NORM, 200.0, H), 2.0, H, most, repeats=2
    ),
    "loop": lambda most: through(most, IdealSensor()),
    "loop with an encoder": lambda most: through(most, Encoder(1e-6)),
}


def loop(most: int, sensor, repeats: int = 2) -> ClosedLoop:
    return ClosedLoop(motor.controller(), sensor, H, most, repeats, substeps=2)


def plants():
    return every(SYSTEM, SYSTEM.centre[None], [motor.plant().disturbance])


def through(most: int, sensor) -> ThroughLoop:
    return ThroughLoop(loop(most, sensor), plants(), FilteredError(NORM, 200.0, H), 2.0, 0.005)


@eqx.filter_jit
def value_and_slope(criterion, motion, smoothing):
    """Return the criterion and its gradient by the jerk."""
    return jax.value_and_grad(
        lambda jerk: criterion(eqx.tree_at(lambda t: t.jerk, motion, jerk), smoothing)
    )(motion.jerk)


@pytest.mark.parametrize("smoothing", [0.0, 1e-3])
@pytest.mark.parametrize("name", CRITERIA)
def test_a_criterion_is_that_of_the_motion_alone(name, smoothing, quick_compilation):
    """Padding, and arrays for a longer motion, change neither value nor gradient."""
    slope = name != "loop with an encoder"
    # without smoothing there are kinks, and this motion rests at some
    slope = slope and smoothing > 0
    of = value_and_slope if slope else eqx.filter_jit(lambda c, *rest: (c(*rest), jnp.zeros(1)))
    value, gradient = of(CRITERIA[name](TICKS), MOTION, jnp.asarray(smoothing))
    for motion in PADDED.values():
        found, slopes = of(CRITERIA[name](MOST), motion, jnp.asarray(smoothing))
        np.testing.assert_allclose(found, value, rtol=1e-9)
        if slope:
            lasting = np.asarray(slopes)[np.asarray(motion.durations) > 0]
            close(lasting, gradient, rtol=1e-6)


def close(one, other, rtol=1e-9):
    """Require that all arrays of two trees are equal up to rounding."""
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        a, b = np.asarray(a), np.asarray(b)
        np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol * np.max(np.abs(b)))


@pytest.fixture(scope="module")
def alone():
    """Run the unpadded motion in closed loop with an encoder."""
    return loop(TICKS, Encoder(1e-6))(motor.plant(), MOTION)


@pytest.fixture(scope="module", params=["everywhere", "with a jerk"])
def among_longer(request):
    """Run the padded motion in a closed loop with arrays for a longer motion."""
    return loop(MOST, Encoder(1e-6))(motor.plant(), PADDED[request.param])


def test_ticks_of_a_motion_are_those_that_begin_within_it():
    """Counts and arrays are compared with explicit lists."""
    found = Ticks.of(jnp.asarray(0.003), 1e-3, 5, repeats=2)
    assert (int(found.count), int(found.total)) == (3, 6)
    assert found.counted.tolist() == [True] * 6 + [False] * 4
    once = jnp.array([1.0, 2.0, 3.0, 4.0, 4.0])
    whole = found.repeated(once)
    assert whole.tolist() == [1, 2, 3, 1, 2, 3, 4, 4, 4, 4]
    assert found.held(whole).tolist() == [1, 2, 3, 1, 2, 3, 3, 3, 3, 3]
    assert found.by_repeat(whole).tolist() == [[1, 2, 3, 3, 3]] * 2
    twice = jnp.arange(21.0)
    assert found.held(twice, 2, first=1).tolist() == [*range(13), *[12] * 8]
    for duration, count in ((0.0, 1), (0.0029, 3), (0.0030000000001, 3), (0.0031, 4), (1.0, 5)):
        assert int(Ticks.of(jnp.asarray(duration), 1e-3, 5).count) == count


def test_a_record_has_no_other_rows_that_count(alone, among_longer, quick_compilation):
    (record, _), (longer, _) = alone, among_longer
    counted = np.asarray(longer.rows.counted)
    assert counted.sum() == 2 * TICKS < counted.size
    close(jax.tree.map(lambda x: x[counted], longer), record)
    for row in (longer.input, longer.rows.delta, *longer.rows.columns):
        assert not np.any(np.asarray(row)[~counted])
    one, other = (filtered_least_squares(x, SYSTEM, 200.0, H) for x in (record, longer))
    close(other, one)
    one, other = (minimax(x.rows, SYSTEM.half_widths) for x in (record, longer))
    close(other.error, one.error)


def test_signals_stay_what_they_were_in_the_last_tick(alone, among_longer):
    (_, signals), (_, longer) = alone, among_longer
    assert np.asarray(longer.counted).sum() == 2 * TICKS
    for part, whole in zip(*map(jax.tree.leaves, (signals, longer)), strict=True):
        close(whole[: len(part)], part)
        assert np.all(np.asarray(whole[len(part) :]) == part[-1])


def test_what_its_log_proves_is_the_same(alone, among_longer, quick_compilation):
    """State bounds, intervals and the feasible parameter set, for a log padded in two ways."""
    servo = Servo(H, 1e-6)
    log, longer = (servo.log(signals) for _, signals in (alone, among_longer))
    assert bool(jnp.all(log.counted))
    n, own = log.input.size, state_bounds(SYSTEM, log)
    one = guaranteed_intervals(SYSTEM, [log], knots=20)
    left = feasible_set(one.rows, [one.estimate], knots=20)
    for other in (longer, filled(log, MOST * 2)):
        assert int(jnp.sum(other.counted)) == n
        found = state_bounds(SYSTEM, other)
        assert other.input.size == 2 * MOST
        close(jax.tree.map(lambda x: x[:n], found[:3]), own[:3])
        again = guaranteed_intervals(SYSTEM, [other], knots=20)
        close(again.estimate, one.estimate, rtol=1e-8)
        close(feasible_set(again.rows, [again.estimate], knots=20), left, rtol=1e-8)


def test_all_that_a_record_leaves_possible_is_the_same(alone, among_longer):
    (record, _), (longer, _) = alone, among_longer
    one, other = (feasible_set(exact_rows(SYSTEM, x), knots=20) for x in (record, longer))
    close(other, one, rtol=1e-8)


@pytest.mark.parametrize("name", ["everywhere", "with a jerk"])
def test_envelopes_of_plants_and_tubes_are_the_same(name, quick_compilation):
    padded, limits = PADDED[name], motor.limits()
    found, wide = (
        SampledPlants(loop(most, Encoder(1e-6)), plants())(motion)
        for most, motion in ((TICKS, MOTION), (MOST, padded))
    )
    close(jax.tree.map(lambda x: x[:TICKS], wide), found)
    for x in jax.tree.leaves(wide):
        assert np.all(x[TICKS:] == x[TICKS - 1])
    excess, same = (
        plant_violations(loop(most, Encoder(1e-6)), plants(), limits, motion)
        for most, motion in ((TICKS, MOTION), (MOST, padded))
    )
    close(same, excess)
    law, cells = motor.provable_controller(), parameter_cells(SYSTEM, (1, 1, 1, 1))
    proved, room = (
        Tube(law, Encoder(1e-6), cells, H, most, repeats=2)(motion)
        for most, motion in ((TICKS, MOTION), (MOST, padded))
    )
    close(jax.tree.map(lambda x: x[:TICKS], room), proved)


@eqx.filter_jit
def numbers_of_the_plan(motion):
    """Return numbers that depend on the motion only, without an axis."""
    limits, boundary = motor.limits(), motor.boundary()
    sides = violations(limits, boundary, motion)
    return {
        "extrema": motion.extrema(),
        "worst violation": worst_violation(limits, boundary, motion),
        "worst sides": [jnp.max(side) for side in sides],
        "penalties": [jnp.sum(jnp.maximum(side, 0) ** 2) for side in sides],
        "planned error": planned_error(SYSTEM, motion, 64),
    }


# negative jerk everywhere: padding with zero jerk would be the largest entry
ONE_SIDED = uniform(jnp.zeros(3), jnp.array([-900.0, -300.0, -900.0, -30.0] * 2 + [-9.0]), T)


@pytest.mark.parametrize("alone", [MOTION, ONE_SIDED], ids=["motion", "one-sided"])
def test_numbers_of_a_plan_are_the_same(alone, quick_compilation):
    found = numbers_of_the_plan(alone)
    for places, jerk in (([9] * 6, 0.0), ([0, 0, 4, 9, 9, 9], 0.0), ([0, 0, 4, 9, 9, 9], 1500.0)):
        close(numbers_of_the_plan(stuffed(alone, places, jerk)), found)


@pytest.mark.parametrize("name", PADDED)
def test_files_of_a_motion_are_the_same(name, tmp_path):
    close(sampled(PADDED[name], H), sampled(MOTION, H), rtol=1e-12)
    write_trajectory(tmp_path / "motion.csv", PADDED[name])
    again = read_trajectory(tmp_path / "motion.csv")
    np.testing.assert_array_equal(again.jerk, MOTION.jerk)


LONGER = uniform(jnp.zeros(3), jnp.zeros(MOST // 10), T)


@pytest.mark.parametrize("controller", [None, motor.controller()], ids=["exact", "loop"])
def test_a_nominal_log_is_the_same(controller, quick_compilation):
    """The log of the padded motion, and that of a model made for longer motions."""
    servo = Servo(H, 1e-6)
    log = nominal_log(SYSTEM, MOTION, servo, controller)
    model = eqx.filter_jit(nominal_log_model(SYSTEM, LONGER, servo, controller))
    for motion in PADDED.values():
        own = nominal_log(SYSTEM, motion, servo, controller)
        close((own.input, own.position), (log.input, log.position))
        wide, states = model(motion)
        assert wide.input.size == states.position.size == MOST
        assert int(jnp.sum(wide.counted)) == TICKS
        close((wide.input[:TICKS], wide.position[: TICKS + 1]), (log.input, log.position))


def test_a_predicted_error_is_the_same(quick_compilation):
    task, servo = Task(motor.limits(), motor.boundary(), 9, T), Servo(H, 1e-6)
    criterion = PredictedError(SYSTEM, SYSTEM.half_widths, servo).near(task, MOTION)
    model = nominal_log_model(SYSTEM, LONGER, servo)
    room = eqx.tree_at(lambda c: c.log_model, criterion, model)
    value, slope = value_and_slope(criterion, MOTION, jnp.asarray(1e-3))
    for motion in (PADDED["everywhere"], PADDED["with a jerk"]):
        found, slopes = value_and_slope(room, motion, jnp.asarray(1e-3))
        close(found, value, rtol=1e-8)
        close(slopes[np.asarray(motion.durations) > 0], slope, rtol=1e-5)
