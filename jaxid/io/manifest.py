"""What a folder of results says of itself: `manifest.json`, with the SHA-256 of every file."""

import hashlib
from pathlib import Path

import msgspec

MANIFEST = "manifest.json"


class Part(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What one run of a command wrote into a folder. All digests are SHA-256, in hexadecimal.

    Attributes:
        program: name and version of the program that wrote it.
        command: the words that started it.
        sources: digest of each file that was read, by what it is: `axis` (of the axis file and of
            the Python module that it names) and `log`.
        results: `digest` of each result of the program that was read, by where it is: `design` in
            the same folder, `all_0.6s/design` in the folder all_0.6s below it.
        files: digest of each file that was written, by its name.
    """

    program: str
    command: str
    sources: dict[str, str] = {}
    results: dict[str, str] = {}
    files: dict[str, str] = {}

    @property
    def digest(self) -> str:
        """Of all files together: that of the lines that `sha256sum` prints, sorted by name."""
        lines = [f"{digest}  {name}\n" for name, digest in sorted(self.files.items())]
        return sha256("".join(lines).encode())


class Manifest(msgspec.Struct, frozen=True):
    """The content of a `manifest.json`. Files that are not in it are the user's.

    Attributes:
        parts: what each command wrote, by its name: design, tradeoff, simulate, sweep, identify.
    """

    parts: dict[str, Part]

    @property
    def files(self) -> set[str]:
        """The names of all files that it speaks of."""
        return {name for part in self.parts.values() for name in part.files}


def sha256(data: bytes) -> str:
    """In hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def sha256_of(path: Path) -> str:
    """Of a file, however large it is."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def manifest_in(folder: Path) -> Manifest | None:
    """That of a folder; None if it has none, or one that cannot be read."""
    try:
        return msgspec.json.decode((folder / MANIFEST).read_bytes(), type=Manifest)
    except (FileNotFoundError, NotADirectoryError, msgspec.DecodeError, UnicodeDecodeError):
        return None
