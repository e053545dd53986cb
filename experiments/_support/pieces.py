"""Long computations in pieces that are saved one by one, so that a stopped run can continue."""

import hashlib
import io
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

import experiments
import jaxid
from experiments._support.processes import each
from jaxid.io.files import write_bytes

Arrays = Mapping[str, np.ndarray]


class Pieces(NamedTuple):
    """The finished pieces of a computation, one file each, which is either complete or absent.

    Attributes:
        folder: folder of the files. Its name contains a digest of options, inputs and code, so that
            pieces of different runs are never mixed.
    """

    folder: Path

    @classmethod
    def of(cls, path: Path, asked: object, inputs: Iterable[Path] = ()) -> "Pieces":
        """Return the pieces of one run.

        Args:
            path: file of the final result; the pieces are saved in a folder beside it.
            asked: all options that the pieces depend on; its `repr` identifies them.
            inputs: files that the pieces are computed from.
        """
        digest = hashlib.sha256(repr(asked).encode())
        for package in (jaxid, experiments):
            top = Path(str(package.__file__)).parent
            for code in sorted(top.rglob("*.py")):
                digest.update(str(code.relative_to(top)).encode() + b"\0" + code.read_bytes())
        for library in ("jax", "numpy", "scipy"):
            digest.update(version(library).encode())
        for file in inputs:
            digest.update(file.read_bytes())
        return cls(path.with_name(f"{path.stem}_{digest.hexdigest()[:16]}.pieces"))

    def path(self, name: str) -> Path:
        """Return the file of a piece."""
        return self.folder / f"{name}.npz"

    def save(self, name: str, arrays: Arrays) -> None:
        """Save a piece."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        write_bytes(self.path(name), buffer.getvalue())

    def load(self, name: str) -> dict[str, np.ndarray]:
        """Return a saved piece."""
        with np.load(self.path(name)) as archive:
            return dict(archive)

    def complete(
        self,
        names: Sequence[str],
        make: Callable[[str], Arrays],
        processes: int,
        label: str,
    ) -> list[dict[str, np.ndarray]]:
        """Compute the missing pieces, and return all pieces in order.

        Args:
            names: names of all pieces.
            make: function that computes a piece from its name, and that other processes can import.
            processes: number of processes that compute pieces in parallel; the pieces do not depend
                on it.
            label: label of the progress bar.
        """
        missing = [name for name in names if not self.path(name).exists()]
        made = each(partial(_keep, self, make), missing, processes)
        for _ in tqdm(made, label, len(names), initial=len(names) - len(missing)):
            pass
        return [self.load(name) for name in names]

    def discard(self) -> None:
        """Delete all pieces, once the result is written."""
        shutil.rmtree(self.folder)


def _keep(pieces: Pieces, make: Callable[[str], Arrays], name: str) -> None:
    pieces.save(name, make(name))
