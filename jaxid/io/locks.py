"""One writer at a time for a folder, and for whatever is in it.

The locks are those of the kernel (`flock`) on the folders themselves: they end with the process
that holds them, however it ends, and leave no file. Windows has none, and NFS none for folders: two
processes that write to one folder there at the same time are not kept apart.
"""

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

SECONDS = 60.0  # of waiting: a folder is written within one
_PAUSE = 0.01  # s
_BUSY = (errno.EWOULDBLOCK, errno.EACCES)


@contextmanager
def alone_in(folder: Path) -> Iterator[bool]:
    """While no other process that uses this replaces a folder, or anything in it.

    The folder and the one that it is in are locked for this process alone, those above together
    with others: who replaces one of them waits. Locks are taken from above, so that nobody waits
    for one who waits for her.

    Args:
        folder: an absolute path, which need not exist; the folder that it is in must.

    Yields:
        Whether this is so; false on a file system that locks no folder.

    Raises:
        TimeoutError: if another process does not come to its end.
    """
    until, closest = time.monotonic() + SECONDS, (folder, folder.parent)
    while True:
        with ExitStack() as locks:
            held = {
                place: locks.enter_context(_locked(place, until, alone=place in closest))
                for place in (*reversed(folder.parents), folder)
                if place.is_dir()
            }
            # while one was waited for, another folder may have come to its place
            if folder.is_dir() == (folder in held) and all(map(_still, held.values(), held)):
                yield all(held[place] is not None for place in closest if place in held)
                return


@contextmanager
def _locked(place: Path, until: float, *, alone: bool) -> Iterator[int | None]:
    """A folder, as a descriptor; none if it cannot be locked."""
    try:
        descriptor = os.open(place, os.O_RDONLY)
    except OSError:  # not to be read, or gone meanwhile; Windows opens no folder
        yield None
        return
    try:
        yield descriptor if _lock(descriptor, place, until, alone=alone) else None
    finally:
        os.close(descriptor)


def _lock(descriptor: int, place: Path, until: float, *, alone: bool) -> bool:
    """Wait for a lock; false if there are none."""
    if sys.platform == "win32":
        return False
    import fcntl

    while True:
        try:
            fcntl.flock(descriptor, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in _BUSY:
                return False
        else:
            return True
        if time.monotonic() > until:
            raise TimeoutError(
                f"Another process has been writing to {place} for {SECONDS:g} s: end it, or choose "
                "another folder."
            )
        time.sleep(_PAUSE)


def _still(descriptor: int | None, place: Path) -> bool:
    """Whether a path is that of the folder that was locked."""
    if descriptor is None:
        return True
    try:
        return os.path.samestat(os.fstat(descriptor), place.stat())
    except FileNotFoundError:
        return False
