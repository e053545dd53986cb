"""Theorem 4: the tracking error of ARC in closed loop, on many plants and disturbances."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from adversaries import square_wave
from conftest import uniform_in_box
from hypothesis import given
from hypothesis import strategies as st

from experiments.axes import linear_motor as motor
from jaxid.loop.controllers import ARC, Delayed, OpenLoop, PDFeedforward
from jaxid.loop.disturbances import (
    AgainstTracking,
    Disturbance,
    NoDisturbance,
    Sequence,
    random_shares,
)
from jaxid.loop.sensors import Encoder, IdealSensor, Measurement
from jaxid.loop.simulate import Plant, simulate
from jaxid.motion.trajectory import States, reference, ticks

PERIOD = motor.CONTROL_PERIOD
PLANTS = 1000


def disturbances(controller: ARC, ticks: int) -> dict[str, Disturbance]:
    return {
        "random": random_shares(jax.random.key(1), ticks),
        "constant": Sequence(jnp.ones(ticks)),
        "square wave": square_wave(ticks, 250),
        "adversarial": AgainstTracking(controller.k1),
    }


@eqx.filter_jit
def largest_ratio(controller, motion, disturbance, thetas, law=None):
    """Return the largest V_s / bound over plants and samples, with the bound (27) of `law`."""
    law = law or controller
    desired = reference(motion, PERIOD, 3000)

    def one(theta):
        plant = Plant(motor.system(), theta, disturbance)
        _, signals = simulate(plant, controller, IdealSensor(), desired, PERIOD)
        y, v = signals.position[:-1], signals.velocity[:-1]
        p = v - desired.velocity + law.k1 * (y - desired.position)
        energy = theta[0] * p**2 / 2
        rate = 2 * law.k2 / law.system.upper[0]
        fade = jnp.exp(-rate * signals.time[:-1])
        bound = fade * energy[0] + law.epsilon / rate * (1 - fade)
        # both are zero at t = 0; a maximum over a long array may ignore NaN
        ratio = energy[1:] / bound[1:]
        return jnp.max(jnp.where(jnp.isnan(ratio), jnp.inf, ratio))

    return jnp.max(jax.lax.map(one, thetas, batch_size=50))


@pytest.fixture(scope="module")
def thetas():
    system = motor.system()
    return uniform_in_box(jax.random.key(0), system.lower, system.upper, PLANTS)


@pytest.mark.parametrize("kind", ["random", "constant", "square wave", "adversarial"])
def test_theorem_4a_energy_stays_below_its_bound_at_every_tick(kind, motion, thetas):
    controller = motor.controller()
    disturbance = disturbances(controller, 3000)[kind]
    assert largest_ratio(controller, motion, disturbance, thetas) <= 1.0


def test_the_robust_term_meets_26_at_every_point_and_no_more(key):
    """p·(u_s2 + φ'ᵀθ̃ − Δ) ≤ ε for all θ in the box and |Δ| ≤ δ, with equality at |p| = 2ε/h."""
    law, n = motor.controller(), 500
    own = law.system

    @jax.jit
    def reached(draw, hat, share):
        y, v, a, e, _ = draw
        phi = own.regressors(y, v, a)
        # the largest |φ'ᵀθ̃ − Δ| that the controller allows for: box widths and δ
        h = sum(abs(f) * w for f, w in zip(phi, own.upper - own.lower, strict=True))
        h = h + own.disturbance_bound(y, v)
        p = share * 2 * law.epsilon / h
        # a reference for which the measured state has this p and φ'
        e_rate = p - law.k1 * e
        desired = States(y - e, v - e_rate, a + law.k1 * e_rate)
        u, _ = law.step(tuple(hat), desired, Measurement(y, v), jnp.asarray(PERIOD))
        u_s2 = u - sum(f * t for f, t in zip(phi, hat, strict=True)) + law.k2 * p
        return (p * u_s2 + abs(p) * h) / law.epsilon

    draws = jax.random.normal(key, (n, 5))
    hats = uniform_in_box(key, own.lower, own.upper, n)
    shares = (-4.0, -1.0, -0.3, 0.5, 1.0, 2.0)
    found = [jax.vmap(reached, (0, 0, None))(draws, hats, share) for share in shares]
    assert np.max(found) <= 1 + 1e-9
    assert np.max(found) > 1 - 1e-9


def test_theorem_4a_needs_the_robust_term(motion, thetas):
    """Without u_s2 (ε → ∞ in the controller only) the bound is exceeded: the test can fail."""
    law = motor.controller()
    weak = eqx.tree_at(lambda c: c.epsilon, law, jnp.asarray(jnp.inf))
    adversary = AgainstTracking(law.k1)
    assert largest_ratio(weak, motion, adversary, thetas[:200], law) > 1.0


def test_theorem_4a_needs_the_signs_mended(motion, thetas, monkeypatch):
    """With (20)-(21) as printed, V_s exceeds its bound.

    In φ' acceleration and friction then have opposite signs.
    """

    def printed(self, y, v, x2eq_rate):
        acceleration, *forces = self.system.regressors(y, v, x2eq_rate)
        return (-acceleration, *forces)

    law = motor.controller()
    monkeypatch.setattr(ARC, "model_regressors", printed)
    jax.clear_caches()  # discard code that was compiled with the correct signs
    ratio = largest_ratio(law, motion, NoDisturbance(), thetas[:20])
    jax.clear_caches()
    assert not ratio <= 1.0  # larger than the bound, or NaN


class Until(Disturbance):
    """A disturbance that ends at a given time, s (Theorem 4 B)."""

    disturbance: Disturbance
    end: jax.Array

    def __call__(self, moment, position, velocity, delta):
        value = self.disturbance(moment, position, velocity, delta)
        return jnp.where(moment.time < self.end, value, 0.0)


def floor_of_tracking(period: float, motion) -> tuple[float, float]:
    """Return the largest |e| and |p| in the last of 50 repetitions; Δ ends after the second one."""
    duration, count = float(motion.duration), ticks(motion, period)
    controller = motor.controller()
    # with Γ a thousand times larger, 50 repetitions suffice instead of thousands
    controller = eqx.tree_at(lambda c: c.gamma, controller, 1000 * controller.gamma)
    desired = reference(motion, period, count, 50)
    adversary = Until(AgainstTracking(controller.k1), jnp.asarray(2 * duration))
    plant = Plant(motor.system(), motor.TRUE_PARAMETERS, adversary)
    _, signals = simulate(plant, controller, IdealSensor(), desired, period)
    e = signals.position[:-1] - desired.position
    p = signals.velocity[:-1] - desired.velocity + controller.k1 * e
    e, p = (np.abs(np.asarray(x)).reshape(50, count).max(axis=1) for x in (e, p))
    assert e[-1] < 0.05 * e[0]
    assert p[-1] < 0.1 * p[0]
    assert e[-1] == pytest.approx(e[-10], rel=0.01)  # it has converged and no longer decreases
    return float(e[-1]), float(p[-1])


def test_theorem_4b_errors_decay_to_a_floor_that_shrinks_with_the_period(motion):
    """The remaining tracking errors decrease with the sample period.

    Measured at 0.4, 0.2 and 0.1 ms: |e| of 1.04, 0.51 and 0.25 µm; |p| of 0.45, 0.41 and 0.12 mm/s,
    a peak at v = 0.
    """
    e, p = zip(*(floor_of_tracking(period, motion) for period in (4e-4, 2e-4, 1e-4)), strict=True)
    assert all(finer < 0.6 * coarser for coarser, finer in itertools.pairwise(e))
    assert p[0] > p[1] > p[2]
    assert p[2] < 0.5 * p[0]


def test_estimates_stay_in_the_box_and_move(motion):
    controller = motor.controller()
    controller = eqx.tree_at(lambda c: c.gamma, controller, 1000 * controller.gamma)
    _, signals = simulate(
        motor.plant(), controller, IdealSensor(), reference(motion, PERIOD, 3000), PERIOD
    )
    system = motor.system()
    for j, estimate in enumerate(signals.controller):
        assert jnp.all(system.lower[j] <= estimate)
        assert jnp.all(estimate <= system.upper[j])
        assert jnp.ptp(estimate) > 0


@given(st.integers(0, 10_000), st.floats(-8.0, 2.0))
def test_projection_keeps_the_box_and_never_takes_the_estimate_away_from_the_truth(seed, size):
    """(22)-(24) for one sample: the projection never moves θ̂ away from any θ in Ω_θ.

    Distances are measured with Γ⁻¹, as in the proof of Theorem 4. Γ ranges over ten decades, up to
    steps that are many times larger than the box.
    """
    rng = np.random.default_rng(seed)
    system = motor.system()
    gamma = 10.0**size * rng.uniform(0.1, 1.0, 4) / PERIOD
    controller = eqx.tree_at(lambda c: c.gamma, motor.controller(), jnp.asarray(gamma))
    hat, true = (rng.uniform(system.lower, system.upper) for _ in range(2))
    y, v, *wanted = map(jnp.asarray, rng.uniform(-1.0, 1.0, 5))
    reference = States(*wanted)
    state = tuple(map(jnp.asarray, hat))
    _, adapted = controller.step(state, reference, Measurement(y, v), jnp.asarray(PERIOD))
    e, e_rate = y - reference.position, v - reference.velocity
    p = e_rate + controller.k1 * e
    phi = controller.model_regressors(y, v, reference.acceleration - controller.k1 * e_rate)
    free = hat - PERIOD * gamma * np.asarray(phi) * float(p)  # Euler step of (22)
    adapted = np.asarray(adapted)
    inside = (system.lower <= free) & (free <= system.upper)
    assert np.all((system.lower <= adapted) & (adapted <= system.upper))
    np.testing.assert_allclose(adapted[inside], free[inside], rtol=1e-12, atol=1e-15)
    apart, unprojected = (np.sum((x - true) ** 2 / gamma) for x in (adapted, free))
    assert apart <= unprojected * (1 + 1e-12)


def test_robust_term_meets_its_two_conditions():
    """(26) on random regressors: p(u_s2 + φ'ᵀθ̃ − Δ) ≤ ε and p·u_s2 ≤ 0, equality at |p| = 2ε/h."""
    controller = motor.controller()
    system = motor.system()
    rng = np.random.default_rng(0)
    for _ in range(200):
        y, v, rate = rng.uniform(-0.01, 0.4), rng.uniform(-2, 2), rng.uniform(-60, 60)
        phi = controller.model_regressors(*map(jnp.asarray, (y, v, rate)))
        h = float(controller.mismatch(phi, jnp.asarray(y), jnp.asarray(v)))
        hat, true = (rng.uniform(system.lower, system.upper) for _ in range(2))
        delta = float(system.disturbance_bound(jnp.asarray(y), jnp.asarray(v)))
        gap = float(sum(f * (a - b) for f, a, b in zip(phi, hat, true, strict=True)))
        epsilon = float(controller.epsilon)
        for p in (*rng.uniform(-1, 1, 5), 2 * epsilon / h):
            u_s2 = -(h**2) * p / (4 * epsilon)
            assert p * u_s2 <= 0
            assert p * (u_s2 + gap - rng.uniform(-delta, delta)) <= epsilon * (1 + 1e-12)
        worst = 2 * epsilon / h
        assert worst * (-(h**2) * worst / (4 * epsilon) + h) == pytest.approx(epsilon)


def test_pd_with_feedforward_tracks_too(motion):
    controller = PDFeedforward(motor.system(), motor.TRUE_PARAMETERS, 8000.0, 80.0)
    desired = reference(motion, PERIOD, 3000)
    sensor = Encoder(motor.ENCODER_RESOLUTION)
    _, signals = simulate(motor.plant(), controller, sensor, desired, PERIOD)
    assert jnp.max(jnp.abs(signals.position[:-1] - desired.position)) < 5e-4


def test_gains_must_be_positive():
    with pytest.raises(ValueError, match="`k1` must be positive, but is -1"):
        ARC(motor.system(), k1=-1.0, k2=1.0, epsilon=1.0, gamma=jnp.ones(4))
    with pytest.raises(ValueError, match=r"`gamma` must have no negative entry, but is \[0\.0, -1"):
        ARC(motor.system(), k1=1.0, k2=1.0, epsilon=1.0, gamma=jnp.array([0.0, -1.0, 1.0, 1.0]))


def test_a_delayed_law_commands_what_the_law_commanded_then():
    """A delay of 2 repeats the first command twice, and then gives the series two samples late."""
    series = jnp.array([0.3, -0.1, 0.4, 0.1, -0.5, 0.9])
    law = Delayed(OpenLoop(series), 2)
    at_rest = Measurement(jnp.zeros(()), jnp.zeros(()))
    reference, state, found = States(*jnp.zeros((3, 1))), law.initial(), []
    for _ in range(6):
        u, state = law.step(state, reference, at_rest, jnp.asarray(0.001))
        found.append(float(u))
    assert found == [0.3, 0.3, *series[:4].tolist()]
