"""Rows made of a log, with everything that a log does not know inside their bound.

Row k is (1) integrated against a test function of weight one. The regressors that are put into it
are measured or bracketed ones, φ̂, so that

    u_k = φ̂_kᵀθ + (φ − φ̂)_kᵀθ + Δ_k.

What is bracketed row by row widens δ_k. Errors of the encoder are common to several rows, and there
they nearly cancel: weights g turn them into Σ_l b_l |(S g)_l| with a short stencil S (a second
difference of g for those of ÿ): the exact worst case over all |e_l| ≤ resolution/2, regressor by
regressor.
"""

from collections.abc import Iterable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._types import Motion, Scalar
from jaxid.identification.state_bounds import StateBounds
from jaxid.loop.log import Log
from jaxid.loop.record import Record, Rows
from jaxid.model.regressors import Viscous
from jaxid.model.system import System
from jaxid.regression.estimate import Estimate, estimate

# of a bound: far more than its sums lose by rounding; readings have theirs in `Log`
ROUNDED = 1e-9


class Channel(NamedTuple):
    """Errors that several rows share: Σ_l bound_l·|(stencil ∗ g)_l| at worst.

    Attributes:
        stencil: convolved with the weights; its full length counts.
        bound: one per entry of the result.
    """

    stencil: Float[Array, " s"]
    bound: Float[Array, " l"]

    def worst(self, weights: Float[Array, "k n"]) -> Float[Array, " k"]:
        """Of each row of weights."""
        spread = [jnp.convolve(row, self.stencil) for row in weights]
        return jnp.abs(jnp.stack(spread)) @ self.bound


class RegressionRows(eqx.Module):
    """A log as rows.

    Attributes:
        system: with the box that its brackets and bounds come from.
        record: measured regressors, inputs, and δ widened by what is bracketed row by row.
        channels: errors of the sensor and of interpolation that rows share.
    """

    system: System
    record: Record
    channels: dict[str, Channel]

    def counted(self, weights: Float[Array, "k n"]) -> Float[Array, "k n"]:
        """Without those of padding, whose rows say nothing, but which a stencil would meet."""
        return jnp.where(self.record.rows.counted, weights, 0.0)

    def shared(self, weights: Float[Array, "k n"]) -> Float[Array, " k"]:
        """The worst of all channels."""
        return sum((c.worst(weights) for c in self.channels.values()), jnp.zeros(len(weights)))


@eqx.filter_jit
def hats(system: System, log: Log, found: StateBounds) -> RegressionRows:
    """Test functions that are hats over two ticks: ÿ and ẏ from positions alone.

    By parts ∫hat·ÿ is a second difference of positions, exactly, and ∫hat·ẏ a difference of two
    means, which the trapezoid rule knows to h²/12·|ÿ|. The input is exact, but for jitter.
    Weights on hats are a piecewise linear modulating function that vanishes at both ends (M.
    Shinbrot, "On the Analysis of Linear and Nonlinear Systems", 1957).
    """
    h, y = log.period, log.position
    middles, doubt = _bracketed(system, log, found)
    columns = _columns(system, y, (y[2:] - y[:-2]) / (2 * h), h, map(_mean, middles))
    rows = Rows(columns, _mean(doubt), _measure(log))
    most, size_of = _most(system), abs(found.acceleration).upper
    half, n = found.reading, y.size
    channels = {"quantised ÿ": _channel((1.0, -2.0, 1.0), most[0] * half / h**2, n)}
    for j in _viscous(system):
        channels[f"quantised ẏ of {system.names[j]}"] = _channel(
            (-1.0, 0.0, 1.0), most[j] * half / (2 * h), n
        )
        channels[f"interpolated ẏ of {system.names[j]}"] = Channel(
            jnp.array([-1.0, 1.0]), most[j] * h / 12 * size_of
        )
    return RegressionRows(system, Record(rows, _mean(log.input), None), channels)


