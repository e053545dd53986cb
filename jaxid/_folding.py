"""Programs that XLA compiles into one kernel on the CPU, whatever the options of the process are.

By default XLA's CPU backend starts several kernels in every step of a loop, which takes far longer
than the arithmetic of a step on scalars. XLA compiles a called function with the attribute
`xla_cpu_small_call` into one kernel instead; with the option that `jaxid.runtime.configure` sets,
it gives this attribute to small loops itself. JAX attaches attributes to the operations that are
traced within `set_xla_metadata`. Versions of XLA that do not know the attribute ignore it: the
program runs slower, with the same results.

The compiler refuses such a kernel if it contains certain operations, such as sorting or calls of
libraries, so that only programs of operations that were tried get the attribute. It has also
aborted the process on the gradient of a simulation within a conditional. Therefore only programs
that JAX does not transform any more, and that are not part of another program, may use it.
"""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import jax
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import ClosedJaxpr, Jaxpr

try:
    from jax.extend.core import get_opaque_trace_state
except ImportError:  # older versions of JAX
    from jax.core import get_opaque_trace_state

_ONE_KERNEL = {"xla_cpu_small_call": "true", "inlineable": "false"}
_APART = {"xla_cpu_small_call": "false", "inlineable": "false"}
_INLINED = {"xla_cpu_small_call": "false", "inlineable": "true"}

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
_PROGRAMS = "closed_call cond custom_jvp_call dynamic_slice gather jit pjit scan while"
_TRIED = frozenset(" ".join((_ELEMENTWISE, _ARRAYS, _PROGRAMS)).split())

_Result = TypeVar("_Result")


def _trace_state() -> object:
    return get_opaque_trace_state(convention="nnx")


# if this module is first imported within a function that JAX traces, no program is one kernel
with jax.ensure_compile_time_eval():
    _OUTERMOST = _trace_state()


def is_traced() -> bool:
    """Return whether JAX traces the code that runs now, even if all its values are known."""
    return _trace_state() != _OUTERMOST


def one_kernel(function: Callable[..., _Result], *arguments: Any) -> _Result:
    """Return the result of a function, which is computed in one kernel where that is possible.

    Call it in a function under `jax.jit` whose arguments are known, as nearly all of its program.

    Args:
        function: function of structures of arrays.
        arguments: its arguments.
    """

    def inlined(*arguments: Any) -> _Result:
        """Return the result; without the attributes here, every call in it would be a kernel."""
        with set_xla_metadata(**_INLINED):
            return function(*arguments)

    if jax.default_backend() != "cpu":
        return function(*arguments)
    kernel = jax.jit(inlined)
    with set_xla_metadata(**_ONE_KERNEL):
        if _foldable(kernel.trace(*arguments).jaxpr.jaxpr):
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


def _foldable(jaxpr: Jaxpr) -> bool:
    """Return whether the compiler makes one kernel of a program."""
    return all(
        equation.primitive.name in _TRIED and all(map(_foldable, _inner(equation.params.values())))
        for equation in jaxpr.eqns
    )


def _inner(values: Iterable[Any]) -> Iterable[Jaxpr]:
    """Yield the programs among the parameters of an operation."""
    for value in values:
        if isinstance(value, ClosedJaxpr):
            yield value.jaxpr
        elif isinstance(value, Jaxpr):
            yield value
        elif isinstance(value, tuple | list):
            yield from _inner(value)
