"""Options of programs with a toy size, whose files never overwrite those of a full run."""

from pathlib import Path


class Toys:
    """Options of a program that has a toy size, with file names of its own.

    Attributes:
        out: folder of the files.
        toy: run with minimal effort, only to show that everything works.
    """

    out: Path
    toy: bool

    def named(self, name: str) -> Path:
        """Return the path of a file; a toy run uses other names and overwrites no full result."""
        return self.out / (f"toy_{name}" if self.toy else name)
