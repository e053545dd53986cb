"""Many or long logs, stretch by stretch: each read with the box that those before it leave.

All of them together are one linear program, which takes minutes where its stretches take seconds.
It is solved in the end, with fewer weights to a tick; of longer logs for the stretches that tell
most together.
"""

from collections.abc import Callable, Iterator, Sequence
from math import floor, log10
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from jaxid.identification.falsification import LEAST, MOST, louder, smallest_disturbance_factor
from jaxid.identification.feasible_parameter_set import feasible_set
from jaxid.identification.intervals import best, identify_logs, within
from jaxid.identification.joined_rows import rows_of_logs
from jaxid.identification.modulating_functions import Knots
from jaxid.identification.unidentifiable import unidentifiable_directions
from jaxid.loop.log import InconsistentLogError, Log
from jaxid.model.system import System
from jaxid.regression.estimate import Estimate

STRETCH = 8192  # ticks at most: linear programs of a second
_MANY = 100  # logs to a stretch, at most
WHOLE = 50_000  # ticks at most that are read together as well
_KNOTS = 1000  # of a stretch: ten times as many gain nothing of the motor's intervals
_TOGETHER = 3000  # knots
_FINER = 3  # for δ alone: with fewer weights a smaller one seems enough, by 2 % for the motor
_NOT_ALL = "Nothing within the box and δ can have left all of the first {} stretches."
_ABSURD = ": an input, a unit or a sign must be wrong"
_SAME = 1e-6  # of a prior interval: what has shrunk by less is whole
_FAR = 0.5  # of δ: nothing that finer weights would see of it contradicts the axis


class Proved(NamedTuple):
    """What logs say of an axis.

    Attributes:
        factor: of δ, which some stretch takes at least; `LEAST` where none takes that much, `MOST`
            where not even that explains it.
        contradiction: in what way the logs contradict the axis, if they do.
        estimate: unless they do.
        lower: ends of all that they leave possible, unless they contradict the axis.
        upper: likewise.
        unseen: parameters whose interval may remain whole whatever the data, and with which
            combination of others each can be exchanged.
        stretches: how many.
        coarse: how many ticks share a weight.
    """

    factor: float
    contradiction: str | None
    estimate: Estimate | None
    lower: Float[Array, " m"]
    upper: Float[Array, " m"]
    unseen: dict[str, Float[np.ndarray, " m"]]
    stretches: int
    coarse: float


def prove(
    system: System, logs: Sequence[Log], tell: Callable[[str], None] = lambda message: None
) -> Proved:
    """Read logs of one axis, as many together as are a stretch.

    Args:
        system: its box and δ.
        logs: one at least; none longer than `STRETCH`.
        tell: told what goes on.
    """
    found, parts = _Reading(system), tuple(stretches(logs))
    for number, part in enumerate(parts, 1):
        label = f"stretch {number} of {len(parts)}: " if len(parts) > 1 else ""
        found.read(part, lambda said, label=label: tell(label + said))
    if len(parts) > 1 and found.factor < MOST:
        found.read_again(lambda said: tell(f"together: {said}"))
    return found.result(len(parts))


def stretches(logs: Sequence[Log]) -> Iterator[list[Log]]:
    """Logs one after the other, as many as are read together."""
    part: list[Log] = []
    for log in logs:
        if part and (_ticks([*part, log]) > STRETCH or len(part) == _MANY):
            yield part
            part = []
        part.append(log)
    yield part


def most_telling(
    system: System, parts: Sequence[list[Log]], first: list[Log] | None = None
) -> list[Log]:
    """Logs of as many stretches as are read together, which tell most of all parameters.

    One by one that which adds most to the determinant of their information (D-optimality): a choice
    that no interval rests on.

    Args:
        system: its box and δ, with which each stretch is possible.
        parts: the stretches.
        first: one of them that must not be missing.
    """
    if sum(map(_ticks, parts)) <= WHOLE:
        return [log for part in parts for log in part]
    told = [_information(system, part) for part in parts]
    chosen: list[int] = []
    total, left = np.eye(len(system.names)), WHOLE
    while fitting := [k for k, p in enumerate(parts) if k not in chosen and _ticks(p) <= left]:
        must = [k for k in fitting if parts[k] is first]
        best = max(must or fitting, key=lambda k: np.linalg.slogdet(total + told[k])[1])
        chosen.append(best)
        total, left = total + told[best], left - _ticks(parts[best])
    return [log for k in sorted(chosen) for log in parts[k]]


