"""Programs that can be tried at toy size, without touching what they keep."""

from pathlib import Path


class Toys:
    """Options of a program that has a toy size, whose files have names of their own.

    Attributes:
        out: the folder of its files.
        toy: run a tiny version that only shows that the program works.
    """

    out: Path
    toy: bool

    def named(self, name: str) -> Path:
        """A file; a toy's never takes the place of a real one."""
        return self.out / (f"toy_{name}" if self.toy else name)
