"""A second-order system as data: regressor terms, parameter box Ω_θ, disturbance bound δ.

The sign convention of the whole package is the regression form of (1)-(2),

    u = φᵀ(y, ẏ, ÿ) θ + Δ,   φ = [ÿ, f₁(y, ẏ), f₂(y, ẏ), …],   |Δ| ≤ δ(y, ẏ),

so that the motor (31) reads term by term. The paper's φ of (1) is −[f₁, f₂, …], and its Δ of (2)
has the other sign; the bound is symmetric, so nothing depends on that.
"""

from typing import Literal, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxid._checks import is_concrete, require, require_interval, require_positive, require_shape
from jaxid._types import Interval, Motion, Scalar, as_array, dot
from jaxid.model.disturbance_bound import DisturbanceBound
from jaxid.model.interval_arithmetic import Range
from jaxid.model.regressors import Regressor
from jaxid.model.smoothing import Nonsmooth

Tree = TypeVar("Tree")


class Term(eqx.Module):
    """One unknown parameter: its name, unit, prior interval, and the regressor that it multiplies.

    Attributes:
        name: name of the parameter.
        unit: unit of the parameter.
        interval: prior interval (lower, upper) of the parameter, in `unit`.
        regressor: regressor f(y, ẏ); None stands for ÿ, so that the parameter is the inertia
            θ_x2 of (1).

    Raises:
        ValueError: if the prior interval is not finite or its lower end is not below its upper end.
    """

    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    interval: Interval = eqx.field(converter=as_array("interval"))
    regressor: Regressor | None = None

    def __check_init__(self) -> None:
        require_interval("interval", self.interval, f"the term {self.name}")
        require(
            self.regressor is None or isinstance(self.regressor, Regressor),
            f"Argument `regressor` of the term {self.name} must be a regressor such as "
            f"jaxid.Viscous(), or jaxid.Custom(function), but is {self.regressor!r}.",
        )


