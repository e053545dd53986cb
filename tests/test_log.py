"""Guarantees from a log: state bounds and intervals hold, and are not much wider than necessary."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

from experiments.axes import linear_motor as motor
from experiments.axes import one_link_arm as arm
from jaxid.identification.assumptions import assumptions
from jaxid.identification.intervals import guaranteed_intervals
from jaxid.identification.modulating_functions import modulating
from jaxid.identification.regression_rows import boxes, guaranteed_estimate, hats
from jaxid.identification.state_bounds import StateBounds, state_bounds
from jaxid.loop.controllers import PDFeedforward
from jaxid.loop.disturbances import AgainstTracking, NoDisturbance, random_shares
from jaxid.loop.log import Log, filled, padded
from jaxid.loop.scenarios import random_parameters, vertices
from jaxid.loop.sensors import IdealSensor
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant, simulate
from jaxid.model.disturbance_bound import ConstantBound
from jaxid.model.interval_arithmetic import Range
from jaxid.model.regressors import Constant, Viscous
from jaxid.motion.motion_space import motion_space
from jaxid.motion.trajectory import reference, uniform
from jaxid.regression.estimators import Filtered, LeastSquares

SUBSTEPS = 10
H, Q = motor.CONTROL_PERIOD, motor.ENCODER_RESOLUTION


def law(axis):
    if axis is motor:
        return motor.controller()
    return PDFeedforward(arm.system(), jnp.asarray(arm.TRUE_PARAMETERS), 8.0, 0.5)


def experiment(axis, trajectory, theta, disturbance, resolution, period, ticks):
    """Return a log of the closed loop, and its true signals at ten steps per sample."""
    plant = Plant(axis.system(), theta, disturbance)
    servo = Servo(period, resolution)
    desired = reference(trajectory, period, ticks)
    _, signals = simulate(plant, law(axis), servo.sensor, desired, period, SUBSTEPS)
    return servo.log(signals), signals


def during(values, ticks):
    """Return the smallest and largest value in each sample period, including its ends."""
    parts = np.stack([np.asarray(values)[k : k + SUBSTEPS * ticks : SUBSTEPS] for k in range(11)])
    return parts.min(axis=0), parts.max(axis=0)


def random_motion(key, axis, intervals=20):
    """Return a random motion that need not keep the limits of a reference."""
    space = motion_space(axis.limits(), axis.boundary(), intervals, axis.KNOT_PERIOD)
    jerk = 0.3 * axis.limits().jerk[1] * jax.random.uniform(key, (intervals,), minval=-1.0)
    return uniform(space.start, jerk, axis.KNOT_PERIOD)


PLANTS = [
    (motor, 0.5e-6, 0.0002),
    (motor, 20e-6, 0.001),
    (arm, 1e-5, 0.0005),
]


@pytest.mark.parametrize(("axis", "resolution", "period"), PLANTS)
def test_brackets_hold_at_every_instant(axis, resolution, period, key):
    """State bounds contain the true states, for corners and random points of the prior box.

    The disturbance is zero, random, or opposes the tracking.
    """
    keys = jax.random.split(key, 3)
    system, motion = axis.system(), random_motion(keys[0], axis)
    n = round(float(motion.duration) / period)
    thetas = jnp.concatenate([vertices(system)[::3], random_parameters(keys[1], system, 4)])
    kinds = [NoDisturbance(), AgainstTracking(10.0), random_shares(keys[2], n)]
    for number, theta in enumerate(thetas):
        kind = kinds[number % len(kinds)]
        log, signals = experiment(axis, motion, theta, kind, resolution, period, n)
        found = state_bounds(system, log)
        rates = np.diff(signals.velocity) / (period / SUBSTEPS)
        steps = rates.reshape(n, SUBSTEPS)
        for name, (low, high), slack in (
            ("position", during(signals.position, n), 1e-12),
            ("velocity", during(signals.velocity, n), 1e-12),
            ("acceleration", (steps.min(axis=1), steps.max(axis=1)), 1e-9 / period),
        ):
            bracket = getattr(found, name)
            assert np.all(bracket.lower <= low + slack), name
            assert np.all(high <= bracket.upper + slack), name


def test_brackets_are_worth_having(motion):
    """With the box narrowed by the log, the median velocity range is below ±3 mm/s.

    The largest speed is 2 m/s, and one count per sample period is 2.5 mm/s.
    """
    ticks = round(float(motion.duration) / H)
    theta = jnp.asarray(motor.TRUE_PARAMETERS)
    log, _ = experiment(motor, motion, theta, motor.plant().disturbance, Q, H, ticks)
    found = guaranteed_intervals(motor.system(), [log], knots=75)
    v = state_bounds(found.rows.system, log).velocity
    assert np.median(v.half_width) < 3e-3


def test_a_log_that_nothing_can_have_left_is_refused(motion):
    ticks = round(float(motion.duration) / H)
    theta = jnp.asarray(motor.TRUE_PARAMETERS)
    log, _ = experiment(motor, motion, theta, NoDisturbance(), Q, H, ticks)
    jumped = eqx.tree_at(lambda x: x.position, log, log.position.at[700].add(1e-4))
    with pytest.raises(ValueError, match=r"`log` is inconsistent around sample"):
        state_bounds(motor.system(), jumped)
    pushed = eqx.tree_at(lambda x: x.input, log, log.input + 0.9)
    with pytest.raises(ValueError, match="`logs` requires dbar ≥"):
        guaranteed_intervals(motor.system(), [pushed], knots=75)
    slow = eqx.tree_at(lambda x: x.period, log, jnp.asarray(0.5))
    with pytest.raises(ValueError, match=r"`log` has a sample period of 0.5 s, which is too long"):
        state_bounds(motor.system(), slow)
    for resolution in (-1e-7, float("nan")):  # −1e-7 gave a bound of d̄ below its lower bound
        with pytest.raises(ValueError, match="`resolution` of a log must be at least zero and fin"):
            Log(log.input, log.position, H, resolution)
    with pytest.raises(ValueError, match="`period` of a log must be positive and finite"):
        Log(log.input, log.position, 0.0, Q)
    with pytest.raises(ValueError, match=r"`position` must have one entry more than `input`"):
        Log(log.input, log.position[:-1], H, Q)


@pytest.fixture(scope="module")
def quiet(motion):
    """Return θ, signals and log of an undisturbed plant with an exact sensor."""
    theta = jnp.array([0.11, 0.3, 0.2, -0.1])
    plant = Plant(motor.system(), theta, NoDisturbance())
    desired = reference(motion, H, round(float(motion.duration) / H))
    _, signals = simulate(plant, motor.controller(), IdealSensor(), desired, H, SUBSTEPS)
    return theta, signals, Log(signals.input, signals.position[::SUBSTEPS], H, 0.0)


def tick_weights(logged, weights):
    """Convert weights on rows to weights on the inputs of the n samples."""
    rows = logged.record.input.size
    inputs = jax.jacobian(lambda u: rows_input(logged, u))(jnp.zeros(rows + 1))
    return weights @ inputs


def rows_input(logged, u):
    return (u[1:] + u[:-1]) / 2 if "lag of ẏ" not in logged.channels else u[1:]


def exchanged(log, weights, system, signals, sign):
    """Return the log of the same motion under the worst-case disturbance.

    The input compensates the disturbance in every sample period.
    """
    v = during(signals.velocity, log.input.size)
    y = during(signals.position, log.input.size)
    ends = [system.disturbance_bound(jnp.asarray(a), jnp.asarray(b)) for a in y for b in v]
    least = jnp.min(jnp.stack(ends), axis=0)
    return eqx.tree_at(lambda x: x.input, log, log.input + sign * least * jnp.sign(weights))


def error_of(logged, weights, u, theta, k):
    """Return error and bound of the estimate of parameter k, for other inputs and the same rows."""
    record = eqx.tree_at(lambda r: r.input, logged.record, rows_input(logged, u))
    found = guaranteed_estimate(eqx.tree_at(lambda x: x.record, logged, record), weights)
    return float(found.theta[k] - theta[k]), float(found.bound[k])


@pytest.mark.parametrize("k", range(4))
def test_the_bound_is_reached(quiet, k):
    """With an exact sensor, the worst-case disturbance gives more than 95 % of the bound.

    This is more than 99 % of the part of the bound that is due to Δ.
    """
    theta, signals, log = quiet
    system = motor.system()
    logged = guaranteed_intervals(system, [log]).rows
    weights = modulating(logged, system.half_widths)
    on_ticks = tick_weights(logged, weights[k])
    worst, bound = error_of(
        logged, weights, exchanged(log, on_ticks, system, signals, 1.0).input, theta, k
    )
    disturbed = float(jnp.abs(weights[k]) @ logged.record.rows.delta)
    assert worst > 0.95 * bound
    assert 0.99 * disturbed < worst <= bound


def noisy(log, sign):
    """Return the log read by an encoder of 20 µm, with errors of ±half a count."""
    return Log(log.input, log.position + sign * 10e-6, log.period, 20e-6)


def without(logged, *names):
    kept = {name: c for name, c in logged.channels.items() if name not in names}
    return eqx.tree_at(lambda x: x.channels, logged, kept)


@pytest.mark.parametrize("k", range(3))
def test_without_its_quantisation_the_bound_would_be_wrong(quiet, k):
    """Worst-case disturbance and encoder errors together give more than 95 % of the bound.

    They exceed the bound without the quantisation term.
    """
    theta, signals, exact = quiet
    system = motor.system()
    logged = guaranteed_intervals(system, [noisy(exact, 0.0)]).rows
    weights = modulating(logged, system.half_widths)
    spread = logged.channels["quantised ÿ"].stencil
    wrong = -jnp.sign(jnp.convolve(weights[k], spread))
    forced = exchanged(exact, tick_weights(logged, weights[k]), system, signals, 1.0)
    rows = hats(logged.system, noisy(forced, wrong), state_bounds(system, noisy(exact, 0.0)))
    found = guaranteed_estimate(rows, weights)
    error = float(found.theta[k] - theta[k])
    assert 0.95 * float(found.bound[k]) < error <= float(found.bound[k])
    assert error > float(guaranteed_estimate(without(rows, "quantised ÿ"), weights).bound[k])


def test_without_its_lag_the_bound_of_the_papers_way_would_be_wrong(motion):
    """With an exact sensor at 1 ms, the error of B exceeds the bound without the lag term.

    Velocities by differences are half a sample period late.
    """
    period, system = 0.001, motor.system()
    plant = Plant(system, jnp.array([0.11, 0.3, 0.2, -0.1]), NoDisturbance())
    desired = reference(motion, period, round(float(motion.duration) / period))
    law = PDFeedforward(system, plant.theta, 500.0, 20.0)
    _, signals = simulate(plant, law, IdealSensor(), desired, period, SUBSTEPS)
    log = Log(signals.input, signals.position[::SUBSTEPS], period, 0.0)
    logged = boxes(system, log, state_bounds(system, log))
    weights = Filtered(LeastSquares(), 1000.0, period)(logged.record.rows, system.half_widths)
    on_ticks = tick_weights(logged, weights[1])
    errors = []
    for sign in (1.0, -1.0):
        u = exchanged(log, on_ticks, system, signals, sign).input
        error, bound = error_of(logged, weights, u, plant.theta, 1)
        errors.append(abs(error))
        assert errors[-1] <= bound
    assert max(errors) > float(guaranteed_estimate(without(logged, "lag of ẏ"), weights).bound[1])


def test_no_modulating_function_of_other_knots_or_filter_guarantees_more(quiet):
    """Neither fewer knots nor second-order filters of three bandwidths give a smaller bound."""
    _, _, log = quiet
    system = motor.system()
    logged = guaranteed_intervals(system, [log]).rows
    best = guaranteed_estimate(logged, modulating(logged, system.half_widths)).bound
    coarse = guaranteed_estimate(logged, modulating(logged, system.half_widths, knots=75)).bound
    # its objective omits some channels (6e-5); exact sensors need more knots than encoders
    assert np.all(best <= 1.0002 * coarse)
    assert np.all(coarse <= 1.15 * best)
    for w in (300.0, 1000.0, 3000.0):
        second_order = Filtered(Filtered(LeastSquares(), w, H), w, H)
        weights = second_order(logged.record.rows, system.half_widths)
        assert np.all(best <= guaranteed_estimate(logged, weights).bound)


def test_the_program_finds_what_a_bare_one_finds(quiet):
    """For a short log the bounds agree to 0.1 % with a dense linear program, solved by HiGHS.

    It has one free weight per row and all channels in its objective.
    """
    _, _, log = quiet
    short = Log(log.input[:120], log.position[:121], H, Q)
    system = motor.system()
    logged = hats(system, short, state_bounds(system, short))
    weights = modulating(logged, system.half_widths, knots=10_000)
    found = guaranteed_estimate(logged, weights).bound
    for k, bound in enumerate(bare(logged, system.half_widths)):
        # only the dense program has the channels of ẏ in its objective
        assert bound <= float(found[k]) <= bound * 1.001


def bare(logged, half_widths):
    """Yield min Σ|g|δ + Σ|S g|b + Σ|e − Φᵀg|·box, with one variable per absolute value."""
    rows, n = logged.record.rows, logged.record.rows.delta.size
    parts = [np.diag(np.asarray(rows.delta))]
    for channel in logged.channels.values():
        spread = np.stack([np.convolve(unit, channel.stencil) for unit in np.eye(n)], axis=1)
        parts.append(np.asarray(channel.bound)[:, None] * spread)
    parts.append(-np.asarray(half_widths)[:, None] * np.asarray(rows.regressors).T)
    matrix = np.concatenate(parts)
    count = len(matrix)
    for k in range(half_widths.size):
        known = np.zeros(count)
        known[count - half_widths.size + k] = float(half_widths[k])
        solution = linprog(
            np.concatenate([np.zeros(n), np.ones(count)]),
            A_ub=np.block([[matrix, -np.eye(count)], [-matrix, -np.eye(count)]]),
            b_ub=np.concatenate([-known, known]),
            bounds=[(None, None)] * n + [(0, None)] * count,
            method="highs",
        )
        yield solution.fun


def test_every_viscous_term_has_an_error_of_its_own(quiet):
    """The errors of two viscous terms add up; neither replaces the other."""
    _, _, log = quiet
    log = noisy(log, 0.0)
    system = motor.system()
    twice = eqx.tree_at(lambda s: s.terms[3].regressor, system, Viscous())
    found = state_bounds(system, log)
    weights = modulating(hats(system, log, found), system.half_widths)[:1]
    for rows in (hats, boxes):
        one, both = (rows(s, log, found).shared(weights) for s in (system, twice))
        third = eqx.tree_at(lambda s: s.terms[1].regressor, twice, Constant())
        other = rows(third, log, found).shared(weights)
        neither = eqx.tree_at(lambda s: s.terms[3].regressor, third, Constant())
        base = rows(neither, log, found).shared(weights)
        np.testing.assert_allclose(both - base, (one - base) + (other - base), rtol=1e-9)
        assert np.all(other > base)


def test_rounding_far_from_zero_is_part_of_the_bound(quiet):
    """At 1000 m, rounding of double precision causes errors of 3 m/s² in second differences.

    The quantisation term of an exact sensor covers them.
    """
    _, _, log = quiet
    far = eqx.tree_at(lambda x: x.position, log, log.position + 1000.0)
    one, other = (hats(motor.system(), x, state_bounds(motor.system(), x)) for x in (log, far))
    wrong = np.abs(one.record.rows.columns[0] - other.record.rows.columns[0])
    most = float(motor.system().upper[0])
    # three readings per row, with the coefficients 1, −2 and 1
    allowed = 4 * np.max(other.channels["quantised ÿ"].bound) / most
    assert 0 < np.max(wrong) <= allowed


def test_what_a_guarantee_rests_on_is_said(quiet):
    """The assumptions name terms, prior box, δ, scale of the input, hold, delay and encoder.

    Values have their units.
    """
    _, _, log = quiet
    text = " ".join(assumptions(motor.system().with_scaled_disturbance(2.0), noisy(log, 0.0)))
    for part in (
        "u = M·ÿ + B·ẏ + Fc·(2/π)·arctan(1000·ẏ) + dbar + Δ, without any other term.",
        "The input u is known exactly, scale and sign included, in V.",
        "M in [0.08, 0.18] V s²/m",
        "0.5 V up to 0.1 m/s and 0.3 V above",
        "acts without delay and is held constant (zero-order hold) over each sample period of 0.2",
        "with an error of at most ±10 µm; its scale is exact.",
    ):
        assert part in text
    level = assumptions(arm.system(), Log(log.input, log.position, H, 0.0))[2]
    assert arm.system().input_unit in level
    assert "exactly" in assumptions(motor.system(), log)[5]


def test_ticks_that_only_fill_the_arrays_up_change_nothing(quiet):
    system, (_, _, exact) = motor.system(), quiet
    log = noisy(exact, 1.0)
    one, other = (
        guaranteed_intervals(system, [x]) for x in (log, filled(log, log.input.size + 700))
    )
    np.testing.assert_allclose(one.estimate.bound, other.estimate.bound, rtol=1e-12)
    np.testing.assert_allclose(one.estimate.theta, other.estimate.theta, rtol=1e-11)
    ranges = (state_bounds(system, x)[:3] for x in (log, filled(log, 4000)))
    for own, longer in zip(*map(jax.tree.leaves, ranges), strict=True):
        np.testing.assert_allclose(own, longer[: own.size], rtol=1e-12, atol=1e-12)


def stripped(logged, delta, term):
    """Return rows without one of the terms that cover the motion between the samples."""
    if term == "interpolated ẏ of B":
        return without(logged, term)
    plain = jnp.full_like(logged.record.rows.delta, delta)
    return eqx.tree_at(lambda x: x.record.rows.delta, logged, plain)


# terms of the axis, δ and sample period for which the term of the bound matters
SAMPLING = {
    "brackets of regressors": ((0, 1, 2, 3), 1e-4, 0.001),
    "interpolated ẏ of B": ((0, 1, 3), 1e-7, 0.0002),
}


@pytest.mark.parametrize("term", SAMPLING)
def test_without_its_sampling_terms_the_bound_would_be_wrong(term, motion):
    """Without the term, the error is more than 20 % above the bound.

    The sensor is exact, δ is small, and there is no disturbance.
    """
    kept, delta, period = SAMPLING[term]
    whole = motor.system()
    system = eqx.tree_at(lambda s: s.terms, whole, tuple(whole.terms[k] for k in kept))
    system = system.with_disturbance_bound(ConstantBound(delta))
    theta = jnp.array([0.11, 0.3, 0.2, -0.1])[jnp.array(kept)]
    desired = reference(motion, period, round(float(motion.duration) / period))
    plant = Plant(system, theta, NoDisturbance())
    _, signals = simulate(plant, motor.controller(), IdealSensor(), desired, period, SUBSTEPS)
    log = Log(signals.input, signals.position[::SUBSTEPS], period, 0.0)
    logged = guaranteed_intervals(system, [log]).rows
    bare = stripped(logged, delta, term)
    weights = modulating(bare, system.half_widths)
    wrong, right = guaranteed_estimate(bare, weights), guaranteed_estimate(logged, weights)
    assert np.max(jnp.abs(wrong.theta - theta) / wrong.bound) > 1.2
    assert np.all(jnp.abs(right.theta - theta) <= right.bound)


@pytest.mark.parametrize("rows", [hats, boxes])
def test_the_error_of_interpolation_is_what_the_worst_motion_has(rows):
    """Alternating accelerations ±A attain the bound of the interpolation error.

    The error is the difference from exact integrals: of the trapezoidal rule for ∫hat·ẏ, or of
    backward differences for the mean of ÿ. Half of the bound would be too small.
    """
    h, n, A = 1e-3, 40, 3.0
    system = motor.system()
    a = A * (-1.0) ** np.arange(n)
    v = np.append(0.0, np.cumsum(a * h))
    y = np.append(0.0, np.cumsum(v[:-1] * h + a * h**2 / 2))
    log = Log(jnp.zeros(n), jnp.asarray(y), h, 0.0)
    band = Range(jnp.full(n, -A), jnp.full(n, A))
    still = Range(jnp.asarray(np.minimum(v[:-1], v[1:])), jnp.asarray(np.maximum(v[:-1], v[1:])))
    place = Range(jnp.asarray(np.minimum(y[:-1], y[1:])), jnp.asarray(np.maximum(y[:-1], y[1:])))
    found = rows(system, log, StateBounds(place, still, band, jnp.zeros(n + 1)))
    if (
        rows is hats
    ):  # ∫ t/h·(v + a t) over the first sample period, ∫ (1 − t/h)·(v + a t) over the second
        exact = (v[:-2] + v[1:-1]) / 2 + h * (a[:-1] / 3 + a[1:] / 6)
        column, name, most = 1, "interpolated ẏ of B", 0.5
    else:
        exact, column, name, most = a[1:], 0, "lag of ẏ", 0.18
    error = np.abs(np.asarray(found.record.rows.columns[column]) - exact)
    bound = np.asarray(found.channels[name].worst(jnp.eye(n - 1))) / most
    assert np.all(error <= bound * (1 + 1e-9))
    assert np.max(error / bound) > 0.99


def test_logs_of_many_lengths_are_padded_to_few():
    """There are four lengths per factor of two; a quarter more samples at most are computed."""
    lengths = np.unique(np.geomspace(2, 60_000, 300).round().astype(int))
    logs = [padded(Log(np.ones(n), np.ones(n + 1), 1e-3, 1e-6)) for n in lengths]
    sizes = np.array([log.input.size for log in logs])
    assert [log.samples for log in logs] == lengths.tolist()
    assert np.all(sizes <= np.maximum(1.25 * lengths, 32))
    assert len(np.unique(sizes)) <= 4 * np.log2(60_000 / 32) + 2
    assert padded(logs[-1]).input.size == sizes[-1]
