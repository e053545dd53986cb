"""The command `jaxid prior`."""

from pathlib import Path

from jaxid.axis.commands.shared import columns, progress
from jaxid.axis.file import Axis
from jaxid.axis.prior import propose
from jaxid.io.log_file import read_log


def run(known: Axis, axis: Path, log: Path) -> None:
    """Print a proposal for prior intervals and δ from a log.

    The arguments are those of `jaxid.axis.cli.prior`; `known` is the axis of the axis file.
    """
    recorded = read_log(log, columns(axis, known))
    with progress() as report:
        found = propose(known, recorded, report)
    print(found.text())