class System(eqx.Module):
    """A second-order axis u = φᵀθ + Δ with prior box Ω_θ and disturbance bound δ.

    Attributes:
        terms: one per unknown parameter, m in all; the first is the inertia, the others have
            regressors of (y, ẏ).
        disturbance_bound: δ(y, ẏ) with |Δ| ≤ δ, in the unit of the input.
        input_unit: unit of the input u, e.g. "V" or "N".
        coordinate: "linear" (position in m) or "rotary" (position in rad).

    Raises:
        ValueError: if the first term is not the only one without a regressor, if names repeat, or
            if the prior interval of the inertia is not above zero.

    Example:
        >>> slide = jd.System(
        ...     terms=(
        ...         jd.Term("m", "kg", (5.0, 9.0)),
        ...         jd.Term("b", "N s/m", (0.0, 40.0), jd.Viscous()),
        ...         jd.Term("Fc", "N", (0.0, 30.0), jd.Coulomb(beta=500.0)),
        ...     ),
        ...     disturbance_bound=jd.ConstantBound(6.0),
        ...     input_unit="N",
        ... )
        >>> slide.names
        ('m', 'b', 'Fc')
        >>> slide.with_scaled_disturbance(0.5).disturbance_bound.describe("N", "m/s")
        '3 N'
    """

    terms: tuple[Term, ...] = eqx.field(converter=tuple)
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
        _require_bound(self.disturbance_bound)
        require(
            self.coordinate in ("linear", "rotary"),
            f"Argument `coordinate` must be linear or rotary, but is {self.coordinate!r}.",
        )
        if is_concrete(self.terms[0].interval):
            least = float(np.asarray(self.terms[0].interval)[0])
            require(
                least > 0,
                f"Argument `terms`: the interval of the inertia {self.terms[0].name} must be above "
                f"zero, but its lower end is {least:g}.",
            )

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the m parameters, in the order of θ."""
        return tuple(term.name for term in self.terms)

    @property
    def units(self) -> tuple[str, ...]:
        """The units of the m parameters, in the order of θ."""
        return tuple(term.unit for term in self.terms)

    @property
    def lower(self) -> Float[Array, " m"]:
        """The lower ends θ_min of the prior intervals, shape (m,), in the parameters' units."""
        return _ends_of_intervals(self.terms, 0)

    @property
    def upper(self) -> Float[Array, " m"]:
        """The upper ends θ_max of the prior intervals, shape (m,), in the parameters' units."""
        return _ends_of_intervals(self.terms, 1)

    @property
    def box(self) -> tuple[Range, ...]:
        """The prior box Ω_θ as one range per parameter."""
        return tuple(Range(*term.interval) for term in self.terms)

    @property
    def half_widths(self) -> Float[Array, " m"]:
        """Half the width of each prior interval, shape (m,), in the units of the parameters."""
        return (self.upper - self.lower) / 2

    @property
    def centre(self) -> Float[Array, " m"]:
        """The centre of the prior box Ω_θ, shape (m,), in the units of the parameters."""
        return (self.upper + self.lower) / 2

    @property
    def estimated(self) -> tuple[str, ...]:
        """The names of the parameters whose regressors have a range estimated from samples only."""
        return tuple(t.name for t in self.terms if t.regressor and not t.regressor.proved)

    @property
    def equation(self) -> str:
        """The model as text, such as u = M·ÿ + B·ẏ + Δ."""
        products = (
            term.name if formula == "1" else f"{term.name}·{formula}"
            for term in self.terms
            for formula in ("ÿ" if term.regressor is None else term.regressor.formula,)
        )
        return f"u = {' + '.join(products)} + Δ"

    def index(self, name: str) -> int:
        """Return the index of a parameter in θ.

        Raises:
            ValueError: if the system has no parameter of that name.
        """
        require(
            name in self.names,
            f"Argument `name` must be one of {list(self.names)}, but is {name!r}.",
        )
        return self.names.index(name)

    def with_box(self, lower: Float[Array, " m"], upper: Float[Array, " m"]) -> "System":
        """Return the same system with another prior box.

        Args:
            lower: θ_min, shape (m,), in the units of the parameters.
            upper: θ_max, shape (m,), in the units of the parameters; not below `lower`.
        """
        for name, ends in (("lower", lower), ("upper", upper)):
            require_parameters(name, "a box", ends, self)
        if is_concrete((lower, upper)):
            low, high = np.asarray(lower), np.asarray(upper)
            require(
                bool(np.all(low <= high)) and low[0] > 0,
                "Arguments `lower` and `upper` of a box must be ordered, with an inertia above "
                f"zero, but are {low.tolist()} and {high.tolist()}.",
            )
        ends = [jnp.stack(pair) for pair in zip(lower, upper, strict=True)]
        return eqx.tree_at(lambda s: [term.interval for term in s.terms], self, ends)

    def with_disturbance_bound(self, bound: DisturbanceBound) -> "System":
        """Return the same system with another disturbance bound δ."""
        _require_bound(bound)
        return eqx.tree_at(lambda s: s.disturbance_bound, self, bound)

    def with_scaled_disturbance(self, factor: Scalar | float) -> "System":
        """Return the same system with `factor`·δ as its disturbance bound.

        Raises:
            ValueError: if `factor` is not above zero and finite.
        """
        require_positive("factor", "a scaled disturbance bound", factor)
        return self.with_disturbance_bound(self.disturbance_bound.scaled(factor))

    def regressor_values(self, position: Motion, velocity: Motion) -> tuple[Motion, ...]:
        """Return the values of f₁ … f_{m−1}, i.e. all of φ but ÿ, each in the motion's shape."""
        return tuple(
            term.regressor(position, velocity) for term in self.terms if term.regressor is not None
        )

    def regressor_ranges(self, position: Range, velocity: Range) -> tuple[Range, ...]:
        """Return one range per regressor f₁ … f_{m−1} over ranges of position and velocity."""
        return tuple(
            term.regressor.range(position, velocity)
            for term in self.terms
            if term.regressor is not None
        )

    def regressors(
        self, position: Motion, velocity: Motion, acceleration: Motion
    ) -> tuple[Motion, ...]:
        """Return the regressor vector φ(y, ẏ, ÿ) of (2), as m arrays of the motion's shape."""
        return (acceleration, *self.regressor_values(position, velocity))

    def acceleration(
        self, position: Motion, velocity: Motion, load: Motion, theta: Float[Array, " m"]
    ) -> Motion:
        """Return the acceleration ÿ of (1) under an input, in m/s² or rad/s².

        Args:
            position: y, m or rad.
            velocity: ẏ, m/s or rad/s.
            load: u − Δ, the input minus the disturbance, in the unit of the input.
            theta: θ, shape (m,), in the units of the parameters.
        """
        return (load - dot(self.regressor_values(position, velocity), theta[1:])) / theta[0]


def _ends_of_intervals(terms: tuple[Term, ...], side: int) -> Float[Array, " m"]:
    intervals = [term.interval for term in terms]
    # one array instead of one operation per term: 0.08 ms instead of 0.6 ms
    if is_concrete(intervals):
        return jnp.asarray(np.stack([np.asarray(interval)[side] for interval in intervals]))
    return jnp.stack([interval[side] for interval in intervals])


def _require_bound(bound: object) -> None:
    require(
        isinstance(bound, DisturbanceBound),
        "Argument `disturbance_bound` of a system must be a disturbance bound such as "
        f"jaxid.ConstantBound(0.2), but is {bound!r}.",
    )


def require_parameters(name: str, owner: str, theta: Float[Array, "..."], system: System) -> None:
    """Refuse an array that does not have one entry per parameter of a system."""
    require_shape(name, owner, theta, (len(system.names),), f"for {', '.join(system.names)}")


def smoothed(tree: Tree, speed: Motion) -> Tree:
    """Return a system, or a structure that contains one, with every jump spread over about `speed`.

    `speed` is in m/s or rad/s. The result serves a search by gradients only: its disturbance bound
    is not a bound of the original system.
    """
    return jax.tree.map(
        lambda node: node.smoothed(speed) if isinstance(node, Nonsmooth) else node,
        tree,
        is_leaf=lambda node: isinstance(node, Nonsmooth),
    )
