"""Checks of arguments: error messages name the argument, its value and the valid values."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer


def is_concrete(tree: Any) -> bool:
    """Return whether every leaf of `tree` has a value, i.e. is not being traced by JAX."""
    return not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree))


def require(condition: Any, sentence: str, error: type[ValueError] = ValueError) -> None:
    """Raise `error(sentence)` unless `condition` holds."""
    if not condition:
        raise error(sentence)


def require_positive(name: str, owner: str, value: Any) -> None:
    """Raise a ValueError unless all numbers of an argument are above zero and finite.

    A traced value is not checked.

    Args:
        name: name of the argument.
        owner: owner of the argument, with its article, e.g. "a servo".
        value: number or array.
    """
    _require_numbers(name, owner, value, "positive", lambda x: x > 0)


def require_at_least_zero(name: str, owner: str, value: Any) -> None:
    """Raise a ValueError unless all numbers of an argument are zero or above, and finite.

    A traced value is not checked.

    Args:
        name: name of the argument.
        owner: owner of the argument, with its article, e.g. "a servo".
        value: number or array.
    """
    _require_numbers(name, owner, value, "at least zero", lambda x: x >= 0)


def _require_numbers(
    name: str, owner: str, value: Any, what: str, holds: Callable[[np.ndarray], np.ndarray]
) -> None:
    if not is_concrete(value):
        return
    found = np.asarray(value)  # NumPy: a JAX operation would be traced
    require(
        np.all(holds(found) & np.isfinite(found)),
        f"Argument `{name}` of {owner} must be {what} and finite, but is {found.tolist()}.",
    )


def require_shape(name: str, owner: str, value: Any, shape: tuple[int, ...], entries: str) -> None:
    """Refuse an array of another shape; `entries` says what its entries are."""
    found = jnp.shape(value)
    require(
        found == shape,
        f"Argument `{name}` of {owner} must have the shape {shape} ({entries}), but has {found}.",
    )


def require_interval(name: str, interval: Any, owner: str = "") -> None:
    """Raise a ValueError unless both ends of an interval are finite, the lower below the upper.

    A traced interval is not checked.

    Args:
        name: name of the argument.
        interval: lower and upper end.
        owner: owner of the argument, with its article; default none.
    """
    argument = f"Argument `{name}`{owner and f' of {owner}'}"
    require(
        jnp.shape(interval) == (2,),
        f"{argument} must be two numbers, (lower, upper), but has the shape {jnp.shape(interval)}.",
    )
    if not is_concrete(interval):
        return
    lower, upper = np.asarray(interval).tolist()  # NumPy: a JAX operation would be traced
    require(
        bool(np.all(np.isfinite([lower, upper]))),
        f"{argument} must have two finite ends, but is [{lower:g}, {upper:g}].",
    )
    require(
        lower < upper,
        f"{argument} must have its lower end below its upper end, but is [{lower:g}, {upper:g}].",
    )


def require_float64(**arguments: Any) -> None:
    """Raise a ValueError unless all floating-point numbers of the arguments are float64.

    In single precision rounding errors are not negligible beside a bound.

    Args:
        arguments: numbers, arrays or structures of them, by the name of the argument.
    """
    for name, value in arguments.items():
        for leaf in filter(_is_number, jax.tree.leaves(value)):
            # checked at every simulation: `jnp.result_type` of every array and a sentence for
            # every one took as long as 1,000 samples
            dtype = leaf.dtype if hasattr(leaf, "dtype") else jnp.result_type(leaf)
            if dtype == np.float64 or not jnp.issubdtype(dtype, jnp.floating):
                continue
            raise ValueError(
                f"Argument `{name}` must be float64, but is {dtype}: call `jaxid.configure()`, or "
                '`jax.config.update("jax_enable_x64", True)`, before the first array is made.'
            )


def _is_number(leaf: Any) -> bool:
    return isinstance(leaf, float) or eqx.is_array_like(leaf)


def require_concrete(what: str, instead: str, **arguments: Any) -> None:
    """Raise a ValueError if JAX traces an argument, by `jit`, `grad` or `vmap`.

    Args:
        what: what needs the values, for the sentence.
        instead: a sentence that says what can be traced.
        arguments: arrays or structures of them, by the name of the argument.
    """
    for name, value in arguments.items():
        require(
            is_concrete(value),
            f"Argument `{name}` is traced by `jit`, `grad` or `vmap`, but {what} needs its value. "
            f"{instead}",
        )
