"""Functions with jumps in the velocity, and their smoothing for a gradient-based search."""

import abc

import equinox as eqx

from jaxid._types import Motion


class Nonsmooth(eqx.Module):
    """Base class of functions of (y, ẏ) that jump at some velocity and can be smoothed there."""

    @abc.abstractmethod
    def smoothed(self, speed: Motion) -> "Nonsmooth":
        """Return a copy whose jumps are spread over about `speed`, in m/s or rad/s.

        `speed` may be an array, with one value per sample of the motion to which the copy is
        applied.
        """
