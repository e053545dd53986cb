"""A second-order system as data: regressor terms, parameter box Ω_θ, disturbance bound δ.

The sign convention of the whole package is the regression form of (1)-(2),

    u = φᵀ(y, ẏ, ÿ) θ + Δ,   φ = [ÿ, f₁(y, ẏ), f₂(y, ẏ), …],   |Δ| ≤ δ(y, ẏ),

so that the motor (31) reads term by term. The paper's φ of (1) is −[f₁, f₂, …], and its Δ of (2)
has the other sign; the bound is symmetric, so nothing depends on that.
"""

import abc
from collections.abc import Callable, Sequence
from typing import Literal, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid.checks import is_concrete, require, require_interval
from jaxid.ranges import Range, around, exactly, hull, plus, scaled, size

Scalar = Float[Array, ""]
Motion = Float[Array, "*shape"]
Interval = Float[Array, "2"]
Tree = TypeVar("Tree")
Ends = Sequence[float] | Float[Array, "2"]


_CELLS = 64  # per side, in which a user's own regressor is looked at for (18)
_TRIED = (0.0, 0.25, 0.5, 0.75, 1.0)  # of a range, if nothing is known of its slopes


def as_interval(ends: Sequence[float] | Array) -> Array:
    """A few numbers as one array in the default float type."""
    return jnp.asarray(ends, dtype=float)


class Kinked(eqx.Module):
    """Something that jumps with the speed and can be spread for a search by gradients."""

    @abc.abstractmethod
    def softened(self, speed: Motion) -> "Kinked":
        """The same thing with its jumps spread over about `speed` (m/s or rad/s).

        The speed may differ from sample to sample of the motion that it will be applied to.
        """


class Regressor(eqx.Module):
    """A known function f(y, ẏ) that multiplies one unknown parameter."""

    @abc.abstractmethod
    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        """F at each pair of position and velocity."""

    @abc.abstractmethod
    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        """An upper bound of |f| while position and velocity stay in their intervals, for (18)."""

    @abc.abstractmethod
    def range(self, position: Range, velocity: Range) -> Range:
        """All values of f while position and velocity stay in their ranges; wider is allowed."""

    @property
    def proved(self) -> bool:
        """Whether `range` really holds all values, or only those that were tried."""
        return True


class Custom(Regressor):
    """A user's own f(y, ẏ), with bounds of its slopes or without.

    Without them its values between any points are only estimated, by some that are tried, and what
    rests on them is marked so.

    Attributes:
        function: of arrays of one shape.
        slopes: |∂f/∂y| and |∂f/∂ẏ| at most, where f is used.
    """

    function: Callable[[Motion, Motion], Motion] = eqx.field(static=True)
    slopes: Float[Array, "2"] | None = eqx.field(
        converter=lambda slopes: None if slopes is None else as_interval(slopes), default=None
    )

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.function(position, velocity)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        shares = jnp.linspace(0.0, 1.0, _CELLS + 1)
        (y0, y1), (v0, v1) = (
            (low + shares[:-1] * (high - low), low + shares[1:] * (high - low))
            for low, high in (position, velocity)
        )
        cells = [
            jnp.stack([x.ravel() for x in jnp.meshgrid(*pair)]) for pair in ((y0, v0), (y1, v1))
        ]
        values = self.range(*(Range(low, high) for low, high in zip(*cells, strict=True)))
        return jnp.max(size(values).upper)

    def range(self, position: Range, velocity: Range) -> Range:
        if self.slopes is not None:
            (y, dy), (v, dv) = (
                ((x.lower + x.upper) / 2, (x.upper - x.lower) / 2) for x in (position, velocity)
            )
            return plus(exactly(self(y, v)), around(self.slopes[0] * dy + self.slopes[1] * dv))
        tried = [
            exactly(
                self(
                    position.lower + s * (position.upper - position.lower),
                    velocity.lower + t * (velocity.upper - velocity.lower),
                )
            )
            for s in _TRIED
            for t in _TRIED
        ]
        return hull(*tried)

    @property
    def proved(self) -> bool:
        return self.slopes is not None


class Viscous(Regressor):
    """f = ẏ."""

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return velocity

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        return jnp.max(jnp.abs(velocity))

    def range(self, position: Range, velocity: Range) -> Range:
        return velocity


class Coulomb(Regressor, Kinked):
    """f = S_f(ẏ) = (2/π)·arctan(β ẏ), a smooth sign of the velocity. β in s/m or s/rad.

    `blend` notches it around zero over about that speed; zero, the default, is the exact regressor.
    """

    beta: Scalar = eqx.field(converter=jnp.asarray)
    blend: Motion = eqx.field(converter=jnp.asarray, default=0.0)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        sign = (2 / jnp.pi) * jnp.arctan(self.beta * velocity)
        square, width = velocity**2, self.blend**2
        # a smaller β would spread the sign too, but its tails reach far beyond the speed asked for
        return sign * jnp.where(width > 0, square / jnp.where(width > 0, square + width, 1.0), 1.0)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        # "always between -1 and 1", as the paper puts it; the sign itself in the limit β → ∞
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        return Range(*(self(x, v) for x, v in zip(position, velocity, strict=True)))  # monotone

    def softened(self, speed: Motion) -> "Coulomb":
        return Coulomb(self.beta, self.blend + speed)


