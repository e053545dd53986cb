"""Ticks of a motion, repeated back to back, in arrays that may have room for more of them.

Motions of different length then share one shape, and one compilation. What belongs to no tick of
the motion only fills the arrays up, and everything made here is as if it were not there.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxid._types import Scalar

_WHOLE = 1e-6  # of a period: a tick that begins so shortly before the end does not begin at all


class Ticks(eqx.Module):
    """How many of `most` ticks a motion lasts, and how often it is repeated.

    Attributes:
        count: of one motion, from 1 to `most`; it may be traced.
        most: that there is room for, for each repeat.
        repeats: of the motion, back to back.
    """

    count: Int[Array, ""]
    most: int = eqx.field(static=True)
    repeats: int = eqx.field(static=True, default=1)

    @classmethod
    def of(cls, duration: Scalar, period: Scalar | float, most: int, repeats: int = 1) -> "Ticks":
        """Those that begin within a duration (s), `most` at most."""
        begun = jnp.ceil(duration / period - _WHOLE).astype(int)
        return cls(jnp.clip(begun, 1, most), most, repeats)

    @property
    def total(self) -> Int[Array, ""]:
        """Of all repeats."""
        return self.repeats * self.count

    @property
    def counted(self) -> Bool[Array, " n"]:
        """Which of the n = repeats·most ticks there are."""
        return jnp.arange(self.repeats * self.most) < self.total

    def repeated(self, once: Float[Array, " most"]) -> Float[Array, " n"]:
        """Values of one motion for all repeats, back to back; after them stays the last value."""
        if self.repeats == 1:
            return once
        whole = jnp.full(self.repeats * self.most, once[-1])
        for k in range(self.repeats):  # each overwrites what does not belong to the one before
            whole = jax.lax.dynamic_update_slice_in_dim(whole, once, k * self.count, 0)
        return whole

    def held(self, values: Any, each: int = 1, first: int = 0) -> Any:
        """Values at all ticks, and after the last one those of the last.

        Args:
            values: arrays, time along the first axis.
            each: how many values a tick has.
            first: how many there are before the first tick.
        """
        return jax.tree.map(lambda x: _held(x, first + each * self.total), values)

    def by_repeat(self, values: Float[Array, "n *each"]) -> Float[Array, "repeats most *each"]:
        """What happens in each tick of the motion, repeat by repeat, its last tick held."""
        starts = [k * self.count for k in range(self.repeats)]
        parts = [jax.lax.dynamic_slice_in_dim(values, start, self.most) for start in starts]
        return jnp.stack([_held(part, self.count) for part in parts])


def _held(values: Array, count: Int[Array, ""]) -> Array:
    last = jax.lax.dynamic_index_in_dim(values, count - 1, keepdims=True)
    within = jnp.arange(values.shape[0]) < count
    return jnp.where(within.reshape(-1, *[1] * (values.ndim - 1)), values, last)
