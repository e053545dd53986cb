"""Folders like those that `jaxid design` writes, made without a search."""

from pathlib import Path

from jaxid.axis.file import PROGRAM
from jaxid.axis.summaries import DesignSummary
from jaxid.io.files import json_bytes
from jaxid.io.manifest import Part
from jaxid.io.results import write_result


def save_design(folder: Path, trajectory: Path, digest: str) -> None:
    """Save a motion as a design for all parameters of the axis file with this SHA-256."""
    summary = DesignSummary(
        program=PROGRAM,
        axis_sha256=digest,
        target="all",
        search="none",
        begins_s=0.0,
        ends_s=1.0,
        parameters={},
        margins={},
        assumptions=(),
    )
    files = {"trajectory.csv": trajectory.read_bytes(), "design.json": json_bytes(summary)}
    part = Part(program=PROGRAM, command="jaxid design", sources={"axis": digest})
    write_result(folder, "design", part, files)
