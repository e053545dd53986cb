"""Batches of many or long logs, for which one linear program would take minutes.

Each batch has its own linear program, with the prior box narrowed by the batches before it. At the
end all batches are processed once more together, with fewer weights per sample. If the logs are too
long for that, only the batches that are most informative together are processed.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxid.identification.joined_rows import rows_of_logs
from jaxid.loop.log import Log
from jaxid.model.system import System


class BatchSizes(NamedTuple):
    """The sizes of the batches in which logs are processed: numbers of samples, logs and weights.

    Attributes:
        samples: largest number of samples of a batch; its linear programs take about a second.
        logs: largest number of logs of a batch.
        together: largest number of samples that are processed together in the end.
        knots: number of weights of a batch; ten times as many do not narrow the motor's intervals.
        knots_together: number of weights when batches are processed together.
        finer: factor of the number of weights in the test of δ; with fewer weights, the δ that is
            needed is underestimated, by 2 % for the motor.
    """

    samples: int = 8192
    logs: int = 100
    together: int = 50_000
    knots: int = 1000
    knots_together: int = 3000
    finer: int = 3


SIZES = BatchSizes()


def batches(logs: Sequence[Log], sizes: BatchSizes = SIZES) -> tuple[tuple[Log, ...], ...]:
    """Return logs in batches, in their order, as many to a batch as fit; longer logs are cut.

    Args:
        logs: logs of one axis.
        sizes: largest numbers of samples and logs of a batch.
    """
    found: list[tuple[Log, ...]] = []
    batch: tuple[Log, ...] = ()
    for log in (part for whole in logs for part in _parts(whole, sizes.samples)):
        if batch and (_length((*batch, log)) > sizes.samples or len(batch) == sizes.logs):
            found.append(batch)
            batch = ()
        batch = (*batch, log)
    return (*found, batch)


def knots_by_length(knots: int, logs: Sequence[Log]) -> tuple[int, ...]:
    """Return the number of weights of each log, in proportion to its length and at least two.

    Args:
        knots: number of weights of all logs together.
        logs: logs of one axis.
    """
    lengths = [log.samples for log in logs]
    return tuple(max(knots * own // sum(lengths), 2) for own in lengths)


def samples_per_weight(knots: int, logs: Sequence[Log]) -> float:
    """Return the mean number of samples per weight.

    Args:
        knots: number of weights of all logs together.
        logs: logs of one axis.
    """
    return sum(log.samples for log in logs) / sum(knots_by_length(knots, logs))


def most_informative(
    system: System,
    parts: Sequence[Sequence[Log]],
    sizes: BatchSizes = SIZES,
    first: Sequence[Log] | None = None,
) -> tuple[Log, ...]:
    """Return the logs of the batches that are most informative together, within the size limit.

    Batches are added one by one, each time the one that increases the determinant of the
    information matrix most (D-optimality). The guarantee of the intervals does not depend on this
    choice.

    Args:
        system: prior box and δ, with which each batch is consistent.
        parts: batches of logs.
        sizes: largest number of samples that are processed together.
        first: batch that must be among the result; default none.
    """
    if sum(map(_length, parts)) <= sizes.together:
        return tuple(log for part in parts for log in part)
    information = [_information(system, part) for part in parts]
    chosen: list[int] = []
    total, left = np.eye(len(system.names)), sizes.together
    while fitting := [k for k, p in enumerate(parts) if k not in chosen and _length(p) <= left]:
        must = [k for k in fitting if parts[k] is first]
        best = max(must or fitting, key=lambda k: np.linalg.slogdet(total + information[k])[1])
        chosen.append(best)
        total, left = total + information[best], left - _length(parts[best])
    return tuple(log for k in sorted(chosen) for log in parts[k])


def _information(system: System, logs: Sequence[Log]) -> Float[np.ndarray, "m m"]:
    """Return Σ φφᵀ/δ², with parameters in half-widths of the prior box."""
    rows = rows_of_logs(system, logs).record.rows
    count = np.asarray(rows.measure) > 0
    phi = np.asarray(rows.regressors) * np.asarray(system.half_widths)
    phi = phi[count] / np.asarray(rows.delta)[count, None]
    return phi.T @ phi


def _parts(log: Log, most: int) -> Iterator[Log]:
    if log.input.size <= most:
        yield log
        return
    length = log.samples  # the padding of a longer log is left out
    edges = np.linspace(0, length, -(-length // most) + 1).round().astype(int).tolist()
    for first, stop in pairwise(edges):
        yield log.part(first, stop)


def _length(logs: Sequence[Log]) -> int:
    return sum(log.input.size for log in logs)
