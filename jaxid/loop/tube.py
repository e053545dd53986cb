"""Proved ranges of the motion of an axis under ARC, for sampled control, encoder and all plants.

Let y*, v*, a* be the reference, e = y − y*, s = v − v*, p = s + k₁e at the samples, h the period,
and K = k₂ + h(φ')²/4ε the feedback gain of (25)-(26). The controller reads y + q and v + g + n. An
encoder has |q| ≤ half a count; its velocity is a difference, so that n = (q − q₋)/h, q₋ being the
error one sample before, and g = −(1/h)∫(t − t₋)v̇ dt over the period before: the mean speed lags.
For an exact sensor all three are zero. Hence

    u = M̂(a* − k₁(s + g + n)) + θ̂_fᵀ f(as read) − K(p + g + n + k₁q)

for one period, in which M v̇ = u − θ_fᵀ f(y, v) − Δ. Integrated over it, with f̄ and Δ̄ the means of f
and Δ, Δx* the change of the reference, and r = ∫₀ʰ(h − t)v̇ dt − (Δy* − h v*):

    s⁺ = s·(1 − λ) − (hKk₁/M)·e + (h/M)·X − Δv* − λn,     λ = h(M̂k₁ + K)/M
    p⁺ = p·(1 + b − hK/M) − k₁b·e + (h/M)·X − Δv* + k₁r − λn,     b = hk₁(1 − M̂/M)
    e⁺ = e·(1 − hk₁) + h·p + r
    X  = M̂(a* − k₁g) + θ̂_fᵀ f(as read) − K(g + k₁q) − θ_fᵀ f̄ − Δ̄

Each is an identity. Differenced noise nearly cancels from sample to sample, so s and p are replaced
by s̃ = s + κq₋/h and p̃ = p + κq₋/h, with any numbers κ that are known beforehand: −λn then
becomes (λ − ακ)q₋/h + (κ⁺ − λ)q/h, α being the factor of s or p, and is small where κ is near λ.
(The κ are midpoints of ranges, so that they do not depend on the plant.)

If e, s̃, p̃ and g lie in ranges at a sample, interval arithmetic gives ranges at the next one. Since
s̃ = p̃ − k₁e, the ranges of both are intersected. The right-hand sides are affine in each of 1/M, M̂
and K with the others fixed, so their extremes lie at the ends of these. At t = 0 the axis rests at
the start of the reference, so e = g = 0 and s = p = −v*: by induction the ranges hold at every
sample, for every θ in the cell of Ω_θ that M and θ_f were taken from, every Δ within δ and every
error of the sensor. The tube is the union over cells that cover Ω_θ; in small cells the dependence
between M, friction and p is nearly kept.

Within a period f̄, Δ̄ and v̇ are bounded over a range of speeds that the axis cannot leave: if |v̇| ≤ A
as long as v is within w of its initial value, and hA ≤ w, then v stays within w. Where no such w is
found, the tube is infinite.
"""

import functools
import itertools
import operator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxid._checks import require_float64
from jaxid._types import Scalar, as_array
from jaxid.loop.controllers import ARC
from jaxid.loop.sensors import Sensor, SensorError
from jaxid.model.interval_arithmetic import Range, around, exactly, where
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory, States, reference, ticks_of
from jaxid.motion.violation import Envelope, Prediction

# widening of ranges at every sample, and of the result, relative to 1 and to the value: far more
# than the rounding errors of one sample
_ROUNDING = 1e-13


def parameter_cells(system: System, parts: tuple[int, ...]) -> Range:
    """Return Ω_θ divided into c cells of equal size, as ranges of shape (c, m).

    Args:
        system: system with its prior box Ω_θ.
        parts: number of cells along each of the m parameters; c is their product.
    """
    edges = [
        np.linspace(float(term.interval[0]), float(term.interval[1]), count + 1)
        for term, count in zip(system.terms, parts, strict=True)
    ]
    lower = np.meshgrid(*(edge[:-1] for edge in edges), indexing="ij")
    upper = np.meshgrid(*(edge[1:] for edge in edges), indexing="ij")
    return Range(*(np.stack([x.ravel() for x in ends], axis=1) for ends in (lower, upper)))


class Tube(Prediction):
    """A prediction of the axis under ARC, proved for every θ in Ω_θ and every |Δ| ≤ δ.

    The derivation is in the module `jaxid.loop.tube`.

    Attributes:
        controller: adaptive robust controller, `ARC` itself and not a subclass. Where it adapts, θ̂
            may be anywhere in Ω_θ; the ranges are narrowest without adaptation.
        sensor: sensor that the controller reads.
        cells: cells of θ, shape (c, m), that cover Ω_θ; nothing is proved outside them.
        period: sample period of the controller, s.
        ticks: number of samples of the longest motion; after the end of a shorter one its last
            ranges are repeated.
        repeats: number of times that the motion is run, back to back, from rest.
    """

    controller: ARC
    sensor: Sensor
    cells: Range
    period: Scalar = eqx.field(converter=as_array("period"))
    ticks: int = eqx.field(static=True)
    repeats: int = eqx.field(static=True, default=1)

    @property
    def system(self) -> System:
        """The system that the controller compensates."""
        return self.controller.system

    def __call__(self, trajectory: JerkTrajectory) -> Envelope:
        """Return the proved ranges of position, velocity and input of the axis, one per sample.

        Raises:
            ValueError: if an array of the motion or the cells is not float64.
        """
        require_float64(trajectory=trajectory, cells=self.cells, controller=self.controller)
        return _merged(self, trajectory)


