"""An interior-point method for the linear programs of modulating functions.

They are programs of least absolute deviations: minimise

    Σ|x| + tiltᵀx + Σ|spread·x| + Σ|target − moments·x|

over x, one weight per knot. Each row of `spread` has up to three neighbouring entries, and there
are few moments, so that an iteration takes the Cholesky factor of a matrix with two
off-diagonals and a small dense system: 0.05 s for 6,000 knots, where the simplex method takes ten.

The iteration is the predictor-corrector method of S. Mehrotra, "On the Implementation of a
Primal-Dual Interior Point Method" (1992), for A x − b = above − below with above, below ≥ 0 and the
multipliers −cost ≤ λ ≤ cost, where A and b stack the three sums and `cost` is 1 for each term.
"""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

_OFF_DIAGONALS = 2
_ITERATIONS = 50  # usually 13 suffice
_GAP = 1e-9  # distance to the minimum, relative to it, where iterations end
_SMALLEST_GAP = 1e-14
_TO_BOUNDARY = 0.999  # share of the way to the boundary
_REFINEMENTS = 1  # of a linear system
_MARGIN = 1e-14  # of a diagonal; with 1e-12 the values are off by 3e-7
_AWAY = 1e-12  # of the first iterate from zero, at least
_SHORTEST = 1e-7  # step below which rounding prevents further progress

# `no_type_check`: checks of the types of arguments, in tests, would take ten times as long as the
# arithmetic of these functions, which are called thousands of times for one log
Vector = Float[np.ndarray, " rows"]


class Minimum(NamedTuple):
    """The solution of a program.

    Attributes:
        x: best x that was met, shape (knots,).
        multipliers: derivatives of the minimum by `target`, shape (m,).
    """

    x: Float[np.ndarray, " knots"]
    multipliers: Float[np.ndarray, " m"]


class _Point(NamedTuple):
    """An iterate, or a change of one.

    Attributes:
        x: x, shape (knots,).
        above: upper parts of A x − b, above zero.
        below: lower parts of A x − b, above zero.
        room: 1 − Σ(above + below) over the rows of Σ|x| where it is limited; else zero.
        over: cost + λ, above zero; it has its own entry, since near zero a sum is inaccurate.
        under: cost − λ, above zero.
        multipliers: λ.
        price: cost of Σ|x|: 1, or the multiplier of its limit.
    """

    x: Float[np.ndarray, " knots"]
    above: Vector
    below: Vector
    room: float
    over: Vector
    under: Vector
    multipliers: Vector
    price: float


class LeastDeviations:
    """Programs of least absolute deviations that differ in tilt and target only."""

    def __init__(self, spread: sparse.csr_array, moments: Float[np.ndarray, "m knots"]) -> None:
        """Prepare the programs.

        Args:
            spread: matrix whose rows have up to three neighbouring entries, shape (kinks, knots).
            moments: dense matrix of a few rows, shape (m, knots).
        """
        self.spread, self.moments = spread, moments
        self._transposed = sparse.csr_array(spread.T)
        self._columns = np.ascontiguousarray(moments.T)
        columns, count = sparse.csc_array(spread), spread.shape[1]
        # spreadᵀ·diag(d)·spread has the entries maps[o] @ d on its o-th off-diagonal
        self._maps = [
            sparse.csr_array(columns[:, : count - o].multiply(columns[:, o:]).T)
            for o in range(min(_OFF_DIAGONALS + 1, count))
        ]

    def minimum(
        self,
        tilt: Float[np.ndarray, " knots"],
        target: Float[np.ndarray, " m"],
        *,
        limited: bool = False,
    ) -> Minimum | None:
        """Return the solution of a program; None if it has no minimum.

        Args:
            tilt: cost of x, shape (knots,).
            target: values of the moments at no cost, shape (m,).
            limited: if true, Σ|x| ≤ 1 is required instead of having a cost; `target` must be zero.
        """
        if tilt.size == 0:
            return None
        iteration = _Iteration(self, tilt, target, limited)
        point, best, least = iteration.start(), None, np.inf
        for _ in range(_ITERATIONS):
            value = iteration.value(point.x)
            if value < least:
                best, least = point, value
            if iteration.unbounded(point.x):
                return None
            if iteration.converged(point, value):
                break
            following = iteration.next(point)
            if following is None:
                break
            point = following
        if best is None:
            return None
        return Minimum(iteration.admissible(best.x), best.multipliers[-target.size :])

    @no_type_check
    def rows(self, x: Float[np.ndarray, " knots"]) -> Vector:
        """Return A x: x itself, spread·x and moments·x."""
        return np.concatenate([x, self.spread @ x, _product(self.moments, x)])

    @no_type_check
    def columns(self, y: Vector) -> Float[np.ndarray, " knots"]:
        """Return Aᵀy, the sum of the rows of A times the entries of y."""
        count, kinks = self.moments.shape[1], self.spread.shape[0]
        own, spread, moments = np.split(y, [count, count + kinks])
        return own + self._transposed @ spread + _product(self._columns, moments)

    @no_type_check
    def factor(self, d: Vector) -> Float[np.ndarray, "bands knots"]:
        """Return the banded Cholesky factor of AᵀDA without the moments."""
        m, count = self.moments.shape
        bands = np.zeros((_OFF_DIAGONALS + 1, count))
        for o, into in enumerate(self._maps):
            bands[o, : count - o] = into @ d[count : d.size - m]
        # without the margin, rounding makes it indefinite near the solution
        bands[0] = (bands[0] + d[:count]) * (1 + _MARGIN)
        return cholesky_banded(bands, lower=True, check_finite=False)


