"""The sample instants (ticks) of a motion, repeated back to back, in arrays of a fixed length.

The arrays may be longer than the motion, so that motions of different length share one shape, and
one compilation. Entries beyond the last tick of the motion change no result.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxid._types import Scalar

_WHOLE = 1e-6  # of a period: a sample that begins this shortly before the end is not counted


class Ticks(eqx.Module):
    """The number of sample instants (ticks) of a motion that is repeated back to back.

    Arrays over all ticks have n = repeats·most entries; those beyond `total` are padding.

    Attributes:
        count: number of ticks of one motion, from 1 to `most`; may be traced by JAX.
        most: number of ticks per repeat for which arrays have room.
        repeats: number of times that the motion is run.
    """

    count: Int[Array, ""]
    most: int = eqx.field(static=True)
    repeats: int = eqx.field(static=True, default=1)

    @classmethod
    def of(cls, duration: Scalar, period: Scalar | float, most: int, repeats: int = 1) -> "Ticks":
        """Return the ticks of a motion of given duration.

        Args:
            duration: duration of one motion, s.
            period: sample period, s.
            most: largest number of ticks of one motion; later ones are left out.
            repeats: number of times that the motion is run.
        """
        begun = jnp.ceil(duration / period - _WHOLE).astype(int)
        return cls(jnp.clip(begun, 1, most), most, repeats)

    @property
    def total(self) -> Int[Array, ""]:
        """The number of ticks of all repeats together."""
        return self.repeats * self.count

    @property
    def counted(self) -> Bool[Array, " n"]:
        """A mask of the n = repeats·most array entries, true for those that belong to a tick."""
        return jnp.arange(self.repeats * self.most) < self.total

    def repeated(self, once: Float[Array, " most"]) -> Float[Array, " n"]:
        """Return the values of one motion for all repeats, back to back, then the last value.

        Args:
            once: values at the ticks of one motion, shape (most,).
        """
        if self.repeats == 1:
            return once
        whole = jnp.full(self.repeats * self.most, once[-1])
        for k in range(self.repeats):  # each overwrites the padding of the one before
            whole = jax.lax.dynamic_update_slice_in_dim(whole, once, k * self.count, 0)
        return whole

    def held(self, values: Any, each: int = 1, first: int = 0) -> Any:
        """Return values in which all entries after the last tick equal those of the last tick.

        Args:
            values: arrays, or a structure of arrays, with time along the first axis.
            each: number of entries per tick.
            first: number of entries before the first tick.
        """
        return jax.tree.map(lambda x: _held(x, first + each * self.total), values)

    def by_repeat(self, values: Float[Array, "n *each"]) -> Float[Array, "repeats most *each"]:
        """Return values of all ticks with one row per repeat; a row ends with its last tick, held.

        Args:
            values: values with all ticks along the first axis, of length n = repeats·most.
        """
        starts = [k * self.count for k in range(self.repeats)]
        parts = [jax.lax.dynamic_slice_in_dim(values, start, self.most) for start in starts]
        return jnp.stack([_held(part, self.count) for part in parts])


def _held(values: Array, count: Int[Array, ""]) -> Array:
    last = jax.lax.dynamic_index_in_dim(values, count - 1, keepdims=True)
    within = jnp.arange(values.shape[0]) < count
    return jnp.where(within.reshape(-1, *[1] * (values.ndim - 1)), values, last)
