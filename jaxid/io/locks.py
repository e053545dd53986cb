"""Locks that let one process at a time write to a folder and everything in it.

They are those of the kernel (`flock`) on the folders themselves: they end with the process that
holds them, however it ends, and leave no file. Windows has none, and NFS none for folders: there,
two processes that write to one folder at the same time are not kept apart.
"""

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

SECONDS = 60.0  # longest wait; writing a folder takes much less
_PAUSE = 0.01  # s
_BUSY = (errno.EWOULDBLOCK, errno.EACCES)


@contextmanager
def alone_in(folder: Path) -> Iterator[bool]:
    """Lock a folder, so that no other user of this function replaces it or anything in it.

    The folder and its parent are locked exclusively, the folders above shared: a process that
    replaces one of those waits. Locks are taken from the top, so that there is no deadlock.

    Args:
        folder: absolute path, which need not exist; its parent must.

    Yields:
        True if the folder is locked, False on a file system without locks of folders.

    Raises:
        TimeoutError: if another process holds a lock for more than 60 s.
    """
    until, closest = time.monotonic() + SECONDS, (folder, folder.parent)
    while True:
        with ExitStack() as locks:
            held = {
                place: locks.enter_context(_locked(place, until, alone=place in closest))
                for place in (*reversed(folder.parents), folder)
                if place.is_dir()
            }
            # during the wait, the folder may have been replaced
            if folder.is_dir() == (folder in held) and all(map(_still, held.values(), held)):
                yield all(held[place] is not None for place in closest if place in held)
                return


@contextmanager
def _locked(place: Path, until: float, *, alone: bool) -> Iterator[int | None]:
    """Lock a folder and yield its descriptor; None if it cannot be locked."""
    try:
        descriptor = os.open(place, os.O_RDONLY)
    except OSError:  # not readable, or removed meanwhile; Windows opens no folder
        yield None
        return
    try:
        yield descriptor if _lock(descriptor, place, until, alone=alone) else None
    finally:
        os.close(descriptor)


def _lock(descriptor: int, place: Path, until: float, *, alone: bool) -> bool:
    """Wait for a lock; return False if the system has none."""
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
    """Return whether a path still names the folder that was locked."""
    if descriptor is None:
        return True
    try:
        return os.path.samestat(os.fstat(descriptor), place.stat())
    except FileNotFoundError:
        return False