@eqx.filter_jit
def boxes(system: System, log: Log, found: StateBounds) -> RegressionRows:
    """Boxes of one tick, velocities by backward differences: the paper's way, made honest.

    A backward difference is the mean velocity of the tick before: it lags the velocity at its end
    by up to h/2·|ÿ|, whatever the encoder.
    """
    h, y = log.period, log.position
    middles, doubt = _bracketed(system, log, found)
    columns = _columns(system, y, jnp.diff(y)[1:] / h, h, (f[1:] for f in middles))
    rows = Rows(columns, doubt[1:], _measure(log))
    most, half, n = _most(system), found.reading, y.size
    lag = most[0] * abs(found.acceleration).upper / 2
    channels = {
        "quantised ÿ": _channel((1.0, -2.0, 1.0), most[0] * half / h**2, n),
        "lag of ẏ": Channel(jnp.array([-1.0, 1.0]), lag),
    }
    for j in _viscous(system):
        channels[f"quantised ẏ of {system.names[j]}"] = _channel(
            (0.0, -1.0, 1.0), most[j] * half / h, n
        )
    return RegressionRows(system, Record(rows, log.input[1:], None), channels)


@eqx.filter_jit
def guaranteed_estimate(logged: RegressionRows, weights: Float[Array, "m n"]) -> Estimate:
    """The estimate by any weights, with a bound for the continuous-time plant behind the log.

    It rests on θ in the box, |Δ| ≤ δ at all times, an input that is held over each tick as
    commanded, positions read at the ticks to half a count, and on nothing else.
    """
    counted = logged.counted(weights)
    found = estimate(logged.record, logged.system, counted)
    bound = (found.bound + logged.shared(counted)) * (1 + ROUNDED)
    return eqx.tree_at(lambda e: e.bound, found, bound)


def _columns(
    system: System,
    position: Float[Array, " samples"],
    velocity: Float[Array, " n"],
    period: Scalar,
    middles: Iterable[Float[Array, " n"]],
) -> tuple[Float[Array, " n"], ...]:
    """Φ̂: ÿ from positions, ẏ as measured, everything else in the middle of its range."""
    known = _viscous(system)
    forces = (velocity if j in known else f for j, f in enumerate(middles, start=1))
    return (jnp.diff(position, 2) / period**2, *forces)


def _measure(log: Log) -> Float[Array, " rows"]:
    """Of rows of two ticks: zero unless both took place."""
    return jnp.where(log.took_place()[1:], log.period, 0.0)


def _mean(x: Float[Array, " n"]) -> Float[Array, " n-1"]:
    """Over the two ticks of each hat."""
    return (x[:-1] + x[1:]) / 2


def _bracketed(system: System, log: Log, found: StateBounds) -> tuple[tuple[Motion, ...], Motion]:
    """Middles of all regressors in each tick, and δ with what their ranges and jitter add to it.

    The ranges of ÿ and ẏ itself count nothing: these are measured.
    """
    ranges = system.force_ranges(found.position, found.velocity)
    delta = system.disturbance_bound.range(found.position, found.velocity).upper
    most, known = _most(system), _viscous(system)
    for j, x in enumerate(ranges, start=1):
        delta = delta + (0.0 if j in known else most[j] * x.half_width)
    return tuple(x.middle for x in ranges), delta + log.misheld()


def _viscous(system: System) -> list[int]:
    """Which regressors are ẏ."""
    return [j for j, term in enumerate(system.terms) if isinstance(term.regressor, Viscous)]


def _most(system: System) -> Float[Array, " m"]:
    return jnp.maximum(jnp.abs(system.lower), jnp.abs(system.upper))


def _channel(stencil: tuple[float, ...], bound: Array, count: int) -> Channel:
    return Channel(jnp.array(stencil), jnp.broadcast_to(bound, (count,)))


def upper_ends(
    logged: RegressionRows,
    weights: Float[Array, "k n"],
    misfit: Float[Array, " n"],
    functionals: Float[Array, "k m"],
) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Of Cθ by rows of weights, at most that of the box; and what is due to δ in it."""
    rows, system = logged.record.rows, logged.system
    taken = jnp.stack([weights @ column for column in rows.columns], axis=1)
    disturbed = jnp.abs(weights) @ rows.delta
    biased = jnp.abs(functionals - taken) @ system.half_widths
    error = (disturbed + logged.shared(weights) + biased) * (1 + ROUNDED)
    box = jnp.abs(functionals) @ system.half_widths
    about = functionals @ system.centre
    # without a functional there is no box to fall back to
    least = jnp.where(box > 0, jnp.minimum(weights @ misfit + error, box), weights @ misfit + error)
    return about + least, disturbed
