"""The accelerations that the input limit permits (18), and the input that a motion needs."""

import equinox as eqx
import jax.numpy as jnp

from jaxid._checks import is_concrete, require, require_float64
from jaxid._types import Interval, Numbers, Scalar, as_array
from jaxid.model.interval_arithmetic import Range, around
from jaxid.model.system import System
from jaxid.motion.trajectory import States


def acceleration_limit(
    system: System, position: Numbers, velocity: Numbers, input: Numbers
) -> Interval:
    """Return the acceleration interval that the input limit permits (18), in m/s² or rad/s².

    It is the input limit, reduced by Σ_j max|f_j|·max|θ_j| and divided by the largest inertia θ_x2.
    As in the paper, the disturbance and the feedback are left out, so that |u| ≤ u_max in closed
    loop does not follow from it. For the motor of the paper it is ±400/9 = ±44.4 m/s².

    Args:
        system: axis with its prior box Ω_θ.
        position: position limits (lower, upper), m or rad.
        velocity: velocity limits (lower, upper), m/s or rad/s.
        input: input limits (lower, upper), in the unit of the input.

    Raises:
        ValueError: if the other terms may need the whole input.

    Example:
        >>> box = {"position": (0.0, 0.5), "velocity": (-1.0, 1.0), "input": (-150.0, 150.0)}
        >>> acceleration = jd.acceleration_limit(slide, **box)  # of the slide of `System`
        >>> acceleration.round(2).tolist()  # (150 - 40·1 - 30)/9
        [-8.89, 8.89]
    """
    require_float64(system=system)
    box = as_array("position")(position), as_array("velocity")(velocity), as_array("input")(input)
    limit, load = _limit(system, *box)
    if is_concrete(limit):
        require(
            float(limit[0]) < 0 < float(limit[1]),
            f"Argument `input` = {list(map(float, box[2]))} {system.input_unit} is too small: "
            f"with these prior intervals, friction, offset and the other terms may need up to "
            f"{float(load):g} {system.input_unit}, so that nothing remains for acceleration.",
        )
    return limit


def acceleration_reach(
    system: System, position: Numbers, velocity: Numbers, input: Numbers
) -> Interval:
    """Return an interval of all accelerations whose `input_demand` can keep the input limit.

    It is wider than `acceleration_limit`, because it assumes the state that needs the least input
    for all other terms. For the motor of the paper it is ±51.9 m/s².

    Args:
        system: axis with its prior box Ω_θ and disturbance bound δ.
        position: position limits (lower, upper), m or rad.
        velocity: velocity limits (lower, upper), m/s or rad/s.
        input: input limits (lower, upper), in the unit of the input.
    """
    states = (Range(*as_array("position")(position)), Range(*as_array("velocity")(velocity)))
    needs = system.disturbance_bound.range(*states).lower
    up, down = needs, needs
    for theta, span in zip(system.box[1:], system.regressor_ranges(*states), strict=True):
        up = up + _least_peak(theta, span)
        down = down + _least_peak(-theta, span)
    low, high = as_array("input")(input)
    return jnp.stack([low + down, high - up]) / system.upper[0]


def _least_peak(theta: Range, span: Range) -> Scalar:
    """Return the least of max θ·f over f in `span`, max over θ in its range: convex in f."""
    f = jnp.stack([span.lower, span.upper, jnp.clip(0.0, span.lower, span.upper)])
    return jnp.min((f * theta).upper)


def input_demand(system: System, states: States) -> Range:
    """Return the range of inputs φᵀθ + Δ that a motion needs over all θ ∈ Ω_θ and all |Δ| ≤ δ.

    In contrast to (18), which is one interval for all motions, it uses the state at each instant,
    so that friction helps to brake. The input that feedback adds is not included. The range has the
    shape of the states, in the unit of the input.
    """
    phi = system.regressors(*states)
    delta = system.disturbance_bound(states.position, states.velocity)
    return sum((f * theta for f, theta in zip(phi, system.box, strict=True)), start=around(delta))


@eqx.filter_jit
def _limit(
    system: System, position: Interval, velocity: Interval, input: Interval
) -> tuple[Interval, Scalar]:
    """Return (18), and the input that all terms but inertia may need."""
    terms = system.terms[1:]
    peaks = [jnp.max(jnp.abs(term.interval)) for term in terms]
    sizes = [t.regressor.magnitude(position, velocity) for t in terms if t.regressor is not None]
    load = sum((a * b for a, b in zip(peaks, sizes, strict=True)), start=jnp.zeros(()))
    return (input + jnp.stack([load, -load])) / system.upper[0], load