class _State(NamedTuple):
    """Ranges of e, s̃, p̃ and g at a sample, and the number κ."""

    position: Range
    velocity: Range
    combined: Range
    lag: Range
    shift: Scalar


class _Now(NamedTuple):
    """The reference at a sample, and its changes Δy* − h·v* and Δv* until the next."""

    at: States
    bend: Scalar
    gain: Scalar


class _Cell(NamedTuple):
    """One cell of θ, with the ranges of θ̂ and the errors of the sensor."""

    law: ARC
    period: Scalar
    theta: tuple[Range, ...]
    hat: tuple[Range, ...]
    error: SensorError

    @property
    def jitter(self) -> Scalar:
        """The largest |q/h| if velocities are differences, otherwise zero."""
        return self.error.position / self.period if self.error.differenced else jnp.zeros(())

    @property
    def inverse_inertia(self) -> Range:
        return 1 / self.theta[0]


@eqx.filter_jit
def _merged(tube: Tube, trajectory: JerkTrajectory) -> Envelope:
    now = _changes(tube, trajectory)
    found = jax.vmap(lambda theta: _one_cell(tube, now, theta))(tube.cells)
    ticks = ticks_of(trajectory, tube.period, tube.ticks, tube.repeats)

    def union(x: Range) -> Range:
        # NaN bounds nothing
        lower = jnp.where(jnp.isnan(x.lower), -jnp.inf, x.lower)
        upper = jnp.where(jnp.isnan(x.upper), jnp.inf, x.upper)
        lower, upper = (jax.vmap(ticks.by_repeat)(end) for end in (lower, upper))
        found = Range(jnp.min(lower, axis=(0, 1)), jnp.max(upper, axis=(0, 1)))
        return found + around(_ROUNDING * (1 + abs(found).upper))

    return Envelope(*map(union, found))


def _changes(tube: Tube, trajectory: JerkTrajectory) -> _Now:
    """Return the reference of all repeats and its changes from sample to sample."""
    at = reference(trajectory, tube.period, tube.ticks, tube.repeats)
    end = trajectory.states(trajectory.duration[None])
    y, v, _ = (jnp.concatenate([x, last]) for x, last in zip(at, end, strict=True))
    return _Now(at, jnp.diff(y) - tube.period * v[:-1], jnp.diff(v))


def _one_cell(tube: Tube, now: _Now, theta: Range) -> Envelope:
    law, box = tube.controller, tube.system
    moves = law.gamma > 0
    hat = where(moves, Range(box.lower, box.upper), exactly(box.centre))
    cell = _Cell(law, tube.period, _entries(theta), _entries(hat), tube.sensor.error())
    zero, slow = exactly(jnp.zeros(())), exactly(-now.at.velocity[0])
    rest = _State(zero, slow, slow, zero, jnp.zeros(()))
    _, found = jax.lax.scan(lambda state, now: _tick(cell, state, now), rest, now)
    before = jax.tree.map(lambda end: jnp.append(0.0, end[:-1]), found.input)
    return found._replace(input_rate=(found.input - before) / tube.period)


def _tick(cell: _Cell, state: _State, now: _Now) -> tuple[_State, Envelope]:
    """Return the ranges at the next sample, and the range of the motion until then."""
    law, h = cell.law, cell.period
    y, v, a = now.at
    shifted, differenced = around(state.shift * cell.jitter), around(2 * cell.jitter)
    coarse = around(cell.error.position)
    noise = state.lag + shifted + differenced
    place, speed = y + state.position, v + state.velocity + shifted
    read = place + coarse, v + state.velocity + noise
    wanted = a - law.k1 * (state.velocity + noise)
    model = _forces(law.system, cell.hat, *read)
    gain = _gain(law, *read, wanted)
    feedback = gain * (state.combined + noise + law.k1 * coarse)
    u = cell.hat[0] * wanted + model - feedback

    during, acceleration, push = _within(cell, place, speed, u)
    remainder = h**2 / 2 * acceleration - now.bend
    after = _next(cell, state, now, gain, model + push, remainder)
    if cell.error.differenced:
        after = after._replace(lag=-h / 2 * acceleration)
    end_y = y + (h * v + now.bend) + after.position
    end_v = v + now.gain + after.velocity + around(after.shift * cell.jitter)
    reached = _between(place, end_y, during, h), _between(speed, end_v, acceleration, h)
    return after, Envelope(*reached, u, u)


