"""The log of an experiment as a servo records it."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
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

_ROUNDINGS = 4  # rounding errors of a position: of its reading, and of a difference of two or three
JITTER = 0.1  # largest jitter, relative to the period
_FEWEST = 32  # samples of a padded log


class InconsistentLogError(ValueError):
    """The error for logs that no θ in the prior box with |Δ| ≤ δ can have produced.

    Attributes:
        factor: proved lower bound on the factor of δ that would explain the logs; None if there is
            no proved number.
    """

    def __init__(self, sentence: str, factor: float | None = None) -> None:
        """Take the message, and the proved lower bound on the factor of δ."""
        super().__init__(sentence)
        self.factor = factor


class Log(eqx.Module):
    """A sampled experiment: input u_k held from t_k to t_{k+1}, positions read at t_0 … t_n.

    With jitter, inputs change and positions are read at instants τ_k with |τ_k − t_k| ≤ jitter.

    Attributes:
        input: input u_k of each sample period, as commanded, shape (n,), in the unit of the input.
        position: positions as read, shape (n + 1,), m or rad: |read − true| ≤ resolution/2.
        period: sample period t_{k+1} − t_k, s.
        resolution: encoder resolution, m or rad; zero for exact positions.
        jitter: largest deviation of a sample instant, s, at most a tenth of the sample period.
        outer: inputs before the first and after the last sample, which matter only with jitter;
            default the first and the last input.

    Raises:
        ValueError: if the shapes do not match, the period is not above zero, the resolution or the
            jitter is below zero, or the jitter is too large.
    """

    input: Float[Array, " n"] = eqx.field(converter=as_array("input"))
    position: Float[Array, " samples"] = eqx.field(converter=as_array("position"))
    period: Scalar = eqx.field(converter=as_array("period"))
    resolution: Scalar = eqx.field(converter=as_array("resolution"))
    jitter: Scalar = eqx.field(converter=as_array("jitter"), default=0.0)
    outer: Float[Array, "2"] | None = eqx.field(converter=or_none(as_array("outer")), default=None)
    # number of samples before the padding, None for no padding: see `filled`
    _count: Int[Array, ""] | None = eqx.field(
        converter=lambda count: None if count is None else jnp.asarray(count), default=None
    )

    def __check_init__(self) -> None:
        require_positive("period", "a log", self.period)
        for name in ("resolution", "jitter"):
            require_at_least_zero(name, "a log", getattr(self, name))
        for name in ("input", "position"):
            values = getattr(self, name)
            require_shape(name, "a log", values, (values.size,), "one per sample")
            _require_finite(name, values)
        require(
            self.position.size == self.input.size + 1,
            "Argument `position` must have one entry more than `input`, for the end of the last "
            f"sample, but they have {self.position.size} and {self.input.size}. With one input per "
            "position, leave out the last input.",
        )
        if is_concrete((self.jitter, self.period)):
            require(
                float(self.jitter) <= JITTER * float(self.period),
                f"Argument `jitter` of a log must be {JITTER:g} of its period at most, but is "
                f"{float(self.jitter):g} s of {float(self.period):g} s.",
            )

    def part(self, first: int, stop: int) -> "Log":
        """Return the samples from `first` up to `stop` (exclusive) as a log of their own."""
        # NumPy here and in `filled`: JAX would compile each operation for each length
        input, *outer = self._as_numpy()
        if first > 0:
            outer[0] = input[first - 1]
        if stop < input.size:
            outer[1] = input[stop]
        return Log(
            input[first:stop],
            np.asarray(self.position)[first : stop + 1],
            self.period,
            self.resolution,
            self.jitter,
            outer,
            None if self._count is None else np.clip(self.samples - first, 0, stop - first),
        )

    @property
    def samples(self) -> int:
        """The number of samples without padding."""
        return self.input.size if self._count is None else int(self._count)

    def reading_error(self, speed: Motion) -> Motion:
        """Return an upper bound of |read − true position at the sample|, in m or rad.

        It includes the encoder resolution, the jitter and the rounding of floating-point numbers.

        Args:
            speed: largest speed of the axis around the sample, m/s or rad/s.
        """
        rounded = _ROUNDINGS * jnp.finfo(self.position.dtype).eps
        lost = rounded * jnp.max(jnp.abs(self.position))
        return self.resolution / 2 + lost + self.jitter * speed

    @property
    def counted(self) -> Bool[Array, " n"]:
        """A mask of the samples that are part of the log, i.e. not padding, shape (n,)."""
        ticks = jnp.arange(self.input.size)
        return ticks < (self.input.size if self._count is None else self._count)

    def acting(self) -> Range:
        """Return the range of the input that acts in each sample period, shape (n,).

        Without jitter it holds u_k only; with jitter also the inputs of both neighbours.
        """
        before, after = self._neighbours()
        held = exactly(self.input)
        return where(self.jitter > 0, held | before | after, held)

    def input_error(self) -> Float[Array, " n"]:
        """Return an upper bound of |mean input over each sample period − u_k|, shape (n,).

        At either end of a sample period the neighbour's input may act for as long as the jitter.
        The mean of two bounds is also one for the mean under a hat function over two sample
        periods.
        """
        before, after = self._neighbours()
        steps = jnp.abs(self.input - before) + jnp.abs(after - self.input)
        return self.jitter / self.period * steps

    def _as_numpy(self) -> tuple[Float[np.ndarray, " n"], float, float]:
        """Return all inputs, and those before the first and after the last sample."""
        input = np.asarray(self.input)
        ends = input[[0, -1]] if self.outer is None else np.asarray(self.outer)
        return input, float(ends[0]), float(ends[1])

    def _neighbours(self) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        u = self.input
        first, last = (u[:1], u[-1:]) if self.outer is None else (self.outer[:1], self.outer[1:])
        return jnp.concatenate([first, u[:-1]]), jnp.concatenate([u[1:], last])


def filled(log: Log, ticks: int) -> Log:
    """Return the log, padded to arrays of at least `ticks` samples.

    Logs of different length then share one shape and one compilation. No function of a log gives
    another number for the padded one.
    """
    more = max(ticks - log.input.size, 0)
    input, before, after = log._as_numpy()
    return Log(
        np.pad(input, (0, more), constant_values=after),
        np.pad(np.asarray(log.position), (0, more), mode="edge"),
        log.period,
        log.resolution,
        log.jitter,
        np.array([before, after]),
        np.asarray(log.samples),
    )


def padded(log: Log) -> Log:
    """Return the log, padded to the next of a few lengths, for which programs are compiled.

    There are four lengths per factor of two, so that at most a quarter more samples are computed.
    """
    size = max(log.input.size, _FEWEST)
    quarter = 2.0 ** (np.floor(np.log2(size)) - 2)
    return filled(log, int(np.ceil(size / quarter) * quarter))


def whole(log: Log) -> Log:
    """Return the log marked as free of padding; its caller must know that it is."""
    return eqx.tree_at(lambda x: x._count, log, None, is_leaf=lambda x: x is None)


def _require_finite(name: str, values: Float[Array, " n"]) -> None:
    if is_concrete(values):
        wrong = np.flatnonzero(~np.isfinite(np.asarray(values)))
        if wrong.size:
            raise ValueError(
                f"Argument `{name}` of a log must be finite, but is "
                f"{float(values[int(wrong[0])]):g} at sample {wrong[0]}."
            )
