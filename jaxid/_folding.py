"""A `lax.scan` that XLA compiles into one kernel on the CPU, whatever the flags of the process are.

By default XLA's CPU backend starts several kernels in every step of a loop, which takes far longer
than the arithmetic of a step on scalars. XLA compiles a called function with the attribute
`xla_cpu_small_call` into one kernel instead; it gives this attribute to small loops itself
(`xla_cpu_small_while_loop_byte_threshold`, see `jaxid.runtime`). JAX attaches attributes to the
operations that are traced within `set_xla_metadata`, and keeps them under `jit`, `grad` and `vmap`.
Versions of XLA that do not know the attribute ignore it: the loop runs slower, with the same
results.

The compiler refuses such a kernel if it contains certain operations, such as sorting or calls of
libraries. The attribute is given only to loops of operations that were tried; all other loops
are compiled as usual.
"""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal
from jaxtyping import Array, Int

_ONE_KERNEL = {"xla_cpu_small_call": "true", "inlineable": "false"}
_APART = {"xla_cpu_small_call": "false", "inlineable": "false"}
_INLINED = {"xla_cpu_small_call": "false", "inlineable": "true"}

# Only operations whose derivatives and batches consist of such operations again.
_ELEMENTWISE = (
    "abs acos acosh add add_any and asin asinh atan atan2 atanh cbrt ceil clamp "
    "convert_element_type copy cos cosh div eq erf erf_inv erfc exp exp2 expm1 floor ge gt "
    "integer_pow is_finite le lgamma log log1p logistic lt lt_to max min mul ne neg nextafter not "
    "or pow rem round rsqrt select_n sign sin sinh sqrt square sub tan tanh xor"
)
_ARRAYS = (
    "broadcast_in_dim concatenate cumsum expand_dims iota pad reduce_and reduce_max reduce_min "
    "reduce_or reduce_sum reshape rev slice split squeeze stack transpose unstack"
)
_CALLS = frozenset(("closed_call", "cond", "custom_jvp_call", "jit", "pjit"))
_LOOPS = frozenset(("scan", "while"))
_INDEXED = frozenset(("dynamic_slice", "gather"))
_TRIED = frozenset((*_ELEMENTWISE.split(), *_ARRAYS.split())) | _CALLS | _LOOPS | _INDEXED

_Result = TypeVar("_Result")
Step = Callable[[Any, tuple[Int[Array, ""], Any]], tuple[Any, Any]]


def folded_scan(step: Step, first: Any, inputs: Any, length: int) -> tuple[Any, Any]:
    """Return the last state and all outputs of a loop, which is one kernel where that is possible.

    Args:
        step: function of the state and of (index, input), as of `jax.lax.scan`; it returns the next
            state and an output.
        first: first state, a structure of arrays.
        inputs: structure of arrays with `length` entries along their first axes.
        length: number of steps.
    """

    def loop(first: Any, inputs: Any) -> tuple[Any, Any]:
        with set_xla_metadata(**_INLINED):  # otherwise calls in the loop would be kernels, too
            return jax.lax.scan(step, first, (jnp.arange(length), inputs))

    return one_kernel(loop, first, inputs)


def one_kernel(function: Callable[..., _Result], *arguments: Any, final: bool = False) -> _Result:
    """Return the result of a function, which is computed in one kernel where that is possible.

    Args:
        function: function of structures of arrays.
        arguments: its arguments.
        final: true if the program is neither differentiated nor batched any more, so that it may
            look up values at any index.
    """
    if jax.default_backend() != "cpu":
        return function(*arguments)
    kernel = jax.jit(function)
    with set_xla_metadata(**_ONE_KERNEL):
        if _foldable(kernel.trace(*arguments).jaxpr.jaxpr, final=final):
            return kernel(*arguments)
    return function(*arguments)


def compiled_apart(function: Callable[..., _Result]) -> Callable[..., _Result]:
    """Return a function of arrays that XLA does not merge with the program that calls it.

    The last bits of its results then do not depend on that program.
    """
    jitted = jax.jit(function)

    def call(*arguments: Any) -> _Result:
        """Return the result of the function."""
        if jax.default_backend() != "cpu":
            return jitted(*arguments)
        with set_xla_metadata(**_APART):
            return jitted(*arguments)

    return call


def _foldable(jaxpr: Jaxpr, known: Iterable[Any] = (), final: bool = False) -> bool:
    """Return whether the compiler makes one kernel of a program, its gradients and its batches.

    Values are looked up in arrays at indices that are equal in all lanes of a batch only: otherwise
    the gradient has an operation that the compiler refuses (scatter).

    Args:
        jaxpr: program.
        known: its variables that do not depend on data, but at most on the index of a step.
        final: true if it has no gradients and batches.
    """
    known = set(known)

    def is_known(variable: Any) -> bool:
        return isinstance(variable, Literal) or variable in known

    for equation in jaxpr.eqns:
        name = equation.primitive.name
        if name not in _TRIED:
            return False
        if name in _INDEXED and not final and not all(map(is_known, equation.invars[1:])):
            return False
        for inner in _inner(equation.params.values()):
            of_known = _known_inside(equation, inner, is_known)
            if not _foldable(inner, of_known, final):
                return False
        if all(map(is_known, equation.invars)):
            known.update(equation.outvars)
    return True


def _known_inside(equation: Any, inner: Jaxpr, is_known: Callable[[Any], bool]) -> list[Any]:
    """Return the inputs of an inner program that do not depend on data."""
    # `cond` has the number of the branch before the arguments of the branches
    given = equation.invars[-len(inner.invars) :] if inner.invars else []
    states = range(0)
    if equation.primitive.name == "while":
        return []
    if equation.primitive.name == "scan":  # a state may depend on data in later steps
        begin = equation.params["num_consts"]
        states = range(begin, begin + equation.params["num_carry"])
    pairs = enumerate(zip(given, inner.invars, strict=True))
    return [own for k, (outer, own) in pairs if is_known(outer) and k not in states]


def _inner(values: Iterable[Any]) -> Iterable[Jaxpr]:
    """Yield the programs among the parameters of an operation."""
    for value in values:
        if isinstance(value, ClosedJaxpr):
            yield value.jaxpr
        elif isinstance(value, Jaxpr):
            yield value
        elif isinstance(value, tuple | list):
            yield from _inner(value)
