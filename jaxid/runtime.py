"""What a program switches on before its first computation; an import changes nothing."""

import os
import signal

import jax
import jaxlib.version

from jaxid._checks import require

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


def processors() -> int:
    """How many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def connect(
    devices: int,
    coordinator: str | None = None,
    processes: int | None = None,
    process_id: int | None = None,
) -> None:
    """Several devices on the CPU, and other processes to share the work with.

    Call it before anything is computed. A Slurm job step of several tasks is recognised by itself;
    other processes are told of one another by the last three arguments.

    Args:
        devices: of this process, and of every other. `jax.devices()` may have one more, which
            stays idle: see `jaxid.sweep.blocks`.
        coordinator: host:port of process 0, a free port.
        processes: how many there are.
        process_id: which of them this is, from 0.
    """
    by_hand = (coordinator, processes, process_id)
    require(devices >= 1, f"Argument `devices` must be at least 1, but is {devices}.")
    require(
        by_hand.count(None) in (0, 3),
        "Arguments `coordinator`, `processes` and `process_id` must be given together, "
        f"but are {by_hand}.",
    )
    count = processes or _slurm_tasks()
    jax.config.update("jax_num_cpu_devices", max(devices, 2) if count == 1 else devices)
    if count > 1:
        jax.distributed.initialize(*by_hand)
        # it takes SIGTERM for a warning, and would go on; there is nothing here to be warned of
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _slurm_tasks() -> int:
    """Of the job step that this process belongs to: 1 in a batch script, outside `srun`."""
    if "SLURM_STEP_NODELIST" not in os.environ:
        return 1
    return int(os.environ.get("SLURM_STEP_NUM_TASKS") or os.environ.get("SLURM_NTASKS", "1"))
