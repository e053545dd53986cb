"""Designs in folders, read back: only if no file was changed since it was written."""

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
    """A design that `jaxid design` wrote, read back.

    Attributes:
        folder: folder of the design.
        part: record of its run in the manifest of the folder.
        summary: content of its `design.json`.
        motion: motion in its `trajectory.csv`.
    """

    folder: Path
    part: Part
    summary: DesignSummary
    motion: JerkTrajectory


class SavedDesigns(NamedTuple):
    """All designs in a folder, read back.

    Attributes:
        folder: folder of the designs.
        designs: designs by their places in the folder: design, or all_0.6s/design.
    """

    folder: Path
    designs: Mapping[str, SavedDesign]


def read_design(folder: Path, coordinate: str) -> SavedDesign:
    """Return the design in a folder.

    Args:
        folder: folder that `jaxid design` wrote.
        coordinate: "linear" (m) or "rotary" (rad).

    Raises:
        ValueError: if the folder holds no design, or one of its files was changed.
    """
    part, files = read_result(folder, DesignResult.name)
    try:
        summary = msgspec.json.decode(files["design.json"], type=DesignSummary)
    except (KeyError, msgspec.DecodeError):
        raise ValueError(
            f"Folder {folder} was written by {part.program}, whose design.json has another format: "
            "repeat the design with --force."
        ) from None
    path = folder / "trajectory.csv"
    return SavedDesign(folder, part, summary, trajectory_in(files[path.name], path, coordinate))


def designs_in(folder: Path, coordinate: str) -> SavedDesigns:
    """Return the designs in a folder and in its subfolders.

    Args:
        folder: folder that `jaxid design` wrote, for one motion or for several.
        coordinate: "linear" (m) or "rotary" (rad).

    Raises:
        ValueError: if there is none, or a file of one was changed.
    """
    below = sorted(path for path in folder.glob("*") if not path.name.startswith("."))
    found = {
        str(place.relative_to(folder) / DesignResult.name): read_design(place, coordinate)
        for place in (folder, *below)
        if _is_design(place)
    }
    require(found, f"Folder {folder} has no design; write one with `jaxid design`.")
    return SavedDesigns(folder, found)


def of_another_axis(designs: Iterable[SavedDesign], axis: Axis) -> tuple[Path, ...]:
    """Return the folders of designs whose axis file was another one, or has changed since.

    Args:
        designs: designs that were read back.
        axis: axis from the present axis file.
    """
    return tuple(one.folder for one in designs if one.part.sources.get("axis") != axis.digest)


def _is_design(folder: Path) -> bool:
    manifest = manifest_in(folder)
    known = manifest is not None and DesignResult.name in manifest.parts
    return known or (folder / "design.json").exists()
