"""The accelerations that the input leaves room for: (18), and what a motion asks of the input."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require, require_float64
from jaxid._types import Interval, Numbers, Scalar, as_interval
from jaxid.model.interval_arithmetic import Range, around
from jaxid.model.system import System
from jaxid.motion.trajectory import States


def acceleration_limit(
    system: System, position: Numbers, velocity: Numbers, input: Numbers
) -> Interval:
    """(18), read sharply: what the input has left for θ_x2·ÿ after Σ_j max|f_j|·max|θ_j|.

    As in the paper the disturbance and the feedback effort are left out, so that |u| ≤ u_max in
    closed loop does not follow from it. For the motor 400/9 = 44.4 m/s².

    Example:
        >>> box = {"position": (0.0, 0.5), "velocity": (-1.0, 1.0), "input": (-150.0, 150.0)}
        >>> acceleration = jd.acceleration_limit(slide, **box)  # of the slide of `System`
        >>> acceleration.round(2).tolist()  # (150 - 40·1 - 30)/9
        [-8.89, 8.89]
    """
    require_float64(system=system)
    peaks = _peak_parameters(system)[1:] * _peak_regressors(system, position, velocity)
    return _remaining(system, as_interval(input), jnp.sum(peaks))


def acceleration_reach(
    system: System, position: Numbers, velocity: Numbers, input: Numbers
) -> Interval:
    """The accelerations that `input_demand` leaves at the state that needs the least for the rest.

    For the motor 51.9 m/s²: friction may be zero, and the offset and δ may not help.
    """
    states = (Range(*as_interval(position)), Range(*as_interval(velocity)))
    needs = system.disturbance_bound.range(*states).lower
    up, down = needs, needs
    for theta, span in zip(system.box[1:], system.force_ranges(*states), strict=True):
        up = up + _least_peak(theta, span)
        down = down + _least_peak(-theta, span)
    low, high = as_interval(input)
    return jnp.stack([low + down, high - up]) / system.upper[0]


def _least_peak(theta: Range, span: Range) -> Scalar:
    """The least of max θf over f in a range, θ being the worst of its own: convex in f."""
    f = jnp.stack([span.lower, span.upper, jnp.clip(0.0, span.lower, span.upper)])
    return jnp.min((f * theta).upper)


def input_demand(system: System, states: States) -> Range:
    """All inputs that the motion itself may ask for: φᵀθ + Δ over θ ∈ Ω_θ and |Δ| ≤ δ.

    The input limit itself, where (18) is one number for all motions: friction helps to brake. What
    feedback adds is left out.
    """
    phi = system.regressors(*states)
    delta = system.disturbance_bound(states.position, states.velocity)
    return sum((f * theta for f, theta in zip(phi, system.box, strict=True)), start=around(delta))


def _peak_parameters(system: System) -> Float[Array, " m"]:
    return jnp.maximum(jnp.abs(system.lower), jnp.abs(system.upper))


def _peak_regressors(
    system: System, position: Numbers, velocity: Numbers
) -> Float[Array, " forces"]:
    position, velocity = as_interval(position), as_interval(velocity)
    return jnp.stack(
        [
            term.regressor.magnitude(position, velocity)
            for term in system.terms
            if term.regressor is not None
        ]
    )


def _remaining(system: System, input: Interval, load: Scalar) -> Interval:
    remaining = input + jnp.stack([load, -load])
    if is_concrete(remaining):
        require(
            float(remaining[0]) < 0 < float(remaining[1]),
            f"Argument `input` must leave something for acceleration, but the terms of the system "
            f"may take {float(load):g} {system.input_unit} of {list(map(float, input))}.",
        )
    return remaining / system.upper[0]
