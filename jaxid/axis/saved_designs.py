"""Designs in folders, read back: only if every file is the one that was written."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import msgspec

from jaxid._checks import require
from jaxid.axis.design_result import DesignResult
from jaxid.axis.file import Axis
from jaxid.axis.summaries import DesignSummary
from jaxid.io.files import trajectory_in
from jaxid.io.manifest import Part, manifest_in
from jaxid.io.results import read_result
from jaxid.motion.trajectory import JerkTrajectory


class SavedDesign(NamedTuple):
    """A design that `jaxid design` wrote.

    Attributes:
        folder: that it is in.
        part: what the manifest of the folder says of it.
        summary: its `design.json`.
        motion: its `trajectory.csv`.
    """

    folder: Path
    part: Part
    summary: DesignSummary
    motion: JerkTrajectory


class SavedDesigns(NamedTuple):
    """All designs in a folder.

    Attributes:
        folder: that they are in.
        designs: by where they are in it: design, or all_0.6s/design.
    """

    folder: Path
    designs: Mapping[str, SavedDesign]


def read_design(folder: Path, coordinate: str) -> SavedDesign:
    """The design in a folder.

    Args:
        folder: that `jaxid design` wrote.
        coordinate: linear or rotary.

    Raises:
        ValueError: if it is none, or one of its files was changed.
    """
    part, files = read_result(folder, DesignResult.name)
    try:
        summary = msgspec.json.decode(files["design.json"], type=DesignSummary)
    except (KeyError, msgspec.DecodeError):
        raise ValueError(
            f"Folder {folder} was written by {part.program}, whose design.json is another one: "
            "design anew, with --force."
        ) from None
    path = folder / "trajectory.csv"
    return SavedDesign(folder, part, summary, trajectory_in(files[path.name], path, coordinate))


def designs_in(folder: Path, coordinate: str) -> SavedDesigns:
    """The design in a folder, and those in the folders in it.

    Args:
        folder: that `jaxid design` wrote, for one motion or for several.
        coordinate: linear or rotary.

    Raises:
        ValueError: if there is none, or one that is not as it was written.
    """
    below = sorted(path for path in folder.glob("*") if not path.name.startswith("."))
    found = {
        str(place.relative_to(folder) / DesignResult.name): read_design(place, coordinate)
        for place in (folder, *below)
        if _is_design(place)
    }
    require(found, f"Argument `folder`: {folder} must hold designs of jaxid design.")
    return SavedDesigns(folder, found)


def of_another_axis(designs: Iterable[SavedDesign], axis: Axis) -> tuple[Path, ...]:
    """Folders of those that were designed for another axis file, or for what this one was."""
    return tuple(one.folder for one in designs if one.part.sources.get("axis") != axis.digest)


def _is_design(folder: Path) -> bool:
    manifest = manifest_in(folder)
    known = manifest is not None and DesignResult.name in manifest.parts
    return known or (folder / "design.json").exists()
