"""What a program switches on before its first computation; an import changes nothing."""

import os

import jax
import jaxlib.version

# This option folds a small `lax.scan` into one kernel: a closed loop runs several times faster. An
# option that XLA does not know aborts the process, so it is set only where it was tried.
_FOLD = "xla_cpu_small_while_loop_byte_threshold"
_TRIED = ("0.10.2",)


def configure() -> None:
    """Double precision, and folded loops where the installed jaxlib is known to take the option.

    Call it at the top of a program, before anything is computed. `XLA_FLAGS` that already name the
    option are left alone.
    """
    jax.config.update("jax_enable_x64", True)
    flags = os.environ.get("XLA_FLAGS", "")
    if _FOLD in flags:
        return
    if jaxlib.version.__version__ in _TRIED:
        # XLA takes one list of extra options, separated by commas
        os.environ["XLA_FLAGS"] = f"{flags} --xla_backend_extra_options={_FOLD}=65536".strip()
    else:
        print(f"jaxlib {jaxlib.version.__version__} was not tried with {_FOLD}: loops run slower.")
