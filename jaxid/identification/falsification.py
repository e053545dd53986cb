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
from jaxid.loop.log import InconsistentLogError, Log
from jaxid.model.system import System

LEAST, MOST = 1e-3, 1e3  # smallest and largest factor of δ in the search
_CLOSE = 1e-3  # relative accuracy of the factor
_COARSE = 1000  # number of weights in the first search
# step after the search with few weights; all weights prove 2 to 3 % more for the motor
_WIDER = 1.03
_TINY = 1e-6


def smallest_factor(
    rows: Callable[[Scalar], RegressionRows], knots: Knots = None, least: float = LEAST
) -> float:
    """Return a lower bound on the factor s with which s·δ can explain the data, to 0.1 %.

    Two results have a special meaning: `least`, if even least·δ may explain the data, so that
    nothing is proved; and `MOST` (1000), if not even 1000·δ explains them, so that an input, a unit
    or a sign is probably wrong.

    Args:
        rows: function that returns the data as regression rows, with δ multiplied by its argument;
            for a log, the bounds of its states depend on it.
        knots: largest number of weights; default one per row.
        least: first factor of the search.
    """

    def needed(factor: float, count: Knots) -> float:
        """Return the further factor of δ needed beyond `factor`; inf if state bounds are empty."""
        try:
            logged = rows(jnp.asarray(factor))
        except InconsistentLogError:
            return np.inf
        return needed_factor(logged, *program_of(logged, count))

    few = min(_COARSE, knots) if isinstance(knots, int) else knots or _COARSE
    low, high, n_low = least, least, np.inf
    for count in dict.fromkeys((few, knots)):  # a proof with few weights also holds with all
        while (n_high := needed(high, count)) > 1.0:
            if high == MOST:
                return MOST
            low, n_low = high, n_high
            high = min(high * max(n_high, _WIDER), MOST)
        low, high = _closed_in(partial(needed, count=count), (low, n_low), (high, n_high))
    return low


def smallest_disturbance_factor(
    system: System, logs: Sequence[Log], knots: Knots = None, least: float = LEAST
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
    """
    return smallest_factor(
        lambda s: rows_of_logs(system.with_scaled_disturbance(s), logs), knots, least
    )


def _closed_in(
    needed: Callable[[float], float], low: tuple[float, float], high: tuple[float, float]
) -> tuple[float, float]:
    """Return two factors of δ 0.1 % apart: the lower does not explain the data, the upper may.

    The search alternates between false position on logarithms, a step next to it, and bisection.

    Args:
        needed: function that returns the further factor of δ that is needed at a factor.
        low: factor that does not explain the data, and the further factor needed.
        high: factor that may explain the data, and the further factor needed.
    """
    step, moved = 0, high
    while high[0] > low[0] * (1 + _CLOSE):
        at = float(np.sqrt(low[0] * high[0]))
        if step % 3 == 0 and np.isfinite(low[1]):
            up, down = np.log(low[1]), -np.log(max(high[1], _TINY))
            at = low[0] * (high[0] / low[0]) ** float(np.clip(up / (up + down), 0.01, 0.99))
        elif step % 3 == 1:
            at = high[0] / (1 + _CLOSE) if moved is high else low[0] * (1 + _CLOSE)
        moved = at, needed(at)
        low, high = (low, moved) if moved[1] <= 1.0 else (moved, high)
        step += 1
    return low[0], high[0]


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
    weights = jnp.asarray(program.contradicting(misfit))[None]
    nothing = jnp.zeros((1, program.half_widths.size))
    end, disturbed = upper_ends(logged, weights, jnp.asarray(misfit), nothing)
    # 0 ≤ end + (s − 1)·disturbed for every s that explains the data
    return 1.0 - float(end[0] / disturbed[0]) if disturbed[0] > 0 else 0.0
