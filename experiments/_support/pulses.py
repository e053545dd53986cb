"""Open-loop pulses, which are applied instead of a designed motion."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def pulses(
    amplitude: float, width: float, pause: float, duration: float, period: float
) -> Float[Array, " n"]:
    """Return pulses +A, −A, +A, … for open-loop identification, one value per sample.

    Args:
        amplitude: amplitude A, in the unit of the input.
        width: duration of each pulse, s.
        pause: time between two pulses, s.
        duration: duration of the whole sequence, s.
        period: sample period, s.
    """
    time = jnp.arange(round(duration / period)) * period
    cycle = width + pause
    # half a sample period, so that rounding errors cannot move an instant across an edge
    phase = jnp.floor((time + period / 2) / cycle)
    on = time + period / 2 - phase * cycle < width
    return jnp.where(on, amplitude * (1.0 - 2.0 * (phase % 2)), 0.0)