class Constant(Regressor):
    """f = 1: an offset."""

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return jnp.ones_like(velocity)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        return exactly(jnp.ones_like(velocity.lower))


class Sine(Regressor):
    """f = sin(y + phase): gravity on a joint (y in rad; phase = π/2 makes it a cosine)."""

    phase: Scalar = eqx.field(converter=jnp.asarray, default=0.0)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return jnp.sin(position + self.phase)

    def magnitude(self, position: Interval, velocity: Interval) -> Scalar:
        return jnp.ones(())

    def range(self, position: Range, velocity: Range) -> Range:
        low, high = (x + self.phase for x in position)
        ends = hull(exactly(jnp.sin(low)), exactly(jnp.sin(high)))
        crest, trough = (_holds_multiple(low - x, high - x) for x in (jnp.pi / 2, -jnp.pi / 2))
        return Range(jnp.where(trough, -1.0, ends.lower), jnp.where(crest, 1.0, ends.upper))


class DisturbanceBound(eqx.Module):
    """δ(y, ẏ) > 0 with |Δ| ≤ δ, in the unit of the input (3)."""

    @abc.abstractmethod
    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        """δ at each pair of position and velocity."""

    @abc.abstractmethod
    def range(self, position: Range, velocity: Range) -> Range:
        """All values of δ while position and velocity stay in their ranges; wider is allowed."""

    def describe(self, unit: str, speed: str) -> str:
        """What |Δ| is at most, in words.

        Args:
            unit: of the input.
            speed: unit of ẏ.
        """
        return f"δ of {type(self).__name__}, in {unit}"


class ConstantBound(DisturbanceBound):
    """One level at all positions and speeds."""

    level: Scalar = eqx.field(converter=jnp.asarray)

    def __check_init__(self) -> None:
        _require_positive("level", self.level)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.level * jnp.ones_like(velocity)

    def range(self, position: Range, velocity: Range) -> Range:
        return exactly(self(position.lower, velocity.lower))

    def describe(self, unit: str, speed: str) -> str:
        return f"{float(self.level):g} {unit}"


class SpeedBand(DisturbanceBound, Kinked):
    """One level up to a threshold of |ẏ| and another above it (33).

    `blend` spreads the jump over about that speed; zero, the default, is the exact bound, in which
    the threshold itself belongs to the slow side.
    """

    slow: Scalar = eqx.field(converter=jnp.asarray)
    fast: Scalar = eqx.field(converter=jnp.asarray)
    threshold: Scalar = eqx.field(converter=jnp.asarray)
    blend: Motion = eqx.field(converter=jnp.asarray, default=0.0)

    def __check_init__(self) -> None:
        _require_positive("slow", self.slow)
        _require_positive("fast", self.fast)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        below = self.threshold - jnp.abs(velocity)
        width = jnp.where(self.blend > 0, self.blend, 1.0)  # keeps the unused branch finite
        share = jnp.where(self.blend > 0, jax.nn.sigmoid(below / width), below >= 0)
        return self.fast + (self.slow - self.fast) * share

    def range(self, position: Range, velocity: Range) -> Range:
        # monotone in |ẏ|
        return hull(*(exactly(self(position.lower, speed)) for speed in size(velocity)))

    def describe(self, unit: str, speed: str) -> str:
        return (
            f"{float(self.slow):g} {unit} up to {float(self.threshold):g} {speed} and "
            f"{float(self.fast):g} {unit} above"
        )

    def softened(self, speed: Motion) -> "SpeedBand":
        return SpeedBand(self.slow, self.fast, self.threshold, self.blend + speed)


class Scaled(DisturbanceBound):
    """s·δ, for another δ and s > 0."""

    bound: DisturbanceBound
    factor: Scalar = eqx.field(converter=jnp.asarray)

    def __call__(self, position: Motion, velocity: Motion) -> Motion:
        return self.factor * self.bound(position, velocity)

    def range(self, position: Range, velocity: Range) -> Range:
        return scaled(self.factor, self.bound.range(position, velocity))

    def describe(self, unit: str, speed: str) -> str:
        return f"{float(self.factor):g} times {self.bound.describe(unit, speed)}"


class Term(eqx.Module):
    """One unknown parameter: its name, unit and prior interval, and the regressor it multiplies.

    `regressor = None` stands for the acceleration itself: the inertia θ_x2 of (1).
    """

    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    interval: Interval = eqx.field(converter=as_interval)
    regressor: Regressor | None = None

    def __check_init__(self) -> None:
        require_interval(f"interval of {self.name}", self.interval)


