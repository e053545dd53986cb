"""Settings for the start of a program; an import of the package changes none of them."""

import hashlib
import os
import platform
import signal
import tempfile
import warnings
from pathlib import Path

import jax
import jaxlib.version

from jaxid._checks import require

# This option folds a small `lax.scan` into one kernel: a closed loop runs several times faster. An
# option that XLA does not know aborts the process, so it is set only where it was tried. For
# `jaxid.run` no option is needed, see `jaxid._folding`.
_FOLD = "xla_cpu_small_while_loop_byte_threshold"
_TRIED = ("0.10.2",)

# about twice the amount that a year of work with one version adds
_MOST_COMPILED = 2_000_000_000  # bytes


def configure() -> None:
    """Switch on double precision, faster loops, and a cache of compiled code.

    Call it at the top of a program, before anything is computed. If the program binds itself to
    some of the processors (CPU affinity), it does so before. Small loops are compiled to single
    kernels where the installed jaxlib is known to have the option; `XLA_FLAGS` that already name it
    are left alone.
    Compiled code is kept for later runs, see `compilation_folder`.
    """
    jax.config.update("jax_enable_x64", True)
    _keep_compiled()
    flags = os.environ.get("XLA_FLAGS", "")
    if _FOLD in flags:
        return
    if jaxlib.version.__version__ in _TRIED:
        # XLA takes one list of extra options, separated by commas
        os.environ["XLA_FLAGS"] = f"{flags} --xla_backend_extra_options={_FOLD}=65536".strip()
    else:
        print(f"jaxlib {jaxlib.version.__version__} was not tried with {_FOLD}: loops run slower.")


def compilation_folder() -> Path | None:
    """Return the folder for compiled code in the user's cache folder; None if it is not writable.

    Compiled code is for one type and number of processors, which JAX does not distinguish: each has
    its own subfolder. Code that was compiled for another one would be slower, and could give other
    last bits.

    `JAX_COMPILATION_CACHE_DIR` names another place.
    """
    try:
        usual = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = usual / "jaxid" / hashlib.sha256(_machine().encode()).hexdigest()[:16]
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):  # not writable, or no home
        return None


def _keep_compiled() -> None:
    """Keep all compiled code, even if it compiles fast: there are many small functions."""
    if not jax.config.jax_compilation_cache_dir:  # pyright: ignore[reportAttributeAccessIssue]
        folder = compilation_folder()
        if folder is None:
            return
        _make_room(folder)
        jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    # JAX does not write entries atomically: an entry that another process has not finished is
    # compiled again
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry")


def _make_room(folder: Path, most: int = _MOST_COMPILED) -> None:
    """Remove empty entries, and the least recently used ones until the folder is small enough.

    JAX's own limit needs a lock, and reads the times of all files for every new entry. JAX never
    replaces an entry: one that a killed process left empty would be compiled in every run.
    """
    found = []
    for entry in os.scandir(folder):
        try:
            state = entry.stat()
        except OSError:  # another process has removed it
            continue
        # many systems update the access time only once a day
        used = max(state.st_atime, state.st_mtime) if state.st_size else 0.0
        found.append((used, entry.path, state.st_size))
    total = sum(size for _, _, size in found)
    for _, path, size in sorted(found):
        if size and total <= most:
            return
        Path(path).unlink(missing_ok=True)
        total -= size


def _machine() -> str:
    """Return the type and features of the processor, and the number that XLA compiles for."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    told = [line for line in lines if line.startswith(("model name", "flags", "Features"))]
    threads = [os.environ.get(name, "") for name in ("NPROC", "PJRT_NPROC")]
    kind = [platform.machine(), platform.processor(), *sorted(set(told))]
    return "\n".join([*kind, str(processors()), *threads])


def processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def connect(
    devices: int,
    coordinator: str | None = None,
    processes: int | None = None,
    process_id: int | None = None,
) -> None:
    """Set up several devices on the CPU, and other processes to share the work with.

    Call it before anything is computed. A Slurm job step of several tasks is detected
    automatically; other processes are connected by the last three arguments.

    Args:
        devices: number of devices of this process, and of every other. `jax.devices()` may have one
            more, which stays idle: see `jaxid.sweep.blocks`.
        coordinator: address host:port of process 0, with a free port.
        processes: number of processes.
        process_id: index of this process, from 0.

    Raises:
        ValueError: if `devices` is below 1, or only some of the last three arguments are given.
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
        # JAX treats SIGTERM as a warning and continues; restore the default, which ends the process
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _slurm_tasks() -> int:
    """Return the number of tasks of the Slurm job step of this process; 1 outside `srun`."""
    if "SLURM_STEP_NODELIST" not in os.environ:
        return 1
    return int(os.environ.get("SLURM_STEP_NUM_TASKS") or os.environ.get("SLURM_NTASKS", "1"))
