"""What several commands do: find the columns of a log, and write a result and print it."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tqdm import tqdm

from jaxid._progress import Report
from jaxid.axis.file import Axis
from jaxid.axis.result import Result, write
from jaxid.io.recorded import Columns


def columns(path: Path, axis: Axis) -> Columns:
    """Return the columns of a log that the table [log] of an axis file names.

    Args:
        path: axis file.
        axis: axis in it.

    Raises:
        ValueError: if there is no such table.
    """
    if axis.columns is None:
        raise ValueError(
            f"File {path} has no table [log]. Add one that names the columns of position and "
            "input; the file that `jaxid init` writes has an example."
        )
    return axis.columns


def tell_changed(path: Path, folders: Iterable[Path]) -> None:
    """Print the folders whose motions were designed for another version of an axis file."""
    for folder in folders:
        print(f"Warning: {path} has changed since the design in {folder} was made.")


@contextmanager
def progress() -> Iterator[Report]:
    """Yield a function that shows progress on one line, with the time that remains.

    It takes the name of a step that begins, and the share of the work that is done.
    """
    shown = "{desc}: {percentage:.0f} % done, {elapsed} elapsed, {remaining} remaining"
    with tqdm(desc="preparation", total=1.0, bar_format=shown, leave=False) as line:

        def report(message: str, share: float) -> None:
            line.n = max(line.n, share)
            line.set_description_str(message)

        yield report


def finish(folder: Path, result: Result, *, replace: bool) -> None:
    """Write a result and print it, even if it cannot be written: it may have taken long.

    Args:
        folder: folder to write into.
        result: result of a command.
        replace: whether existing files may be replaced.
    """
    try:
        write(folder, result, replace=replace)
    finally:
        print(result.text())
    print(f"Wrote to {folder}: {', '.join(result.names)}")