class System(eqx.Module):
    """A second-order axis: `terms[0]` is its inertia, the others are functions of (y, ẏ).

    Attributes:
        terms: one per unknown parameter, m in all.
        disturbance_bound: δ(y, ẏ), in the unit of the input.
        input_unit: what u is measured in, for tables and axes.
        coordinate: "linear" (m) or "rotary" (rad).
    """

    terms: tuple[Term, ...]
    disturbance_bound: DisturbanceBound
    input_unit: str = eqx.field(static=True, default="V")
    coordinate: Literal["linear", "rotary"] = eqx.field(static=True, default="linear")

    def __check_init__(self) -> None:
        inertias = [term.name for term in self.terms if term.regressor is None]
        require(
            inertias == [self.terms[0].name] if self.terms else False,
            "Argument `terms` must begin with the inertia, the only term whose regressor is "
            f"None, but the terms without a regressor are {inertias}.",
        )
        require(
            len(set(self.names)) == len(self.names),
            f"Argument `terms` must have distinct names, but has {list(self.names)}.",
        )
        if is_concrete(self.terms[0].interval):
            least = float(self.terms[0].interval[0])
            require(
                least > 0,
                f"Argument `terms`: the inertia {self.terms[0].name} must be above zero all over "
                f"its interval, but its lower end is {least:g}.",
            )

    @property
    def names(self) -> tuple[str, ...]:
        """The m parameter names."""
        return tuple(term.name for term in self.terms)

    @property
    def units(self) -> tuple[str, ...]:
        """The m parameter units."""
        return tuple(term.unit for term in self.terms)

    @property
    def lower(self) -> Float[Array, " m"]:
        """θ_min."""
        return jnp.stack([term.interval[0] for term in self.terms])

    @property
    def upper(self) -> Float[Array, " m"]:
        """θ_max."""
        return jnp.stack([term.interval[1] for term in self.terms])

    @property
    def half_widths(self) -> Float[Array, " m"]:
        """Half the width of Ω_θ, parameter by parameter."""
        return (self.upper - self.lower) / 2

    @property
    def centre(self) -> Float[Array, " m"]:
        """The centre of Ω_θ."""
        return (self.upper + self.lower) / 2

    @property
    def estimated(self) -> tuple[str, ...]:
        """The parameters whose regressors are bounded by samples only."""
        return tuple(t.name for t in self.terms if t.regressor and not t.regressor.proved)

    def index(self, name: str) -> int:
        """The place of a parameter in θ."""
        require(
            name in self.names,
            f"Argument `name` must be one of {list(self.names)}, but is {name!r}.",
        )
        return self.names.index(name)

    def forces(self, position: Motion, velocity: Motion) -> tuple[Motion, ...]:
        """f₁ … f_{m−1}: all regressors but the acceleration."""
        return tuple(
            term.regressor(position, velocity) for term in self.terms if term.regressor is not None
        )

    def force_ranges(self, position: Range, velocity: Range) -> tuple[Range, ...]:
        """What f₁ … f_{m−1} can be while position and velocity stay in their ranges."""
        return tuple(
            term.regressor.range(position, velocity)
            for term in self.terms
            if term.regressor is not None
        )

    def regressors(
        self, position: Motion, velocity: Motion, acceleration: Motion
    ) -> tuple[Motion, ...]:
        """φ(y, ẏ, ÿ) of (2), as m arrays of the motion's shape."""
        return (acceleration, *self.forces(position, velocity))

    def acceleration(
        self, position: Motion, velocity: Motion, load: Motion, theta: Float[Array, " m"]
    ) -> Motion:
        """ÿ from (1) under `load` = u − Δ."""
        return (load - dot(self.forces(position, velocity), theta[1:])) / theta[0]


def softened(tree: Tree, speed: Motion) -> Tree:
    """A system, or what holds one, with every jump spread over about `speed`: not for bounds."""
    return jax.tree.map(
        lambda node: node.softened(speed) if isinstance(node, Kinked) else node,
        tree,
        is_leaf=lambda node: isinstance(node, Kinked),
    )


def dot(columns: Sequence[Motion], theta: Float[Array, " m"]) -> Motion:
    """Σ_j columns[j]·θ_j, column by column: scalars stay scalars, so that a scan is one kernel."""
    total = columns[0] * theta[0]
    for j, column in enumerate(columns[1:], start=1):
        total = total + column * theta[j]
    return total


def _holds_multiple(low: Motion, high: Motion) -> Array:
    """Whether a multiple of 2π lies between."""
    return jnp.ceil(low / (2 * jnp.pi)) <= jnp.floor(high / (2 * jnp.pi))


def _require_positive(name: str, value: Scalar) -> None:
    if is_concrete(value):
        require(
            0 < float(value) < float("inf"),
            f"Argument `{name}` of a disturbance bound δ must be positive and finite, "
            f"but is {float(value):g}.",
        )
