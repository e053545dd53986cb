"""The common form of the results of all commands, and the function that writes them."""

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
    """Base class of the results of one run of a command.

    Attributes:
        name: name of the command, and of its part of the manifest.
        names: names of the files.
    """

    name: ClassVar[str]
    names: ClassVar[tuple[str, ...]]

    @property
    @abstractmethod
    def axis(self) -> Axis:
        """The axis that the result is for."""

    @property
    def sources(self) -> dict[str, str]:
        """The SHA-256 of the files that the result was made from, by kind: axis, log."""
        return {"axis": self.axis.digest}

    @property
    def results(self) -> dict[str, str]:
        """The digests of the results that this one was made from, by place (all_0.6s/design)."""
        return {}

    @abstractmethod
    def summary(self) -> object:
        """Return the result for other programs: a structure of `jaxid.axis.summaries`, or rows."""

    @abstractmethod
    def files(self) -> Mapping[str, bytes]:
        """Return the content of the files to write, by name."""

    @abstractmethod
    def text(self) -> str:
        """Return the result as text for the terminal."""


def write(folder: Path, result: Result, *, replace: bool = False) -> Part:
    """Write all files of a result into a folder, with a manifest; if that fails, none.

    Args:
        folder: folder to write into; its other files are kept (`jaxid.io.results`).
        result: result of a command.
        replace: whether existing files may be replaced.

    Returns:
        The record of this run in the manifest.

    Raises:
        ValueError: if existing files would be replaced without `replace`.
        TimeoutError: if another process writes to the folder for more than 60 s.
        OSError: if the disk refuses.
    """
    command = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
    part = Part(program=PROGRAM, command=command, sources=result.sources, results=result.results)
    return write_result(folder, result.name, part, result.files(), replace=replace)
