"""From recorded logs to guaranteed parameter intervals, or to a proof that the logs do not fit.

This is the one way from data to intervals. The disturbance bound is tested first: if no parameter
vector of the prior box explains the logs with |Δ| ≤ δ, no interval is returned.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require, require_concrete, require_float64
from jaxid._progress import Report, silent, within
from jaxid._text import above_one
from jaxid.identification.batches import (
    SIZES,
    BatchSizes,
    batches,
    knots_by_length,
    most_informative,
    samples_per_weight,
)
from jaxid.identification.falsification import CLOSE, LEAST, MOST, smallest_disturbance_factor
from jaxid.identification.feasible_parameter_set import feasible_set
from jaxid.identification.intervals import guaranteed_intervals, narrowed_to, tightest
from jaxid.identification.joined_rows import rows_of_logs
from jaxid.identification.unidentifiable import unidentifiable_directions
from jaxid.loop.log import InconsistentLogError, Log, padded
from jaxid.model.system import System
from jaxid.regression.estimate import Estimate

Directions = dict[str, Float[np.ndarray, " m"]]
_UNCHANGED = 1e-6  # relative: an interval that shrinks by less counts as unchanged
_ROUGH = 0.03  # relative accuracy of a factor that is far from 1
_FAR_FROM_ONE = 0.5  # more weights do not raise a factor below this above 1
_STEP = 1.1  # first factor in the search for a δ that is consistent with the data
_HALVINGS = 3  # of the interval between two steps


class Identification(NamedTuple):
    """Guaranteed parameter intervals from logs that are consistent with a system.

    Attributes:
        system: axis with the prior box and δ that the intervals assume.
        lower: lower ends of the guaranteed intervals, shape (m,), in the units of the parameters;
            the intervals contain all θ in the prior box that are consistent with the logs.
        upper: upper ends of the guaranteed intervals, shape (m,), in the units of the parameters.
        estimate: estimate θ̂ ± bound of a fixed linear estimator; its intervals contain the
            guaranteed ones.
        disturbance_factor: proved lower bound, at most 1, on the factor of δ that the logs need;
            0.001 if there is no such proof.
        unidentifiable: for each parameter whose prior interval the logs cannot narrow, a direction
            ν, shape (m,): centre ± ν explain the same logs and span this interval.
        batches: number of batches in which the logs were processed.
        samples_per_weight: largest mean number of samples per estimator weight of any batch.
    """

    system: System
    lower: Float[Array, " m"]
    upper: Float[Array, " m"]
    estimate: Estimate
    disturbance_factor: float
    unidentifiable: Directions
    batches: int
    samples_per_weight: float


def identify(
    system: System,
    logs: Log | Sequence[Log],
    *,
    sizes: BatchSizes = SIZES,
    report: Report = silent,
) -> Identification:
    """Return guaranteed intervals of every parameter, from one or several logs of one axis.

    The intervals contain the true parameters if the assumptions hold that
    `jaxid.assumptions(system, *logs)` lists: θ in the prior box, |Δ| ≤ δ at all times, an input
    that is held as logged (zero-order hold), and positions read to half the encoder resolution. The
    disturbance bound is tested first: logs that are proved to need a larger δ raise an error.

    Args:
        system: axis with its prior box and disturbance bound δ.
        logs: one log or several logs of any length; sample periods and encoders may differ. Long
            logs are processed in batches.
        sizes: sizes of the batches.
        report: function that is called as each step begins, with its name and the share of the
            work that is done.

    Raises:
        InterruptedIdentification: if the user interrupts (Ctrl-C) after the first of several
            batches. Its `found` holds the guaranteed intervals from the batches that are done.
        InconsistentLogError: if no θ of the prior box explains the logs with |Δ| ≤ δ. Its
            `factor` is a lower bound on the multiple of δ that would be needed.
        ValueError: if there is no log, if the system or a log is not float64, or if the logs are
            too short.

    Example:
        >>> found = jd.identify(slide, log)
        >>> found.lower.round(2).tolist(), found.upper.round(2).tolist()
        ([6.12, 0.0, 7.82], [7.87, 40.0, 22.21])
        >>> list(found.unidentifiable)  # this motion says nothing of b
        ['b']
        >>> wrong = jd.Log(-log.input, log.position, log.period, log.resolution)
        >>> jd.identify(slide, wrong)  # an input of the wrong sign
        Traceback (most recent call last):
        jaxid.loop.log.InconsistentLogError: ...
    """
    require(
        isinstance(logs, Log | list | tuple),
        f"Argument `logs` must be a jaxid.Log, or a list of them, but is a {type(logs).__name__}. "
        "`jaxid.io.segments.steady_segments` makes logs of the rows that `jaxid.read_log` returns.",
    )
    given = (logs,) if isinstance(logs, Log) else tuple(logs)
    _require_logs(given)
    require_float64(system=system, logs=given)
    require_concrete(
        "`identify`, which solves linear programs,",
        "Trace `jaxid.filtered_least_squares`, the paper's identification.",
        system=system,
        logs=given,
    )
    parts = [tuple(map(padded, part)) for part in batches(given, sizes)]
    progress = _Progress(system, sizes)
    try:
        _process(progress, parts, report)
    except KeyboardInterrupt:
        if progress.done == 0:
            raise
        raise InterruptedIdentification(progress.result(), len(parts)) from None
    return progress.result()


class InterruptedIdentification(KeyboardInterrupt):
    """The interruption of `identify` by the user after some of several batches.

    Attributes:
        found: guaranteed intervals from the batches that are done; the others were not tested.
        batches: number of all batches.
    """

    def __init__(self, found: Identification, batches: int) -> None:
        """Keep the result of the batches that are done."""
        super().__init__(f"Interrupted after {found.batches} of {batches} batches.")
        self.found, self.batches = found, batches


def _process(progress: "_Progress", parts: Sequence[tuple[Log, ...]], report: Report) -> None:
    """Process batches one by one, then together."""
    count = len(parts)
    # the last step takes about as long as half of the batches, or all of them again
    alone = 1.0 if count == 1 else 0.6
    for number, part in enumerate(parts, 1):
        label = f"batch {number} of {count}: " if count > 1 else ""
        first, last = alone * (number - 1) / count, alone * number / count
        progress.add(part, within(report, first, last, label))
    if count > 1:
        progress.process_together(within(report, alone, 1.0, "all batches together: "))


def _require_logs(logs: Sequence[Log]) -> None:
    require(len(logs) > 0, "Argument `logs` must hold one log at least, but is empty.")
    for k, log in enumerate(logs):
        require(
            isinstance(log, Log),
            f"Argument `logs` must hold objects of `jaxid.Log`, but entry {k} is a "
            f"{type(log).__name__}.",
        )
        if is_concrete(log):
            require(
                log.samples >= 2,
                f"Argument `logs` must hold logs of two samples or more, but log {k} has "
                f"{log.samples}.",
            )


class _Progress:
    """The state of an identification after some batches."""

    def __init__(self, system: System, sizes: BatchSizes) -> None:
        self.system = system
        self.known = system
        self.sizes = sizes
        self.done = 0
        self.factor = LEAST
        self.refusal: str | None = None
        self.estimates: list[Estimate] = []
        self.unidentifiable: Directions | None = None
        self.parts: list[tuple[Log, ...]] = []
        self.samples_per_weight = 1.0

    @property
    def consistent(self) -> bool:
        """Whether no inconsistency has been proved so far."""
        return self.factor <= 1 and self.refusal is None

    def add(self, logs: tuple[Log, ...], report: Report) -> None:
        """Test one more batch, and narrow the box by it."""
        self.parts.append(logs)
        sizes = self.sizes
        self.samples_per_weight = max(
            self.samples_per_weight, samples_per_weight(sizes.knots, logs)
        )
        report("smallest consistent disturbance bound", 0.0)
        for finer, close in ((1, _ROUGH), (sizes.finer, CLOSE)):
            weights = knots_by_length(finer * sizes.knots, logs)
            self.factor = smallest_disturbance_factor(
                self.system, logs, weights, self.factor, close
            )
            if self.factor < _FAR_FROM_ONE or self.factor == MOST:
                break
        if self.consistent and (self.unidentifiable is None or self.unidentifiable):
            report("unidentifiable directions", 0.4)
            self._look(logs, sizes.knots)
        self._narrow(logs, sizes.knots, within(report, 0.5, 1.0))
        self.done += 1

    def process_together(self, report: Report) -> None:
        """Process all batches at once, or the most informative ones, if they are consistent.

        If all batches are too long for that, each is processed once more with the box narrowed by
        all of them: the first ones have not been compared with the later ones.
        """
        if not self.consistent:
            return
        logs = most_informative(self._with_room, self.parts, self.sizes)
        samples = [sum(log.samples for log in part) for part in (logs, *self.parts)]
        again = self.parts if samples[0] < sum(samples[1:]) else []
        ends = np.cumsum([0, samples[0], *samples[1:]]) / sum(samples[: 1 + len(again)])
        self._narrow(logs, self.sizes.knots_together, within(report, 0.0, float(ends[1])))
        for number, part in enumerate(again, 1):
            first, last = ends[number : number + 2].tolist()
            label = f"batch {number} of {len(again)} again: "
            self._narrow(part, self.sizes.knots, within(report, first, last, label))
        if self.unidentifiable:
            self._look(logs, self.sizes.knots_together)

    def result(self) -> Identification:
        """Return the result of all batches.

        Raises:
            InconsistentLogError: if the logs are inconsistent with the system.
        """
        if self.factor > 1:
            raise InconsistentLogError(
                "No parameter vector of the prior box explains the data unless the disturbance "
                f"bound is at least {above_one(self.factor)}·δ.",
                self.factor,
            )
        if self.refusal is not None:
            raise InconsistentLogError(self.refusal, 1.0)
        half_widths = self.system.half_widths
        narrower = self.known.upper - self.known.lower < (1 - _UNCHANGED) * 2 * half_widths
        wide = [name for name, less in zip(self.system.names, narrower, strict=True) if not less]
        return Identification(
            self.system,
            self.known.lower,
            self.known.upper,
            tightest(self.estimates),
            self.factor,
            {k: v for k, v in (self.unidentifiable or {}).items() if k in wide},
            self.done,
            self.samples_per_weight,
        )

    def _narrow(self, logs: Sequence[Log], knots: int, report: Report) -> None:
        """Narrow the box by some logs, unless an inconsistency was proved before."""
        if not self.consistent:
            return
        weights = knots_by_length(knots, logs)
        try:
            report("guaranteed intervals", 0.0)
            found = guaranteed_intervals(self.known, logs, weights)
            report("feasible parameter set", 0.6)
            left = feasible_set(found.rows, [found.estimate], weights)
            self.estimates.append(found.estimate)
            self.known = narrowed_to(self.known, left.lower, left.upper)
            # every θ that explains the data with a smaller δ is also in this box
            self.factor = max(self.factor, left.disturbance_factor)
        except InconsistentLogError:  # not detected by the test of δ
            self._refuse(report)

    def _refuse(self, report: Report) -> None:
        """Note an inconsistency, and find the factor of δ that all batches together need."""
        report("smallest consistent disturbance bound", 1.0)
        self.refusal = (
            "No parameter vector of the prior box explains the data, unless the disturbance bound "
            "is larger than 1·δ."
        )
        logs, knots = self.parts[-1], self.sizes.knots
        if len(self.parts) > 1:
            self.refusal = (
                "No parameter vector of the prior box explains the first "
                f"{len(self.parts)} batches of the data together, unless the disturbance bound is "
                "larger than 1·δ, though one may explain each of them."
            )
            logs = most_informative(self._with_room, self.parts, self.sizes, first=self.parts[-1])
            knots = self.sizes.knots_together
            weights = knots_by_length(knots, logs)
            self.factor = smallest_disturbance_factor(self.system, logs, weights, self.factor)
        if self.factor <= 1:
            self.factor = self._refused_factor(logs, knots_by_length(knots, logs))

    def _refused_factor(self, logs: Sequence[Log], weights: tuple[int, ...]) -> float:
        """Return the largest of some multiples of δ, from 1 on, that have no feasible set."""

        def refused(factor: float) -> bool:
            try:
                found = guaranteed_intervals(
                    self.system.with_scaled_disturbance(factor), logs, weights
                )
                feasible_set(found.rows, [found.estimate], weights)
            except InconsistentLogError:
                return True
            return False

        low, high = 1.0, _STEP
        while high < MOST and refused(high):
            low, high = high, high**2
        for _ in range(_HALVINGS):
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if refused(middle) else (low, middle)
        return low

    @property
    def _with_room(self) -> System:
        """The system with a δ that is 1 % above the largest δ refuted so far, or δ itself."""
        return self.system.with_scaled_disturbance(max(1.0, 1.01 * self.factor))

    def _look(self, logs: Sequence[Log], knots: int) -> None:
        """Keep the directions that are unidentifiable from these logs and from those before."""
        rows = rows_of_logs(self._with_room, logs)
        now = unidentifiable_directions(rows, knots_by_length(knots, logs))
        before = now if self.unidentifiable is None else self.unidentifiable
        self.unidentifiable = {name: now[name] for name in now if name in before}