@no_type_check
class _Iteration:
    """The iteration for one program."""

    def __init__(
        self,
        program: LeastDeviations,
        tilt: Float[np.ndarray, " knots"],
        target: Float[np.ndarray, " m"],
        limited: bool,
    ) -> None:
        count = program.moments.shape[1]
        self.program, self.tilt, self.limited = program, tilt, limited
        self.target = np.concatenate([np.zeros(count + program.spread.shape[0]), target])
        self.own = (np.arange(self.target.size) < count) * 1.0  # rows of Σ|x|

    def start(self) -> _Point:
        """Return the least-squares solution, with parts well above zero."""
        newton = _Newton(self.program, np.ones_like(self.target))
        x, _ = newton.solve(self.target, np.zeros_like(self.tilt))
        deviation = self.program.rows(x) - self.target
        away = max(float(np.mean(np.abs(deviation))), _AWAY)
        above, below = np.maximum(deviation, 0) + away, np.maximum(-deviation, 0) + away
        price, room = 1.0, 0.0
        if self.limited:
            price = 1.0 + float(np.max(np.abs(self.tilt)))
            room = max(1 - _inner(self.own, above + below), away)
        cost = self.costs(price)
        return _Point(x, above, below, room, cost, cost, np.zeros_like(cost), price)

    def admissible(self, x: Float[np.ndarray, " knots"]) -> Float[np.ndarray, " knots"]:
        """Return x, scaled down to Σ|x| ≤ 1 where this is required."""
        return x / max(1.0, float(np.sum(np.abs(x)))) if self.limited else x

    def value(self, x: Float[np.ndarray, " knots"]) -> float:
        """Return the value of the program at x, scaled down where required."""
        x = self.admissible(x)
        deviation = np.abs(self.program.rows(x) - self.target)
        costs = self.costs(0.0 if self.limited else 1.0)
        return _inner(self.tilt, x) + _inner(costs, deviation)

    def costs(self, price: float) -> Vector:
        """Return the cost of each deviation."""
        return np.where(self.own > 0, price, 1.0)

    def unbounded(self, x: Float[np.ndarray, " knots"]) -> bool:
        """Return whether the value falls without end along x."""
        falling = _inner(self.tilt, x) + np.sum(np.abs(self.program.rows(x))) < 0
        return bool(falling) and not self.limited

    def converged(self, point: _Point, value: float) -> bool:
        """Return whether the products, whose sum is the distance to the minimum, are small."""
        return _products(point) <= _GAP * abs(value) + _SMALLEST_GAP

    def next(self, point: _Point) -> _Point | None:
        """Return the next iterate; None if rounding prevents progress."""
        try:
            step = _Step(self, point)
            predicted = step.direction(0.0, None)
            centred = step.mean_after(predicted) ** 3 / step.mean**2
            following, length = step.moved(step.direction(centred, predicted), _TO_BOUNDARY)
        except LinAlgError:
            return None
        return following if length > _SHORTEST else None


@no_type_check
class _Newton:
    """The equations A dx + H dλ = R and Aᵀdλ = r, with H a diagonal matrix above zero.

    The moments are eliminated last: their entries of H may be as small as rounding.
    """

    def __init__(self, program: LeastDeviations, h: Vector) -> None:
        m, self.program, self.h = len(program.moments), program, h
        self.inverse = 1 / h
        self.inverse[h.size - m :] = 0.0
        self.factor = program.factor(self.inverse), True
        self.dense = cho_solve_banded(self.factor, program.moments.T, check_finite=False)
        self.small = np.diag(h[h.size - m :]) + _product(program.moments, self.dense)

    def solve(
        self, deviation: Vector, balance: Float[np.ndarray, " knots"]
    ) -> tuple[Float[np.ndarray, " knots"], Vector]:
        """Return dx and dλ for the right-hand sides R and r, refined against rounding."""
        x, multipliers = self._solved(deviation, balance)
        for _ in range(_REFINEMENTS):
            missing = deviation - self.program.rows(x) - self.h * multipliers
            dx, more = self._solved(missing, balance - self.program.columns(multipliers))
            x, multipliers = x + dx, multipliers + more
        return x, multipliers

    def _solved(
        self, deviation: Vector, balance: Float[np.ndarray, " knots"]
    ) -> tuple[Float[np.ndarray, " knots"], Vector]:
        moments, m = self.program.moments, len(self.small)
        right = self.program.columns(self.inverse * deviation) - balance
        x = cho_solve_banded(self.factor, right, check_finite=False)
        last = np.linalg.solve(self.small, deviation[deviation.size - m :] - _product(moments, x))
        x = x + _product(self.dense, last)
        multipliers = self.inverse * (deviation - self.program.rows(x))
        multipliers[deviation.size - m :] = last
        return x, multipliers


