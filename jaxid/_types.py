"""Types of arrays by their meaning, and products of the regression form."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from jaxid._checks import is_concrete, require_concrete

Scalar = Float[Array, ""]
Motion = Float[Array, "*shape"]
Interval = Float[Array, "2"]
# forms of numbers that a user may pass
Numbers = Sequence[float | int] | Shaped[Array | np.ndarray, "..."]


def as_array(name: str) -> Callable[[Any], Array]:
    """Return a converter for the argument `name`: numbers in any form become an array of floats.

    A number, nested lists of numbers or an array will do. Floats keep their precision, so that
    single precision is found where it matters.

    Raises:
        ValueError: when the converter is called, if the values are not numbers, or if the rows of
            nested lists differ in length.
    """

    def convert(values: Any) -> Array:
        """Return numbers in any form as an array of floats."""
        try:
            found = _known_or_traced(lambda: jnp.asarray(values), values)
        except (TypeError, ValueError, DeprecationWarning):
            raise ValueError(
                f"Argument `{name}` must be a number, an array, or a list of numbers whose rows "
                f"have one length, but is {values!r}."
            ) from None
        if jnp.issubdtype(found.dtype, jnp.floating):
            return found
        if jnp.issubdtype(found.dtype, jnp.complexfloating):
            raise ValueError(f"Argument `{name}` must be real, but is {values!r}.")
        return _known_or_traced(lambda: found.astype(float), found)

    return convert


def as_known(name: str) -> Callable[[Any], float]:
    """Return a converter for the argument `name`: to a number that no transformation traces.

    Raises:
        ValueError: when the converter is called, if the value is traced or is not one number.
    """

    def convert(value: Any) -> float:
        """Return a value that no transformation traces as a number."""
        require_concrete("what depends on it", "Give it as a number.", **{name: value})
        try:
            return float(value)
        except (TypeError, ValueError):
            raise ValueError(f"Argument `{name}` must be a number, but is {value!r}.") from None

    return convert


def _known_or_traced(make: Callable[[], Array], values: Any) -> Array:
    """Return `make()`, as a concrete array if the values are concrete, even under `jit`."""
    if not is_concrete(values):
        return make()
    with jax.ensure_compile_time_eval():
        return make()


def or_none(convert: Callable[[Any], Array]) -> Callable[[Any], Array | None]:
    """Return a converter that keeps None and converts everything else."""
    return lambda values: None if values is None else convert(values)


def dot(columns: Sequence[Motion], theta: Float[Array, " m"]) -> Motion:
    """Return Σ_j columns[j]·θ_j, in the shape of a column.

    It is summed column by column: scalars stay scalars, so that a scan is one kernel.
    """
    total = columns[0] * theta[0]
    for j, column in enumerate(columns[1:], start=1):
        total = total + column * theta[j]
    return total
