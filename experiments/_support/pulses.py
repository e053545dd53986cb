"""What is applied instead of a designed motion."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def pulses(
    amplitude: float, width: float, pause: float, duration: float, period: float
) -> Float[Array, " n"]:
    """Impulses +A, −A, +A, … for open-loop identification, one value per tick.

    Args:
        amplitude: A, in the unit of the input.
        width: of each impulse, s.
        pause: between two impulses, s.
        duration: of the whole sequence, s.
        period: of the ticks, s.
    """
    time = jnp.arange(round(duration / period)) * period
    cycle = width + pause
    # half a tick keeps an instant that rounding left just before an edge on its own side
    phase = jnp.floor((time + period / 2) / cycle)
    on = time + period / 2 - phase * cycle < width
    return jnp.where(on, amplitude * (1.0 - 2.0 * (phase % 2)), 0.0)
