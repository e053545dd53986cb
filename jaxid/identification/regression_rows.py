"""Regression rows of a log, with all errors of its measurement inside their bound.

Row k is (1) integrated against a test function of weight one. The regressors φ̂ of the row are
measured, or midpoints of ranges, so that

    u_k = φ̂_kᵀθ + (φ − φ̂)_kᵀθ + Δ_k.

The ranges widen δ_k row by row. Errors of the encoder are common to several rows, in which they
nearly cancel: weights g turn them into Σ_l b_l |(S g)_l| with a short stencil S (a second
difference of g for those of ÿ). This is the exact worst case over all |e_l| ≤ resolution/2,
regressor by regressor.
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

# relative margin of a bound for rounding of its sums; rounding of readings: see `Log`
ROUNDED = 1e-9


class Channel(NamedTuple):
    """Errors that several rows share: Σ_l bound_l·|(stencil ∗ g)_l| at worst, for weights g.

    Attributes:
        stencil: stencil that is convolved with the weights, at full length.
        bound: error bound of each entry of the convolution.
    """

    stencil: Float[Array, " s"]
    bound: Float[Array, " l"]

    def worst(self, weights: Float[Array, "k n"]) -> Float[Array, " k"]:
        """Return the worst-case error of each row of weights, shape (k,)."""
        spread = [jnp.convolve(row, self.stencil) for row in weights]
        return jnp.abs(jnp.stack(spread)) @ self.bound


class RegressionRows(eqx.Module):
    """The regression rows of a log, with bounds of all errors of its measurement.

    Attributes:
        system: system whose prior box and δ the bounds assume.
        record: measured regressors, inputs, and δ widened by the ranges of unmeasured regressors.
        delta: δ of each row alone, not widened, shape (n,), in the unit of the input.
        channels: errors of the encoder and of interpolation that several rows share, by name.
    """

    system: System
    record: Record
    delta: Float[Array, " n"]
    channels: dict[str, Channel]

    def counted(self, weights: Float[Array, "k n"]) -> Float[Array, "k n"]:
        """Return the weights with zeros on padding rows."""
        return jnp.where(self.record.rows.counted, weights, 0.0)

    def shared(self, weights: Float[Array, "k n"]) -> Float[Array, " k"]:
        """Return the worst-case error by all shared errors together, for each row of weights."""
        return sum((c.worst(weights) for c in self.channels.values()), jnp.zeros(len(weights)))


@eqx.filter_jit
def hats(system: System, log: Log, found: StateBounds) -> RegressionRows:
    """Return the regression rows of a log with hat functions over two samples as test functions.

    By parts, ∫hat·ÿ is a second difference of positions, exactly, and ∫hat·ẏ a difference of two
    means, which the trapezoid rule gives to h²/12·|ÿ|. The input is exact, but for jitter. Weights
    on hats are a piecewise linear modulating function that vanishes at both ends (M. Shinbrot, "On
    the Analysis of Linear and Nonlinear Systems", 1957).

    Args:
        system: axis with its prior box and disturbance bound δ.
        log: log of inputs and positions.
        found: bounds of the states during the log.
    """
    h, y = log.period, log.position
    middles, delta, doubt = _bracketed(system, log, found)
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
    return RegressionRows(system, Record(rows, _mean(log.input), None), _mean(delta), channels)


@eqx.filter_jit
def boxes(system: System, log: Log, found: StateBounds) -> RegressionRows:
    """Return the regression rows of a log with box functions over one sample as test functions.

    Velocities are backward differences, as in the paper, but with a bound of their errors: a
    backward difference is the mean velocity of the sample period before, which differs from the
    velocity at its end by up to h/2·|ÿ|.

    Args:
        system: axis with its prior box and disturbance bound δ.
        log: log of inputs and positions.
        found: bounds of the states during the log.
    """
    h, y = log.period, log.position
    middles, delta, doubt = _bracketed(system, log, found)
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
    return RegressionRows(system, Record(rows, log.input[1:], None), delta[1:], channels)


@eqx.filter_jit
def guaranteed_estimate(logged: RegressionRows, weights: Float[Array, "m n"]) -> Estimate:
    """Return the estimate by any weights, with its worst-case error for the continuous-time plant.

    It assumes θ in the prior box, |Δ| ≤ δ at all times, an input held over each sample period as
    commanded, positions read to half the encoder resolution, and nothing else.

    Args:
        logged: regression rows of a log, with their system.
        weights: estimator weights, shape (m, n).
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
    """Return Φ̂: ÿ from positions, ẏ as measured, midpoints of ranges for all other regressors."""
    known = _viscous(system)
    forces = (velocity if j in known else f for j, f in enumerate(middles, start=1))
    return (jnp.diff(position, 2) / period**2, *forces)


def _measure(log: Log) -> Float[Array, " rows"]:
    """Return the measure of rows of two samples: zero unless both are part of the log."""
    return jnp.where(log.counted[1:], log.period, 0.0)


def _mean(x: Float[Array, " n"]) -> Float[Array, " n-1"]:
    """Return the means over the two samples of each hat."""
    return (x[:-1] + x[1:]) / 2


def _bracketed(
    system: System, log: Log, found: StateBounds
) -> tuple[tuple[Motion, ...], Motion, Motion]:
    """Return the midpoints of all regressors in each sample, δ, and δ widened by ranges and jitter.

    The ranges of ÿ and ẏ do not widen δ, because these are measured.
    """
    ranges = system.regressor_ranges(found.position, found.velocity)
    delta = system.disturbance_bound.range(found.position, found.velocity).upper
    most, known, widened = _most(system), _viscous(system), delta
    for j, x in enumerate(ranges, start=1):
        widened = widened + (0.0 if j in known else most[j] * x.half_width)
    return tuple(x.middle for x in ranges), delta, widened + log.input_error()


def _viscous(system: System) -> list[int]:
    """Return the indices of the regressors that are ẏ."""
    return [j for j, term in enumerate(system.terms) if isinstance(term.regressor, Viscous)]


def _most(system: System) -> Float[Array, " m"]:
    return jnp.maximum(jnp.abs(system.lower), jnp.abs(system.upper))


def _channel(stencil: tuple[float, ...], bound: Array, count: int) -> Channel:
    return Channel(jnp.array(stencil), jnp.broadcast_to(bound, (count,)))


@eqx.filter_jit
def upper_ends(
    logged: RegressionRows,
    weights: Float[Array, "k n"],
    misfit: Float[Array, " n"],
    functionals: Float[Array, "k m"],
) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Return upper ends of Cθ by given weights, and the part of them that is due to δ.

    They hold for every θ of the prior box that is consistent with the data, and are never above
    those of the box. A functional of zero gives gᵀ(u − Φ·centre) + error instead; if that is below
    zero, the data are inconsistent.

    Args:
        logged: data as regression rows, with their system.
        weights: estimator weights, one row per functional.
        misfit: u − Φ·centre of the rows, shape (n,), in the unit of the input.
        functionals: functionals C of θ, one per row.

    Returns:
        The upper ends and their parts Σ|g|δ, both of shape (k,). These parts do not include the
        widths of ranges, which remain if the disturbance is smaller.
    """
    rows, system = logged.record.rows, logged.system
    taken = jnp.stack([weights @ column for column in rows.columns], axis=1)
    disturbed = jnp.abs(weights) @ rows.delta
    biased = jnp.abs(functionals - taken) @ system.half_widths
    error = (disturbed + logged.shared(weights) + biased) * (1 + ROUNDED)
    box = jnp.abs(functionals) @ system.half_widths
    about = functionals @ system.centre
    # the result for a zero functional is not limited by the box
    least = jnp.where(box > 0, jnp.minimum(weights @ misfit + error, box), weights @ misfit + error)
    return about + least, jnp.abs(weights) @ logged.delta
