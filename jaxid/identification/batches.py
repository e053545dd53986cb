"""Many or long logs in batches: one linear program for all of them would take minutes.

Each batch is a linear program of its own, with the prior box that the batches before it leave. In
the end the batches are processed once more together with fewer weights for each sample; of longer
logs those batches that are most informative together.
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
    """How much is processed at once. Numbers of samples (servo ticks), logs and weights.

    Attributes:
        samples: of a batch at most; its linear programs take about a second.
        logs: of a batch at most.
        together: samples at most that are processed together in the end.
        knots: weights of a batch; ten times as many gain nothing of the motor's intervals.
        knots_together: weights in the end.
        finer: times as many weights when δ is tested: with fewer a smaller δ seems large enough, by
            2 % for the motor.
    """

    samples: int = 8192
    logs: int = 100
    together: int = 50_000
    knots: int = 1000
    knots_together: int = 3000
    finer: int = 3


SIZES = BatchSizes()


def batches(logs: Sequence[Log], sizes: BatchSizes = SIZES) -> tuple[tuple[Log, ...], ...]:
    """Logs in order, as many to a batch as fit; longer ones cut into equal parts.

    Args:
        logs: of one axis.
        sizes: of a batch.
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
    """A number of weights shared among logs by their lengths; two for each at least."""
    lengths = [_samples(log) for log in logs]
    return tuple(max(knots * own // sum(lengths), 2) for own in lengths)


def samples_per_weight(knots: int, logs: Sequence[Log]) -> float:
    """How many samples share a weight where logs share this number of weights."""
    return sum(map(_samples, logs)) / sum(knots_by_length(knots, logs))


def most_informative(
    system: System,
    parts: Sequence[Sequence[Log]],
    sizes: BatchSizes = SIZES,
    first: Sequence[Log] | None = None,
) -> tuple[Log, ...]:
    """The logs of as many batches as are processed together, most informative of all parameters.

    One by one the batch is added that increases the determinant of the information matrix most
    (D-optimality). No interval depends on this choice being a good one.

    Args:
        system: its box and δ, with which each batch is consistent.
        parts: the batches.
        sizes: how many samples are processed together.
        first: a batch that must be among them.
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
    """Σ φφᵀ/δ², its parameters in half-widths of the prior box."""
    rows = rows_of_logs(system, logs).record.rows
    count = np.asarray(rows.measure) > 0
    phi = np.asarray(rows.regressors) * np.asarray(system.half_widths)
    phi = phi[count] / np.asarray(rows.delta)[count, None]
    return phi.T @ phi


def _parts(log: Log, most: int) -> Iterator[Log]:
    length = log.input.size
    if length <= most:
        yield log
        return
    edges = np.linspace(0, length, -(-length // most) + 1).round().astype(int).tolist()
    for first, stop in pairwise(edges):
        yield log.part(first, stop)


def _samples(log: Log) -> int:
    """Without padding."""
    return int(log.took_place().sum())


def _length(logs: Sequence[Log]) -> int:
    return sum(log.input.size for log in logs)
