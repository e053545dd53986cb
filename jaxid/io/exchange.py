"""Replacement of a folder as a whole: after a crash at any moment it is the old or the new one.

The new folder is made beside the old one and takes its place in one step: `renameat2` of Linux with
RENAME_EXCHANGE. Where this is not available (other systems, NFS), the old folder is renamed first,
then the new one. Between both steps there is no folder for an instant. If the process is killed
just then, the next reader or writer restores the old one. Files of both are never mixed.
"""

import ctypes
import errno
import glob
import os
import secrets
import shutil
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from jaxid.io.locks import alone_in
from jaxid.io.manifest import MANIFEST, manifest_in

# Marks in the names of folders beside the one to write: unfinished or obsolete, and replaced. Such
# folders remain only if a process is killed; the next process removes them.
_REFUSE, _OLD = "jaxid-new", "jaxid-old"
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2  # of linux/fcntl.h and linux/fs.h
_NO_EXCHANGE = (errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP, errno.EPERM)  # EPERM: a sandbox


def is_left_over(name: str) -> bool:
    """Return whether a folder of this name was left by a process that was killed."""
    return name.startswith(".") and any(f".{kind}-" in name for kind in (_REFUSE, _OLD))


@contextmanager
def alone_and_tidy(folder: Path) -> Iterator[None]:
    """Lock a folder for this process, and remove what killed processes left beside it.

    The lock is held inside the `with` block.

    Args:
        folder: absolute path, which need not exist; its parent must.

    Raises:
        TimeoutError: if another process holds the lock for more than 60 s.
    """
    with alone_in(folder) as alone:
        if alone:  # otherwise another process may be writing
            with suppress(OSError):
                _tidy(folder)
        yield


def recover(folder: Path) -> None:
    """Put a folder back if the process that replaced it was killed between its two renames.

    Args:
        folder: absolute path.

    Raises:
        FileNotFoundError: if it must be put back by hand, since no folder can be locked here.
    """
    if folder.exists() or not (old := _left_over(folder, _OLD)):
        return
    with alone_and_tidy(folder):
        if not folder.exists():
            raise FileNotFoundError(
                f"Folder {folder} is missing, since a run that replaced it was killed: rename "
                f"{old[0]}, which is what it was."
            )


def exchange(
    folder: Path, files: Mapping[str, bytes], leave: Collection[str], *, fresh: bool
) -> None:
    """Replace a folder by one with new files and all files that it holds already, except some.

    Files that are kept are linked, with their dates; folders in it are made anew, with the same
    files.

    Args:
        folder: absolute path, locked by `alone_and_tidy`.
        files: content of the new files by name.
        leave: names that are not kept.
        fresh: whether the folder is expected not to exist.

    Raises:
        FileExistsError: if a folder is there now that was expected not to exist.
        OSError: if the replacement fails. The folder is then the old one, or the new one if only
            the removal of the old one failed.
    """
    new, old = _beside(folder, _REFUSE), _beside(folder, _OLD)
    try:
        new.mkdir()
        for name, data in files.items():
            _write(new / name, data)
        if not fresh:
            shutil.copymode(folder, new)
            _carry(folder, new, leave)
        for place, _, _ in os.walk(new):
            _sync(Path(place))
        if fresh:
            _appear(new, folder)
        else:
            _swap(new, folder, old)
    except BaseException:
        _remove(new)
        raise
    _sync(folder.parent)
    if not fresh:
        with suppress(OSError):  # otherwise the next process does it
            _retire(old, folder)


def _appear(new: Path, folder: Path) -> None:
    """Rename a new folder to its final name."""
    try:
        new.rename(folder)
    except OSError as error:
        if error.errno in (errno.ENOTEMPTY, errno.EEXIST):
            raise FileExistsError(
                f"Folder {folder} was written by another run in the meantime; nothing of this one "
                "was written."
            ) from None
        raise


def _swap(new: Path, folder: Path, old: Path) -> None:
    """Put a new folder in the place of another one, which is renamed."""
    if _exchanged(new, folder):
        new.rename(old)
        return
    try:
        folder.rename(old)
        new.rename(folder)
    except BaseException:
        if not folder.exists():
            old.rename(folder)
        raise


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two folders in one step; return False if the system cannot."""
    if sys.platform != "linux":
        return False
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if renameat2 is None:
        return False
    paths = (_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other))
    if renameat2(*paths, ctypes.c_uint(_RENAME_EXCHANGE)) == 0:
        return True
    code = ctypes.get_errno()
    if code in _NO_EXCHANGE:
        return False
    raise OSError(code, os.strerror(code), str(one), None, str(other))


def _tidy(folder: Path) -> None:
    """Finish what killed processes left unfinished beside a folder."""
    for old in _left_over(folder, _OLD):
        if folder.exists():
            _retire(old, folder)
        else:
            old.rename(folder)
    for refuse in _left_over(folder, _REFUSE):
        _remove(refuse)


def _retire(old: Path, folder: Path) -> None:
    """Remove a replaced folder, after files that a user put into it meanwhile are rescued."""
    _rescue(old, folder)
    refuse = _beside(folder, _REFUSE)
    old.rename(refuse)  # if removal is interrupted, the rest must not count as a replaced folder
    _remove(refuse)


def _carry(old: Path, new: Path, leave: Collection[str] = ()) -> None:
    """Link or copy everything of one folder into another."""
    for entry in old.iterdir():
        target = new / entry.name
        if entry.name in leave:
            continue
        if _is_folder(entry):
            target.mkdir()
            _carry(entry, target)
            shutil.copystat(entry, target)
        else:
            _link(entry, target)


def _rescue(old: Path, new: Path) -> None:
    """Move files to the new folder that are missing there, or older there."""
    known = [manifest_in(place) for place in (old, new)]
    written = {MANIFEST}.union(*(one.files for one in known if one))
    for entry in old.iterdir():
        target = new / entry.name
        if entry.name in written:
            continue
        if _is_folder(entry) and _is_folder(target):
            _rescue(entry, target)
        elif not os.path.lexists(target) or entry.lstat().st_mtime_ns > target.lstat().st_mtime_ns:
            entry.replace(target)


def _link(old: Path, new: Path) -> None:
    """Give a file a second name; copy it where the file system has no hard links."""
    try:
        os.link(old, new, follow_symlinks=False)
    except OSError:
        shutil.copy2(old, new, follow_symlinks=False)
        if not new.is_symlink():
            _sync(new)


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _write(path: Path, data: bytes) -> None:
    """Write a file so that it is on the disk before its name is in the folder."""
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _sync(path: Path) -> None:
    """Flush the names of a folder, or the bytes of a file, to the disk; not on Windows."""
    if os.name == "nt":
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _beside(folder: Path, kind: str) -> Path:
    return folder.with_name(f".{folder.name}.{kind}-{secrets.token_hex(4)}")


def _left_over(folder: Path, kind: str) -> list[Path]:
    return sorted(folder.parent.glob(f".{glob.escape(folder.name)}.{kind}-*"))


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
