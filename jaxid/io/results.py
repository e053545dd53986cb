"""Results as folders: one run of a command writes all its files, with a manifest, or none.

A folder may hold the results of several commands, each replaced by itself (`simulate` puts its
files beside those of `design`): these are its parts, in the words of `jaxid.io.manifest`. To write
one, the folder is made anew and exchanged as a whole (`jaxid.io.exchange`):

- the files of that part, and a manifest that lists them;
- those of other parts as they are, unless they were made from what is replaced: the simulation of a
  motion is removed with the motion;
- all others: they belong to the user and are kept, with the folders in it.

If two processes write the same part at the same time, one comes first. The second is refused, or
replaces what the first wrote if it is allowed to; parts with different names are both kept.
"""

import os
from collections.abc import Collection, Mapping
from pathlib import Path

import msgspec

from jaxid._checks import require
from jaxid.io.exchange import alone_and_tidy, exchange, is_left_over, recover
from jaxid.io.files import json_bytes
from jaxid.io.manifest import MANIFEST, Manifest, Part, manifest_in, sha256

_SHOWN = 5  # files that an error message names


def write_result(
    folder: Path, name: str, part: Part, files: Mapping[str, bytes], *, replace: bool = False
) -> Part:
    """Write all files of a part of a folder; if it fails or is killed, none.

    Args:
        folder: folder to write into; it may be new.
        name: name of the part.
        part: record of the run; its `files` are filled in.
        files: content of the files by name.
        replace: whether existing files may be replaced, with the parts made from them.

    Returns:
        The record of the run with the digests of its files.

    Raises:
        ValueError: if existing files would be replaced without `replace`, or a result that the part
            was made from has changed since it was read.
        TimeoutError: if another process writes to the folder for more than 60 s.
        OSError: if the disk refuses; the folder is unchanged.
    """
    folder = folder.resolve()
    part = msgspec.structs.replace(part, files={file: sha256(x) for file, x in files.items()})
    folder.parent.mkdir(parents=True, exist_ok=True)
    with alone_and_tidy(folder):
        fresh = not folder.exists()
        _require_unchanged(folder, part)
        old = manifest_in(folder) or Manifest({})
        kept = _kept(old, name, part)
        manifest = Manifest({**kept, name: part})
        gone = [*files, *sorted(old.files - manifest.files)]
        _require_free(folder, gone, replace=replace, late=True)
        data = {**files, MANIFEST: json_bytes(manifest)}
        exchange(folder, data, {*gone, MANIFEST}, fresh=fresh)
    return part


def read_result(folder: Path, name: str) -> tuple[Part, dict[str, bytes]]:
    """Return the record and the files of a part of a folder, if they are unchanged.

    Args:
        folder: folder of a result.
        name: name of the part.

    Returns:
        The record of the part, and the content of its files by name.

    Raises:
        ValueError: if the folder has no such part, or one of its files was changed or removed.
    """
    recover(folder.resolve())
    while True:
        part = _part(folder, name)
        found = {file: _bytes(folder / file) for file in part.files}
        if _part(folder, name) == part:  # it was not replaced between two files
            break
    for file, data in found.items():
        changed = "removed" if data is None else "changed"
        require(
            data is not None and sha256(data) == part.files[file],
            f"File {folder / file} was {changed} after jaxid {name} wrote it: restore it, or "
            f"repeat jaxid {name} with --force.",
        )
    return part, {file: data for file, data in found.items() if data is not None}


def require_writable(folder: Path, files: Collection[str], *, replace: bool) -> None:
    """Raise an error before a long computation if `write_result` would raise one after it.

    Args:
        folder: folder to write into.
        files: names of the files to write.
        replace: whether existing files may be replaced.

    Raises:
        ValueError: if files would be replaced that must not be, or the folder cannot be replaced.
    """
    whole = folder.resolve()
    recover(whole)
    require(
        not whole.exists() or whole.is_dir(),
        f"{folder} must be a folder, or the name of a new one, but is a file.",
    )
    here = Path.cwd()
    require(
        not whole.exists() or whole not in (here, *here.parents),
        f"Folder {folder} cannot be replaced while the current directory is in it: change to "
        f"{whole.parent} first.",
    )
    require(
        not whole.is_mount(),
        f"Folder {folder} is a mount point, which cannot be replaced: name a folder in it.",
    )
    parent = next(place for place in (whole, *whole.parents) if place.exists())
    require(
        parent.is_dir() and os.access(parent, os.W_OK | os.X_OK),
        f"Folder {folder} cannot be written: {parent} is no folder, or not writable.",
    )
    _require_free(folder, files, replace=replace)


def _require_free(
    folder: Path, files: Collection[str], *, replace: bool, late: bool = False
) -> None:
    """Raise an error if files would be replaced, or mixed with a user's, without permission."""
    there = [str(folder / name) for name in files if (folder / name).exists()]
    exist = "already exists" if len(there) == 1 else "already exist"
    first = " If new, another run finished first; nothing of this run was written." if late else ""
    require(
        replace or not there,
        f"{', '.join(there)} {exist}; use --force to overwrite.{first}",
    )
    own = manifest_in(folder)
    foreign = [name for name in (*files, MANIFEST) if (folder / name).is_dir()]
    if own is None and (folder / MANIFEST).exists():
        foreign.append(MANIFEST)
    require(
        not foreign,
        f"Folder {folder} has {', '.join(dict.fromkeys(foreign))}, which jaxid did not write and "
        "does not replace: name another folder.",
    )
    if replace or own or not folder.exists():
        return
    strange = [path.name for path in sorted(folder.iterdir()) if not _is_own(path)]
    shown = ", ".join(strange[:_SHOWN]) + (", …" if len(strange) > _SHOWN else "")
    require(
        not strange,
        f"Folder {folder} has files that jaxid did not write ({shown}): name another folder, or "
        "use --force to add the results; your files are kept.",
    )


def _is_own(path: Path) -> bool:
    """Return whether a path is a folder of a result, or left by a killed process."""
    return path.is_dir() and (is_left_over(path.name) or manifest_in(path) is not None)


def _require_unchanged(folder: Path, part: Part) -> None:
    """Raise an error if a result that a part was made from has changed since it was read."""
    for where, digest in part.results.items():
        place = folder / where
        known = manifest_in(place.parent)
        now = known.parts.get(place.name) if known else None
        require(
            now is not None and now.digest == digest,
            f"The {place.name} in {place.parent} was replaced by another run in the meantime; "
            "nothing was written. Start again.",
        )


def _part(folder: Path, name: str) -> Part:
    """Return the record of a part of a folder, by its manifest."""
    manifest = manifest_in(folder)
    if manifest is None:
        raise ValueError(
            f"Folder {folder} must be a result of jaxid {name}, but has no {MANIFEST} that can be "
            f"read: run jaxid {name} first."
        )
    require(
        name in manifest.parts,
        f"Folder {folder} must be a result of jaxid {name}, but by its {MANIFEST} it is one of "
        f"jaxid {', '.join(manifest.parts)}.",
    )
    return manifest.parts[name]


def _kept(old: Manifest, name: str, part: Part) -> dict[str, Part]:
    """Return the other parts, except those made from something that is replaced."""
    now = {**part.results, name: part.digest}
    return {
        other: one
        for other, one in old.parts.items()
        if other != name
        and all(now.get(where, digest) == digest for where, digest in one.results.items())
    }


def _bytes(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
