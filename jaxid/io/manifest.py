"""The manifest of a folder of results: `manifest.json`, with the SHA-256 of every file."""

import hashlib
from pathlib import Path

import msgspec

MANIFEST = "manifest.json"


class Part(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The record of one run of a command that wrote into a folder.

    All digests are SHA-256, in hexadecimal.

    Attributes:
        program: name and version of the program that wrote the files.
        command: words of the command line.
        sources: digest of each source that was read, by kind: `axis` (the axis file and the Python
            module that it names) and `log`.
        results: `digest` of each result that was read, by place: `design` in the same folder,
            `all_0.6s/design` in the folder all_0.6s below it.
        files: digest of each file that was written, by its name.
    """

    program: str
    command: str
    sources: dict[str, str] = {}
    results: dict[str, str] = {}
    files: dict[str, str] = {}

    @property
    def digest(self) -> str:
        """The SHA-256 of all files together: that of the lines of `sha256sum`, sorted by name."""
        lines = [f"{digest}  {name}\n" for name, digest in sorted(self.files.items())]
        return sha256("".join(lines).encode())


class Manifest(msgspec.Struct, frozen=True):
    """The content of a `manifest.json`; files that it does not list belong to the user.

    Attributes:
        parts: record of each command that wrote into the folder, by name: design, tradeoff,
            simulate, sweep, identify.
    """

    parts: dict[str, Part]

    @property
    def files(self) -> set[str]:
        """The names of all files that the manifest lists."""
        return {name for part in self.parts.values() for name in part.files}


def sha256(data: bytes) -> str:
    """Return the SHA-256 of bytes in hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits, without loading it into memory."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def manifest_in(folder: Path) -> Manifest | None:
    """Return the manifest of a folder; None if it has none, or one that cannot be read."""
    try:
        return msgspec.json.decode((folder / MANIFEST).read_bytes(), type=Manifest)
    except (FileNotFoundError, NotADirectoryError, msgspec.DecodeError, UnicodeDecodeError):
        return None
