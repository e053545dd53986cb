"""Things that jump with the speed, and their spreading for a search by gradients."""

import abc

import equinox as eqx

from jaxid._types import Motion


class Nonsmooth(eqx.Module):
    """Something that jumps with the speed."""

    @abc.abstractmethod
    def smoothed(self, speed: Motion) -> "Nonsmooth":
        """The same thing with its jumps spread over about `speed` (m/s or rad/s).

        The speed may differ from sample to sample of the motion that it will be applied to.
        """