def _next(
    cell: _Cell, state: _State, now: _Now, gain: Range, forces: Range, remainder: Range
) -> _State:
    """Evaluate the identities above; `forces` is θ̂_fᵀ f(as read) − θ_fᵀ f̄ − Δ̄, `remainder` r."""
    h, k1 = cell.period, cell.law.k1
    e, s, p, g, shift = state
    next_shift = _middle(gain, cell)
    wanted = now.at.acceleration - k1 * g
    read = g + around(k1 * cell.error.position)
    speeds, combined = [], []
    for M_hat, inverse, K in itertools.product(cell.hat[0], cell.inverse_inertia, gain):
        X = M_hat * wanted - K * read + forces
        pushed = h * inverse * X - now.gain
        b, fade = h * k1 * (1 - M_hat * inverse), h * (M_hat * k1 + K) * inverse

        def shaken(keep: Scalar, fade: Scalar = fade) -> Range:
            left = jnp.abs(fade - keep * shift) + jnp.abs(next_shift - fade)
            return around(left * cell.jitter)

        keep = 1 - fade
        speeds.append(keep * s - h * K * k1 * inverse * e + shaken(keep) + pushed)
        keep = 1 + b - h * K * inverse
        combined.append(keep * p - k1 * b * e + shaken(keep) + k1 * remainder + pushed)
    # the largest rounding error is that of a difference of positions over one sample
    spare = around(_ROUNDING * (1 + jnp.abs(now.at.position) / h))
    e = (1 - h * k1) * e + h * (p + around(shift * cell.jitter)) + remainder + spare
    s, p = (functools.reduce(operator.or_, ends) + spare for ends in (speeds, combined))
    s, p = s & (p - k1 * e), p & (s + k1 * e)
    return _State(e, s, p, exactly(jnp.zeros(())), next_shift)


def _middle(gain: Range, cell: _Cell) -> Scalar:
    """Return the κ in the middle of the range of λ of a sample."""
    low = cell.hat[0].lower * cell.law.k1 + gain.lower
    high = cell.hat[0].upper * cell.law.k1 + gain.upper
    inverse = cell.inverse_inertia
    return cell.period * (low * inverse.lower + high * inverse.upper) / 2


def _within(cell: _Cell, place: Range, speed: Range, u: Range) -> tuple[Range, Range, Range]:
    """Return ranges of speed, acceleration and −θ_fᵀ f − Δ during one sample period."""
    h, inverse = cell.period, cell.inverse_inertia

    def push(speed: Range) -> Range:
        there = place | (place + h * speed)
        delta = cell.law.system.disturbance_bound.range(there, speed).upper
        return around(delta) - _forces(cell.law.system, cell.theta, there, speed)

    # a guess, checked below: twice the acceleration if no force changed within the sample
    most = 2 * inverse.upper * abs(u + push(speed)).upper + 1.0
    wide = inverse * (u + push(speed + around(h * most)))
    wide = where(abs(wide).upper <= most, wide, around(jnp.inf))
    during = speed | (speed + h * wide)
    forces = push(during)
    return during, inverse * (u + forces), forces


def _gain(law: ARC, place: Range, speed: Range, wanted: Range) -> Range:
    """Return the range of the feedback gain K of (25)-(26)."""
    phi = (wanted, *law.system.regressor_ranges(place, speed))
    delta = law.system.disturbance_bound.range(place, speed)
    h = sum((reach * abs(f) for reach, f in zip(law.reach, phi, strict=True)), start=delta)
    return Range(*(law.k2 + end**2 / (4 * law.epsilon) for end in h))  # h ≥ 0


def _forces(system: System, theta: tuple[Range, ...], place: Range, speed: Range) -> Range:
    """Return the range of θ_fᵀ f."""
    forces = system.regressor_ranges(place, speed)
    return sum((t * f for t, f in zip(theta[1:], forces, strict=True)), start=exactly(0.0))


def _entries(x: Range) -> tuple[Range, ...]:
    return tuple(Range(*ends) for ends in zip(*x, strict=True))


def _between(start: Range, end: Range, rate: Range, period: Scalar) -> Range:
    """Return the range of a value within a sample period, from its ends and its rate."""
    mirrored = _peak(-start.lower, -end.lower, -rate, period)
    return Range(-mirrored, _peak(start.upper, end.upper, rate, period))


def _peak(start: Scalar, end: Scalar, rate: Range, period: Scalar) -> Scalar:
    """Return the highest point below the lines start + rate.upper·t and end − rate.lower·(h−t)."""
    fast, slow = rate.upper, rate.lower
    meet = (end - slow * period - start) / jnp.where(fast > slow, fast - slow, 1.0)
    times = (
        jnp.zeros_like(meet),
        jnp.clip(meet, 0.0, period),
        jnp.broadcast_to(period, meet.shape),
    )
    heights = [jnp.minimum(start + fast * t, end - slow * (period - t)) for t in times]
    return functools.reduce(jnp.maximum, heights)
