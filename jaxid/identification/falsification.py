"""Falsification of the disturbance bound: proved lower bounds on the δ that data need."""

from collections.abc import Callable, Sequence
from functools import partial

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxid._types import Scalar
from jaxid.identification.joined_rows import rows_of_logs
from jaxid.identification.modulating_functions import Knots, Program, program_of
from jaxid.identification.regression_rows import RegressionRows, upper_ends
from jaxid.loop.log import InconsistentLogError, Log, padded
from jaxid.model.system import System

LEAST, MOST = 1e-3, 1e3  # smallest and largest factor of δ in the search
CLOSE = 1e-3  # relative accuracy of the factor
_COARSE = 1000  # number of weights in the first search
_WIDER = 1.03  # step of the search; all weights prove 2 to 3 % more than few ones for the motor
_TINY = 1e-6


def smallest_factor(
    rows: Callable[[Scalar], RegressionRows],
    knots: Knots = None,
    least: float = LEAST,
    close: float = CLOSE,
) -> float:
    """Return a lower bound on the factor s with which s·δ can explain the data.

    Two results have a special meaning: `least`, if even least·δ may explain the data, so that
    nothing is proved; and `MOST` (1000), if not even 1000·δ explains them, so that an input, a unit
    or a sign is probably wrong.

    Args:
        rows: function that returns the data as regression rows, with δ multiplied by its argument;
            for a log, the bounds of its states depend on it.
        knots: largest number of weights; default one per row.
        least: first factor of the search.
        close: relative accuracy of the result.
    """

    def needed(factor: float, count: Knots) -> float:
        """Return the further factor of δ needed beyond `factor`; inf if state bounds are empty."""
        try:
            logged = rows(jnp.asarray(factor))
        except InconsistentLogError:
            return np.inf
        return needed_factor(logged, *program_of(logged, count))

    low, first = least, max(1.0, least)
    for count in dict.fromkeys((_few(knots), knots)):  # a proof with few weights holds with all
        low, first = _searched(partial(needed, count=count), low, first, close)
    return low


def _few(knots: Knots) -> Knots:
    """Return numbers of weights for the first search."""
    if isinstance(knots, tuple):
        share = min(_COARSE / max(sum(knots), 1), 1.0)
        return tuple(max(int(share * own), 2) for own in knots)
    return _COARSE if knots is None else min(_COARSE, knots)


def _searched(
    needed: Callable[[float], float], least: float, first: float, close: float
) -> tuple[float, float]:
    """Return two factors of δ close together: less than the lower is refuted, the upper is not.

    Both are `MOST` if everything is refuted, and `least` if nothing is.

    Args:
        needed: function that returns the further factor of δ that is needed at a factor; if it is
            above 1 the factor is refuted.
        least: factor below which everything is known to be refuted, or not of interest.
        first: factor to begin with.
        close: relative distance of the factors.
    """
    low, high = (least, np.nan), (np.inf, np.nan)
    at, step = first, 0
    while high[0] > low[0] * (1 + close):
        found = at, needed(at)
        if found[1] > 1.0:
            if at == MOST:
                return MOST, MOST
            low = found
        else:
            high = found
            # what explains the data is at least `needed` times as large, or larger than this one
            if at * found[1] > low[0]:
                low = min(at * found[1], at), np.nan
        at = _between(low, high, step, close)
        step += 1
    return low[0], high[0]


def _between(low: tuple[float, float], high: tuple[float, float], step: int, close: float) -> float:
    """Return the factor to try next.

    Between two factors, false position on logarithms, a step next to the lower one, and bisection
    take turns.

    Args:
        low: factor that is refuted, and the further factor needed there; nan if unknown.
        high: factor that is not refuted, and the further factor needed there; inf if unknown.
        step: number of the step, from 0.
        close: relative distance at which the search ends.
    """
    if np.isinf(high[0]):
        return min(low[0] * max(low[1], _WIDER), MOST)
    if np.isnan(low[1]):
        return low[0]
    if step % 3 == 2 or not np.isfinite(low[1]):
        return float(np.sqrt(low[0] * high[0]))
    if step % 3 == 1:
        return low[0] * (1 + close)
    up, down = np.log(low[1]), -np.log(max(high[1], _TINY))
    return low[0] * (high[0] / low[0]) ** float(np.clip(up / (up + down), 0.01, 0.99))


def smallest_disturbance_factor(
    system: System,
    logs: Sequence[Log],
    knots: Knots = None,
    least: float = LEAST,
    close: float = CLOSE,
) -> float:
    """Return a proved lower bound on the factor of δ that logs need; above 1 they are inconsistent.

    `jaxid.identify` may prove a larger one, its `disturbance_factor`, because it narrows the prior
    box by the same logs.

    The result is `least` if nothing is proved, and `MOST` (1000) if not even 1000·δ explains the
    logs.

    Args:
        system: axis with its prior box and disturbance bound δ.
        logs: logs of one axis.
        knots: largest number of weights per log; default one per row.
        least: first factor of the search.
        close: relative accuracy of the result.
    """
    logs = list(map(padded, logs))

    def rows(factor: Scalar) -> RegressionRows:
        return rows_of_logs(system.with_scaled_disturbance(factor), logs)

    return smallest_factor(rows, knots, least, close)


def needed_factor(
    logged: RegressionRows, program: Program, misfit: Float[np.ndarray, " n"]
) -> float:
    """Return a lower bound on the factor of δ that data need, proved by one vector of weights.

    It is 0 if the program has no solution.

    Args:
        logged: data as regression rows.
        program: linear program of the rows.
        misfit: u − Φ·centre of the rows, shape (n,), in the unit of the input.
    """
    weights = jnp.asarray(program.contradicting(misfit)[None])
    nothing = jnp.asarray(np.zeros((1, program.half_widths.size)))
    ends = upper_ends(logged, weights, jnp.asarray(misfit), nothing)
    end, disturbed = (float(x[0]) for x in ends)
    # 0 ≤ end + (s − 1)·disturbed for every s that explains the data
    return 1.0 - end / disturbed if disturbed > 0 else 0.0