def _information(system: System, logs: Sequence[Log]) -> Float[np.ndarray, "m m"]:
    """In units of the box and δ."""
    rows = rows_of_logs(system, logs).record.rows
    count = np.asarray(rows.measure) > 0
    phi = np.asarray(rows.regressors) * np.asarray(system.half_widths)
    phi = phi[count] / np.asarray(rows.delta)[count, None]
    return phi.T @ phi


class _Reading:
    """What is known so far."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.known = system
        self.factor = LEAST
        self.contradiction: str | None = None
        self.estimates: list[Estimate] = []
        self.unseen: dict[str, Float[np.ndarray, " m"]] | None = None
        self.parts: list[list[Log]] = []
        self.coarse = 1.0

    def read(self, logs: list[Log], tell: Callable[[str], None]) -> None:
        """One more stretch."""
        self.parts.append(logs)
        knots = shared(_KNOTS, logs)
        ticks = sum(int(log.took_place().sum()) for log in logs)
        self.coarse = max(self.coarse, ticks / sum(knots))
        tell("smallest δ that explains it")
        for count in (knots, shared(_FINER * _KNOTS, logs)):
            self.factor = smallest_disturbance_factor(self.system, logs, count, self.factor)
            if self.factor < _FAR or self.factor == MOST:
                break
        if self.factor == MOST:
            return
        if self.unseen is None or self.unseen:
            tell("what the motion cannot tell apart")
            self._look(logs, knots)
        self.narrow(logs, knots, tell)

    def narrow(self, logs: Sequence[Log], knots: Knots, tell: Callable[[str], None]) -> None:
        """The box, unless something contradicts the axis."""
        if self.factor > 1 or self.contradiction:
            return
        try:
            tell("intervals")
            found = identify_logs(self.known, logs, knots)
            tell("all that is possible")
            left = feasible_set(found.logged, [found.estimate], knots)
        except InconsistentLogError as contradiction:  # this reading can see what the first did not
            self.contradiction = str(contradiction)
            if len(self.parts) > 1:  # they may contradict one another, none itself
                self.contradiction = _NOT_ALL.format(len(self.parts))
                together = most_telling(self._explained, self.parts, first=self.parts[-1])
                many = shared(_TOGETHER, together)
                self.factor = smallest_disturbance_factor(self.system, together, many, self.factor)
        else:
            self.estimates.append(found.estimate)
            self.known = within(self.known, left.lower, left.upper)

    def result(self, count: int) -> Proved:
        """Of all stretches."""
        if self.factor > 1:
            self.contradiction = (
                f"Within the box, disturbances of {rounded_down(self.factor):g} times δ or more "
                f"would be needed{_ABSURD if self.factor == MOST else ''}."
            )
        shrunk = (self.known.upper - self.known.lower) < (1 - _SAME) * 2 * self.system.half_widths
        told = {name for name, less in zip(self.system.names, shrunk, strict=True) if less}
        estimate = None if self.contradiction else best(self.estimates)
        return Proved(
            self.factor,
            self.contradiction,
            estimate,
            self.known.lower,
            self.known.upper,
            {k: v for k, v in (self.unseen or {}).items() if k not in told},
            count,
            self.coarse,
        )

    def read_again(self, tell: Callable[[str], None]) -> None:
        """Stretches together, if that can say more than each of them has said."""
        contradicted = self.factor > 1 or self.contradiction
        if contradicted and not self.unseen:
            return
        logs = most_telling(self._explained, self.parts)
        knots = shared(_TOGETHER, logs)
        self.narrow(logs, knots, tell)
        if self.unseen:
            self._look(logs, knots)

    @property
    def _explained(self) -> System:
        """With a δ for which each stretch is possible: a thousandth more than the factor may do."""
        return louder(self.system, max(1.0, 1.01 * self.factor))

    def _look(self, logs: Sequence[Log], knots: Knots) -> None:
        """What neither these logs nor those before tell apart."""
        now = unidentifiable_directions(rows_of_logs(self._explained, logs), knots)
        before = now if self.unseen is None else self.unseen
        self.unseen = {name: now[name] for name in now if name in before}


def rounded_down(factor: float) -> float:
    """To three digits: what is needed at least."""
    digits = 2 - floor(log10(factor))
    return floor(factor * 10**digits) / 10**digits


def shared(knots: int, logs: Sequence[Log]) -> tuple[int, ...]:
    """Among logs, by their ticks; two for each at least."""
    ticks = [int(log.took_place().sum()) for log in logs]
    return tuple(max(knots * own // sum(ticks), 2) for own in ticks)


def _ticks(logs: Sequence[Log]) -> int:
    return sum(log.input.size for log in logs)
