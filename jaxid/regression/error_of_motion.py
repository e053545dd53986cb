"""J of (16): worst-case errors of least squares on the exact signals of one motion."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require, require_float64, require_shape
from jaxid._types import Numbers, as_array
from jaxid.loop.record import rows_of
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory, States
from jaxid.regression.worst_case import least_squares, worst_case_error


@eqx.filter_jit
def planned_error(
    system: System, trajectory: JerkTrajectory, nodes: int = 1024
) -> Float[Array, " m"]:
    """Return the worst-case least-squares error J of every parameter on a motion, (16).

    It has shape (m,), in the units of the parameters, and is computed with the exact δ.

    Args:
        system: axis with its regressors and disturbance bound δ.
        trajectory: motion; J is the same if it is repeated.
        nodes: number of nodes of the midpoint rule per interval; with half of them, J changes by
            less than 0.01 %.

    Example:
        >>> jd.planned_error(slide, motion).round(2).tolist()
        [1.25, 36.29, 10.03]
    """
    require_float64(system=system, trajectory=trajectory)
    require(nodes >= 1, f"Argument `nodes` must be 1 or more, but is {nodes}.")
    rows = rows_of(system, *trajectory.midpoints(nodes))
    return worst_case_error(least_squares(rows), rows.delta)


def sampled_error(
    system: System,
    time: Numbers,
    position: Numbers,
    velocity: Numbers,
    acceleration: Numbers,
) -> Float[Array, " m"]:
    """Return the worst-case least-squares error of every parameter for a motion given by samples.

    Args:
        system: axis with its regressors and disturbance bound δ.
        time: times of the samples, increasing, s.
        position: positions, m or rad.
        velocity: velocities, m/s or rad/s.
        acceleration: accelerations, m/s² or rad/s².

    Returns:
        The error J of (15) on exact signals, by the trapezoid rule, shape (m,), in the units of the
        parameters. For dense samples of a `JerkTrajectory` it tends to `planned_error`.

    Example:
        >>> time = jnp.linspace(0.0, 0.6, 6001)  # from a file, say
        >>> jd.sampled_error(slide, time, *motion.states(time)).round(2).tolist()
        [1.25, 36.29, 10.03]
    """
    given = {
        "time": time,
        "position": position,
        "velocity": velocity,
        "acceleration": acceleration,
    }
    arrays = {name: as_array(name)(values) for name, values in given.items()}
    require_float64(system=system, **arrays)
    for name, values in arrays.items():
        require_shape(name, "a sampled motion", values, (arrays["time"].size,), "one per sample")
    if is_concrete(arrays["time"]):
        back = np.flatnonzero(~(np.diff(np.asarray(arrays["time"])) > 0))
        require(
            back.size == 0,
            "Argument `time` of a sampled motion must increase from each sample to the next, but "
            f"does not after sample {back[0] if back.size else 0}.",
        )
    return _sampled_error(system, **arrays)


@eqx.filter_jit
def _sampled_error(
    system: System,
    time: Float[Array, " n"],
    position: Float[Array, " n"],
    velocity: Float[Array, " n"],
    acceleration: Float[Array, " n"],
) -> Float[Array, " m"]:
    steps = jnp.diff(time)
    weights = (jnp.append(steps, 0.0) + jnp.append(0.0, steps)) / 2
    rows = rows_of(system, States(position, velocity, acceleration), weights)
    return worst_case_error(least_squares(rows), rows.delta)
