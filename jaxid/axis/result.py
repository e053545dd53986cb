"""The one shape of what the commands find, and the one way that it is written."""

import shlex
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from jaxid.axis.file import PROGRAM, Axis
from jaxid.io.manifest import Part
from jaxid.io.results import write_result


class Result(ABC):
    """What one run of a command found.

    Attributes:
        name: of the command, and of its part of the manifest.
        names: of the files.
    """

    name: ClassVar[str]
    names: ClassVar[tuple[str, ...]]

    @property
    @abstractmethod
    def axis(self) -> Axis:
        """That it was found of."""

    @property
    def sources(self) -> dict[str, str]:
        """SHA-256 of the files that it was found from: axis, log."""
        return {"axis": self.axis.digest}

    @property
    def results(self) -> dict[str, str]:
        """Digests of the results that it rests on, by where they are: design, all_0.6s/design."""
        return {}

    @abstractmethod
    def summary(self) -> object:
        """For other programs: a structure of `jaxid.axis.summaries`, or rows."""

    @abstractmethod
    def files(self) -> Mapping[str, bytes]:
        """What is written, by name."""

    @abstractmethod
    def text(self) -> str:
        """For people."""


def write(folder: Path, result: Result, *, replace: bool = False) -> Part:
    """Write all files of a result into a folder, with a manifest; or, if that fails, none.

    Args:
        folder: to write into; what else it holds stays (`jaxid.io.results`).
        result: of a command.
        replace: files that are there.

    Returns:
        What the manifest says of it.

    Raises:
        ValueError: if something would be replaced that must not be.
        OSError: if the disk refuses.
    """
    command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
    part = Part(program=PROGRAM, command=command, sources=result.sources, results=result.results)
    return write_result(folder, result.name, part, result.files(), replace=replace)
