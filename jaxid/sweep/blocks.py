"""A function at many items, in blocks of fixed size: on all devices of all processes, resumable.

The unit of work is a block of a few items. A round gives one block to every device of every
process; each process writes the blocks of its own devices to files in a folder that all can reach,
whole or not at all. A run that is killed loses the blocks of one round at most: the next run
computes what is missing.

Every device runs one program on arrays of one shape, without a collective: the results are the
same to the last bit however many devices and processes share the work, and however often it was
interrupted. There are two conditions: machines of one kind, since a compiler uses the instructions
that it finds; and two devices or more, one of which may be idle, since XLA optimises a program for
a single device in another order, which changes last bits (`jaxid.runtime.connect` sees to it).
"""

import functools
import hashlib
import io
import os
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import jaxlib.version
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Int

from jaxid._checks import require
from jaxid.io.files import write_bytes

Outputs = Mapping[str, Array]
Values = dict[str, np.ndarray]
Report = Callable[[int, int], object]

_AXIS = "blocks"
_FINGERPRINT = "fingerprint"
_MISSING, _DONE, _FOREIGN = range(3)
_IDLE = -1


@dataclass(frozen=True)
class Work:
    """A function that is to be evaluated at the items 0 … count − 1, in blocks.

    Attributes:
        function: pure function of the data and the index of an item; returns arrays by name.
        data: arrays that the function needs for all items, a pytree.
        count: number of items.
        lanes: number of items of a block, evaluated together.
    """

    function: Callable[[Any, Int[Array, ""]], Outputs]
    data: Any
    count: int
    lanes: int = 8

    @property
    def blocks(self) -> int:
        """The number of blocks; the last one is filled up with the last item."""
        return -(-self.count // self.lanes)

    def block(self, data: Any, number: Int[Array, ""]) -> Outputs:
        """Return the results of one block, along a first axis of length `lanes`.

        Args:
            data: arrays that the function needs.
            number: number of the block, from 0.
        """
        items = jnp.minimum(number * self.lanes + jnp.arange(self.lanes), self.count - 1)
        return jax.vmap(self.function, in_axes=(None, 0))(data, items)

    @functools.cached_property
    def lowered(self) -> jax.stages.Lowered:
        """The lowered program of one block: its text, and the shapes of its results."""
        return jax.jit(self.block).lower(self.data, jnp.zeros((), jnp.int32))

    @functools.cached_property
    def fingerprint(self) -> str:
        """A SHA-256 of everything that the results depend on: program, data, compiler and options.

        Only blocks with the same fingerprint belong together.
        """
        compiler = (
            jax.default_backend(),
            jax.device_count() == 1,
            jax.__version__,
            jaxlib.version.__version__,
            os.environ.get("XLA_FLAGS", ""),
            jax.config.read("jax_disable_most_optimizations"),
        )
        digest = hashlib.sha256(repr((self.lowered.as_text(), compiler)).encode())
        for leaf in jax.tree.leaves(self.data):
            digest.update(np.asarray(leaf).tobytes())
        return digest.hexdigest()


def compute(
    work: Work,
    folder: Path,
    devices: int | None = None,
    report: Report = lambda done, total: None,
) -> None:
    """Evaluate the blocks of a work that are not in the folder yet; every process must call it.

    Args:
        work: work, the same in all processes.
        folder: folder of the blocks, the same for all processes, which may be on different
            machines.
        devices: number of devices of each process to use; default all.
        report: function that is called at the start and after each round with the number of blocks
            done and their total number.

    Raises:
        ValueError: if a process has other inputs, options or versions than process 0, or the folder
            holds blocks of other work.
    """
    missing = _agreed_missing(work, folder)
    mesh = Mesh(np.array(jax.devices()), (_AXIS,))
    everywhere, apart = PartitionSpec(), PartitionSpec(_AXIS)
    program = jax.jit(
        jax.shard_map(
            functools.partial(_block_or_nothing, work),
            mesh=mesh,
            in_specs=(everywhere, apart),
            out_specs=apart,
            check_vma=False,  # devices do not communicate: there is nothing to check
        )
    )
    data = jax.tree.map(lambda leaf: _placed(leaf, mesh, everywhere), work.data)
    busy = np.flatnonzero(np.arange(mesh.size) % jax.local_device_count() < (devices or mesh.size))
    done = work.blocks - missing.size
    report(done, work.blocks)
    for start in range(0, missing.size, busy.size):
        round_ = missing[start : start + busy.size]
        numbers = np.full(mesh.size, _IDLE, np.int32)
        numbers[busy[: round_.size]] = round_
        outputs = program(data, _placed(numbers, mesh, apart))
        for place, values in _of_this_process(outputs, mesh):
            if numbers[place] != _IDLE:
                _write(work, folder, int(numbers[place]), values)
        done += round_.size
        report(done, work.blocks)
    multihost_utils.sync_global_devices("all blocks are written")


def collect(work: Work, folder: Path) -> Values:
    """Return the results of all blocks that `compute` wrote, one item per entry of the first axis.

    Args:
        work: work that was computed.
        folder: folder of its blocks.

    Raises:
        ValueError: if a block is missing, or belongs to other work.
    """
    for number in range(work.blocks):
        require(
            _status(work, folder, number) == _DONE,
            f"Argument `folder`: {_path(folder, number)} is missing, or of other work: compute it "
            "first.",
        )
    blocks = [_read(folder, number)[1] for number in range(work.blocks)]
    return {name: np.concatenate([b[name] for b in blocks])[: work.count] for name in blocks[0]}


def _agreed_missing(work: Work, folder: Path) -> Int[np.ndarray, " missing"]:
    """Return the blocks to compute by process 0, after all processes agree on the work."""
    own = np.frombuffer(bytes.fromhex(work.fingerprint), np.uint8)
    found = np.zeros(work.blocks, np.uint8)
    if jax.process_index() == 0:
        found[:] = [_status(work, folder, number) for number in range(work.blocks)]
    first, found = multihost_utils.broadcast_one_to_all((own, found))
    require(
        np.array_equal(first, own),
        f"Argument `work`: process {jax.process_index()} has other inputs, options or versions "
        "than process 0: start all of them alike.",
    )
    foreign = np.count_nonzero(found == _FOREIGN)
    require(
        foreign == 0,
        f"Argument `folder`: {folder} holds {foreign} blocks of other work (other inputs, seed, "
        "options or versions), which must not be mixed with these: remove it, or name another "
        "folder.",
    )
    return np.flatnonzero(found == _MISSING)


def _block_or_nothing(work: Work, data: Any, numbers: Int[Array, "1"]) -> Outputs:
    """Return the results of one device in a round; zeros if it is idle."""

    def nothing() -> Outputs:
        return jax.tree.map(lambda out: jnp.zeros(out.shape, out.dtype), work.lowered.out_info)

    return jax.lax.cond(numbers[0] == _IDLE, nothing, lambda: work.block(data, numbers[0]))


def _placed(values: Any, mesh: Mesh, spec: PartitionSpec) -> Array:
    """Return an array over all processes from a value that every process has."""
    values = np.asarray(values)
    return jax.make_array_from_callback(
        values.shape, NamedSharding(mesh, spec), lambda index: values[index]
    )


def _of_this_process(outputs: Outputs, mesh: Mesh) -> Iterator[tuple[int, Values]]:
    """Yield the results of the devices of this process, with the place of each in the mesh."""
    places = {device: place for place, device in enumerate(mesh.devices)}
    shards = {name: array.addressable_shards for name, array in outputs.items()}
    for parts in zip(*shards.values(), strict=True):
        values = {name: np.asarray(part.data) for name, part in zip(shards, parts, strict=True)}
        yield places[parts[0].device], values


def _path(folder: Path, number: int) -> Path:
    return folder / f"block_{number:06d}.npz"


def _write(work: Work, folder: Path, number: int, values: Values) -> None:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **{_FINGERPRINT: np.array(work.fingerprint)}, **values)
    write_bytes(_path(folder, number), buffer.getvalue())


def _read(folder: Path, number: int) -> tuple[str, Values]:
    """Return the fingerprint and the arrays of a block."""
    with np.load(io.BytesIO(_path(folder, number).read_bytes())) as block:
        values = dict(block)
    return str(values.pop(_FINGERPRINT)), values


def _status(work: Work, folder: Path, number: int) -> int:
    try:
        return _DONE if _read(folder, number)[0] == work.fingerprint else _FOREIGN
    # a power failure can leave an incomplete file
    except (FileNotFoundError, EOFError, ValueError, zipfile.BadZipFile):
        return _MISSING
