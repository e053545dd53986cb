"""What a servo keeps of an experiment."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxid._checks import (
    is_concrete,
    require,
    require_at_least_zero,
    require_positive,
    require_shape,
)
from jaxid._types import Motion, Scalar, as_array, or_none
from jaxid.model.interval_arithmetic import Range, exactly, where

_ROUNDINGS = 4  # of a position: when it is read, and in a difference of two or three
JITTER = 0.1  # of a period, at most: beyond it a log is hardly one of ticks


class InconsistentLogError(ValueError):
    """No axis of the system, with θ in the prior box and |Δ| ≤ δ, can have produced the logs.

    Attributes:
        factor: a proved lower bound on the multiple of δ that would explain the logs; None where
            no number is proved.
    """

    def __init__(self, sentence: str, factor: float | None = None) -> None:
        """The sentence says what contradicts what."""
        super().__init__(sentence)
        self.factor = factor


class Log(eqx.Module):
    """A sampled experiment: u_k is held from t_k to t_{k+1}, positions are read at t_0 … t_n.

    With jitter all this happens at instants τ_k instead, |τ_k − t_k| ≤ jitter, and all that is said
    of ticks is still said of those between t_k and t_{k+1}.

    Attributes:
        input: u_k as commanded, shape (n,).
        position: as read, shape (n + 1,): |read − true| ≤ resolution/2.
        period: t_{k+1} − t_k, s.
        resolution: of the encoder, m or rad; zero for one that is exact.
        jitter: s, at most a tenth of the period.
        outer: the inputs before the first tick and after the last one, of which jitter lets a
            little in; default those of the first and the last.
    """

    input: Float[Array, " n"] = eqx.field(converter=as_array("input"))
    position: Float[Array, " samples"] = eqx.field(converter=as_array("position"))
    period: Scalar = eqx.field(converter=as_array("period"))
    resolution: Scalar = eqx.field(converter=as_array("resolution"))
    jitter: Scalar = eqx.field(converter=as_array("jitter"), default=0.0)
    outer: Float[Array, "2"] | None = eqx.field(converter=or_none(as_array("outer")), default=None)
    # of ticks, from the first one on, that took place, None for all: see `filled`
    _count: Int[Array, ""] | None = None

    def __check_init__(self) -> None:
        require_positive("period", "a log", self.period)
        for name in ("resolution", "jitter"):
            require_at_least_zero(name, "a log", getattr(self, name))
        for name in ("input", "position"):
            values = getattr(self, name)
            require_shape(name, "a log", values, (values.size,), "one per sample")
        require(
            self.position.size == self.input.size + 1,
            "Argument `position` must have one entry more than `input`, the end of its last tick, "
            f"but they have {self.position.size} and {self.input.size}.",
        )
        if is_concrete((self.jitter, self.period)):
            require(
                float(self.jitter) <= JITTER * float(self.period),
                f"Argument `jitter` of a log must be {JITTER:g} of its period at most, but is "
                f"{float(self.jitter):g} s of {float(self.period):g} s.",
            )

    def part(self, first: int, stop: int) -> "Log":
        """The ticks from `first` up to `stop`, not padded: as a log of its own."""
        before, after = self._neighbours()
        return Log(
            self.input[first:stop],
            self.position[first : stop + 1],
            self.period,
            self.resolution,
            self.jitter,
            jnp.stack([before[first], after[stop - 1]]),
        )

    def reading_error(self, speed: Motion) -> Motion:
        """|read − true position at the tick| at most, of an axis that is no faster around it.

        What doubles of this size and their differences lose is counted.
        """
        rounded = _ROUNDINGS * jnp.finfo(self.position.dtype).eps
        lost = rounded * jnp.max(jnp.abs(self.position))
        return self.resolution / 2 + lost + self.jitter * speed

    def took_place(self) -> Bool[Array, " n"]:
        """Which ticks did: the others only fill up the arrays."""
        ticks = jnp.arange(self.input.size)
        return ticks < (self.input.size if self._count is None else self._count)

    def acting(self) -> Range:
        """All inputs that act in each tick: with jitter the neighbours', too."""
        before, after = self._neighbours()
        held = exactly(self.input)
        return where(self.jitter > 0, held | before | after, held)

    def misheld(self) -> Float[Array, " n"]:
        """|mean of what acts in each tick − u_k| at most, or under a hat over two of them.

        At either end of a tick another input may act for as long as the jitter. Under a hat, which
        counts the middle of its two ticks twice and their ends not at all, it is less than the mean
        of both.
        """
        before, after = self._neighbours()
        steps = jnp.abs(self.input - before) + jnp.abs(after - self.input)
        return self.jitter / self.period * steps

    def _neighbours(self) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        u = self.input
        first, last = (u[:1], u[-1:]) if self.outer is None else (self.outer[:1], self.outer[1:])
        return jnp.concatenate([first, u[:-1]]), jnp.concatenate([u[1:], last])


def filled(log: Log, ticks: int) -> Log:
    """The log with arrays for so many ticks, or more than that if it has more.

    Logs of different length then share one shape, and one compilation. No function of a log gives
    another number for it.
    """
    more = max(ticks - log.input.size, 0)
    last = log.input[-1] if log.outer is None else log.outer[1]
    outer = jnp.stack([log.input[0], last]) if log.outer is None else log.outer
    return Log(
        jnp.pad(log.input, (0, more), constant_values=last),
        jnp.pad(log.position, (0, more), mode="edge"),
        log.period,
        log.resolution,
        log.jitter,
        outer,
        jnp.asarray(log.input.size) if log._count is None else log._count,
    )


def whole(log: Log) -> Log:
    """The log of which it is known that all of its ticks took place."""
    return eqx.tree_at(lambda x: x._count, log, None, is_leaf=lambda x: x is None)
