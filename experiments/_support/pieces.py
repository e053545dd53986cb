"""Long work in pieces, each kept as soon as it is done: a run that stopped goes on from there."""

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
    """Finished pieces of work, one file each, that is whole or not there.

    Attributes:
        folder: of the files. Its name holds a digest of what they were made from, so that pieces
            of other options, inputs or code are never mixed with these.
    """

    folder: Path

    @classmethod
    def of(cls, path: Path, asked: object, inputs: Iterable[Path] = ()) -> "Pieces":
        """The pieces of one run.

        Args:
            path: of the final result, beside which they are kept.
            asked: all options that the pieces depend on; its `repr` tells them apart.
            inputs: files that they are made from.
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
        """The file of a piece."""
        return self.folder / f"{name}.npz"

    def save(self, name: str, arrays: Arrays) -> None:
        """Keep a piece."""
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        write_bytes(self.path(name), buffer.getvalue())

    def load(self, name: str) -> dict[str, np.ndarray]:
        """A piece that was kept."""
        with np.load(self.path(name)) as archive:
            return dict(archive)

    def complete(
        self,
        names: Sequence[str],
        make: Callable[[str], Arrays],
        processes: int,
        label: str,
    ) -> list[dict[str, np.ndarray]]:
        """All pieces in order, after those that are missing were made.

        Args:
            names: of all pieces.
            make: a piece from its name; a function that other processes can import.
            processes: how many make pieces side by side; the pieces do not depend on it.
            label: of the progress bar.
        """
        missing = [name for name in names if not self.path(name).exists()]
        made = each(partial(_keep, self, make), missing, processes)
        for _ in tqdm(made, label, len(names), initial=len(names) - len(missing)):
            pass
        return [self.load(name) for name in names]

    def discard(self) -> None:
        """Delete them, once the result is written."""
        shutil.rmtree(self.folder)


def _keep(pieces: Pieces, make: Callable[[str], Arrays], name: str) -> None:
    pieces.save(name, make(name))
