"""What runs a motion and keeps its log."""

from typing import NamedTuple

from jaxid.loop.controllers import Controller


class Servo(NamedTuple):
    """What runs a motion and keeps its log.

    Attributes:
        period: s; it divides the duration of a motion.
        resolution: of the encoder, m or rad.
        controller: whose closed loop is expected; without one, that the axis follows exactly.
        velocity_error: of the axis, m/s or rad/s, that a design counts with where δ jumps. What is
            foreseen of a motion is foreseen without it.
    """

    period: float
    resolution: float
    controller: Controller | None = None
    velocity_error: float = 0.0