@no_type_check
class _Step:
    """The Newton step of the optimality conditions at an iterate.

    They are A x − above + below = b, Aᵀλ = tilt, Σ(above + below) + room = 1 over the rows of Σ|x|
    where that is limited, and above·(cost + λ) = below·(cost − λ) = room·price = μ, with μ → 0.
    """

    def __init__(self, iteration: _Iteration, point: _Point) -> None:
        self.iteration, self.point, program = iteration, point, iteration.program
        above, below = point.above / point.over, point.below / point.under
        self.newton = _Newton(program, above + below)
        self.deviation = iteration.target - program.rows(point.x) + point.above - point.below
        self.balance = iteration.tilt - program.columns(point.multipliers)
        self.mean = self.mean_after(None)
        if iteration.limited:
            self.uneven = (above - below) * iteration.own
            # how x and λ change with the price
            self.priced = self.newton.solve(self.uneven, np.zeros_like(point.x))
            own = _inner(iteration.own, above + below)
            self.stiffness = own - _inner(self.uneven, self.priced[1]) + point.room / point.price

    def direction(self, mean: float, predicted: _Point | None) -> _Point:
        """Return the step to products of `mean`, corrected by the products of a predicted step."""
        at, own, second = self.point, self.iteration.own, (0.0, 0.0, 0.0)
        if predicted is not None:
            second = (
                predicted.above * predicted.over,
                predicted.below * predicted.under,
                predicted.room * predicted.price,
            )
        above = (mean - second[0]) / at.over - at.above
        below = (mean - second[1]) / at.under - at.below
        x, multipliers = self.newton.solve(self.deviation + above - below, self.balance)
        price = room = 0.0
        if self.iteration.limited:
            room = (mean - second[2]) / at.price - at.room
            excess = _inner(own, at.above + at.below + above + below) + at.room + room - 1.0
            price = (excess - _inner(self.uneven, multipliers)) / self.stiffness
            x, multipliers = x - self.priced[0] * price, multipliers - self.priced[1] * price
            room -= at.room / at.price * price
        over, under = own * price + multipliers, own * price - multipliers
        above -= at.above / at.over * over
        below -= at.below / at.under * under
        return _Point(x, above, below, room, over, under, multipliers, price)

    def mean_after(self, step: _Point | None) -> float:
        """Return the mean of all products after a step of full length, but within the bounds."""
        at = self.point if step is None else self.moved(step, 1.0)[0]
        return _products(at) / (2 * at.above.size + self.iteration.limited)

    def moved(self, step: _Point, share: float) -> tuple[_Point, float]:
        """Return the iterate after a step, and the larger length of x and λ.

        The lengths are at most the given share of the way to a bound.
        """
        at = self.point
        first = [(at.above, step.above), (at.below, step.below)]
        second = [(at.over, step.over), (at.under, step.under)]
        if self.iteration.limited:
            first.append((np.array([at.room]), np.array([step.room])))
            second.append((np.array([at.price]), np.array([step.price])))
        one, two = (min(1.0, share * _farthest(pairs)) for pairs in (first, second))
        return _Point(
            at.x + one * step.x,
            at.above + one * step.above,
            at.below + one * step.below,
            at.room + one * step.room,
            at.over + two * step.over,
            at.under + two * step.under,
            at.multipliers + two * step.multipliers,
            at.price + two * step.price,
        ), max(one, two)


@no_type_check
def _products(point: _Point) -> float:
    """Return the sum of all products of an iterate."""
    parts = _inner(point.above, point.over) + _inner(point.below, point.under)
    return parts + point.room * point.price


@no_type_check
def _inner(one: Vector, other: Vector) -> float:
    """Return an inner product.

    Like `_product` it does without BLAS, whose threads take three times as much processor time for
    vectors of this length.
    """
    return float(np.einsum("i,i", one, other))


@no_type_check
def _product(
    matrix: Float[np.ndarray, "a b"], other: Float[np.ndarray, "b *c"]
) -> Float[np.ndarray, "a *c"]:
    """Return the product of a matrix that is long in one direction."""
    return np.einsum("ij,j...->i...", matrix, other)


@no_type_check
def _farthest(pairs: list[tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_"]]]) -> float:
    """Return the largest multiple of changes that keeps positive numbers positive."""
    return min(float(np.min(-at[to < 0] / to[to < 0], initial=np.inf)) for at, to in pairs)
