"""The command `jaxid identify`."""

from pathlib import Path

from jaxid.axis.commands.shared import columns, finish, progress
from jaxid.axis.file import Axis
from jaxid.axis.identify import IdentifyResult, identify_axis
from jaxid.io.log_file import read_log
from jaxid.io.manifest import sha256_of
from jaxid.io.results import require_writable


def run(known: Axis, axis: Path, log: Path, out: Path, *, force: bool) -> bool:
    """Identify the axis from a log, write the result, and return whether the log is consistent.

    The arguments are those of `jaxid.axis.cli.identify`; `known` is the axis of the axis file.
    """
    require_writable(out, IdentifyResult.names, replace=force)
    recorded = read_log(log, columns(axis, known))
    with progress() as report:
        found = identify_axis(known, recorded, report)
    finish(out, IdentifyResult(found, sha256_of(log)), replace=force)
    if found.interruption is not None:
        raise KeyboardInterrupt from None
    return found.result is not None
