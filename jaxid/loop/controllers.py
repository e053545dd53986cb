"""Tracking controllers (19)-(27), one tick at a time: the input is held until the next tick.

No guarantee of this package needs a particular controller: what is estimated rests on the recorded
input alone.
"""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxid._checks import is_concrete, require
from jaxid._types import Scalar, as_array, dot
from jaxid.loop.sensors import Measurement
from jaxid.model.system import System, require_parameters
from jaxid.motion.trajectory import States


class Controller(eqx.Module):
    """A sampled feedback law."""

    @property
    def k1_of_p(self) -> Scalar:
        """k₁ of the combined error p = ė + k₁e that an adversary pushes away from zero, 1/s.

        Zero unless a controller says otherwise: then the adversary pushes against the velocity.
        """
        return jnp.zeros(())

    @abc.abstractmethod
    def initial(self) -> Any:
        """The state before the first tick."""

    @abc.abstractmethod
    def step(
        self, state: Any, reference: States, measured: Measurement, period: Scalar
    ) -> tuple[Scalar, Any]:
        """The input to hold for `period` seconds, and the next state."""


class ARC(Controller):
    """Adaptive robust control, in the regression form u = φᵀθ + Δ.

    With M = θ_x2 and φ' = [ẋ₂eq, f], (1) becomes M ṗ = u_s + φ'ᵀθ̃ − Δ. The signs of (20)-(26) as
    printed do not fit one another; these do (see `experiments.axes.linear_motor`).

    In continuous time and with exact states Theorem 4 holds:

    A. V_s = M p²/2 stays below exp(−λt)·V_s(0) + (ε/λ)(1 − exp(−λt)), λ = 2k₂/θ_x2,max (27).
    B. without Δ, e and p go to zero.

    Sampling weakens both. The input is held, so the loop is only stable while
    (k₂ + h²/4ε)·period/θ_x2,min stays below about 1, and A is then found to hold at the ticks (it
    is tested, not proved). In B, e and p go down to a floor instead, because the feed-forward lags
    the reference by half a tick on average; the floor shrinks with the period.

    Attributes:
        system: the model that is compensated, with Ω_θ and δ.
        k1: 1/s, of (19).
        k2: input unit per m/s or rad/s, of (25).
        epsilon: input unit times m/s or rad/s, of (26).
        gamma: diagonal of Γ, one adaptation rate per parameter; 0 keeps it at the centre of Ω_θ.
    """

    system: System
    k1: Scalar = eqx.field(converter=as_array("k1"))
    k2: Scalar = eqx.field(converter=as_array("k2"))
    epsilon: Scalar = eqx.field(converter=as_array("epsilon"))
    gamma: Float[Array, " m"] = eqx.field(converter=as_array("gamma"))

    def __check_init__(self) -> None:
        require_parameters("gamma", "an ARC", self.gamma, self.system)
        for name in ("k1", "k2", "epsilon"):
            value = getattr(self, name)
            if is_concrete(value):
                require(
                    float(value) > 0,
                    f"Argument `{name}` must be positive, but is {float(value):g}.",
                )

        if is_concrete(self.gamma):
            require(
                bool(jnp.all(self.gamma >= 0)),
                "Argument `gamma` must have no negative entry, but is "
                f"{jnp.asarray(self.gamma).tolist()}.",
            )

    @property
    def k1_of_p(self) -> Scalar:
        return self.k1

    def initial(self) -> tuple[Scalar, ...]:
        """θ̂ at the centre of Ω_θ."""
        centre = self.system.centre
        return tuple(centre[j] for j in range(centre.size))

    def step(
        self,
        state: tuple[Scalar, ...],
        reference: States,
        measured: Measurement,
        period: Scalar,
    ) -> tuple[Scalar, tuple[Scalar, ...]]:
        """(19)-(26): u = u_a + u_s1 + u_s2, and the adapted θ̂."""
        theta, (y, v) = state, measured
        e, e_rate = y - reference.position, v - reference.velocity
        p = e_rate + self.k1 * e  # (19)
        x2eq_rate = reference.acceleration - self.k1 * e_rate
        phi = self.model_regressors(y, v, x2eq_rate)
        u_a = sum(f * t for f, t in zip(phi, theta, strict=True))  # (21)
        u_s1 = -self.k2 * p  # (25)
        u_s2 = -(self.mismatch(phi, y, v) ** 2) * p / (4 * self.epsilon)  # (26)
        adapted = self._adapt(theta, phi, p, period)
        return u_a + u_s1 + u_s2, adapted

    def model_regressors(self, y: Scalar, v: Scalar, x2eq_rate: Scalar) -> tuple[Scalar, ...]:
        """φ' of (20): the regressors with ẋ₂eq in the place of the acceleration."""
        return self.system.regressors(y, v, x2eq_rate)

    def mismatch(self, phi: tuple[Scalar, ...], y: Scalar, v: Scalar) -> Scalar:
        """H ≥ |φ'ᵀθ̃ − Δ|, so that −h²p/4ε meets (26): ε is reached at |p| = 2ε/h."""
        return dot([jnp.abs(f) for f in phi], self.reach) + self.system.disturbance_bound(y, v)

    @property
    def reach(self) -> Float[Array, " m"]:
        """How far θ̂ may be from θ: the width of Ω_θ, or half of it where θ̂ stays at the centre."""
        widths = self.system.upper - self.system.lower
        return jnp.where(self.gamma > 0, widths, widths / 2)

    def _adapt(
        self, theta: tuple[Scalar, ...], phi: tuple[Scalar, ...], p: Scalar, period: Scalar
    ) -> tuple[Scalar, ...]:
        """(22)-(23) over one tick: a clipped Euler step is the projection in discrete time."""
        lower, upper = self.system.lower, self.system.upper
        return tuple(
            jnp.clip(t - period * self.gamma[j] * f * p, lower[j], upper[j])
            for j, (t, f) in enumerate(zip(theta, phi, strict=True))
        )


class PDFeedforward(Controller):
    """Proportional-derivative feedback with the model's input for the reference.

    Attributes:
        system: the model of the feed-forward.
        theta: its parameters, shape (m,).
        kp: input unit per m or rad.
        kd: input unit per m/s or rad/s.
    """

    system: System
    theta: Float[Array, " m"] = eqx.field(converter=as_array("theta"))
    kp: Scalar = eqx.field(converter=as_array("kp"))
    kd: Scalar = eqx.field(converter=as_array("kd"))

    def __check_init__(self) -> None:
        require_parameters("theta", "a PDFeedforward", self.theta, self.system)

    @property
    def k1_of_p(self) -> Scalar:
        return self.kp / self.kd

    def initial(self) -> tuple[()]:
        return ()

    def step(
        self, state: tuple[()], reference: States, measured: Measurement, period: Scalar
    ) -> tuple[Scalar, tuple[()]]:
        """φᵀθ on the reference, less what the errors ask for."""
        feedforward = dot(self.system.regressors(*reference), self.theta)
        e = measured.position - reference.position
        e_rate = measured.velocity - reference.velocity
        return feedforward - self.kp * e - self.kd * e_rate, ()


class OpenLoop(Controller):
    """A prescribed input, one value per tick, whatever the axis does."""

    input: Float[Array, " n"] = eqx.field(converter=as_array("input"))

    def initial(self) -> Int[Array, ""]:
        return jnp.zeros((), int)

    def step(
        self, state: Int[Array, ""], reference: States, measured: Measurement, period: Scalar
    ) -> tuple[Scalar, Int[Array, ""]]:
        """The next entry of the given input, whatever is measured."""
        return self.input[state], state + 1


class Delayed(Controller):
    """Another law, whose commands act some periods later.

    Until its first one does, the axis is held by what it commands first.

    Attributes:
        controller: that commands.
        periods: until a command acts, 1 or more.
    """

    controller: Controller
    periods: int = eqx.field(static=True)

    @property
    def k1_of_p(self) -> Scalar:
        return self.controller.k1_of_p

    def initial(self) -> tuple[Any, Float[Array, " periods"], Bool[Array, ""]]:
        return self.controller.initial(), jnp.zeros(self.periods), jnp.zeros((), bool)

    def step(
        self,
        state: tuple[Any, Float[Array, " periods"], Bool[Array, ""]],
        reference: States,
        measured: Measurement,
        period: Scalar,
    ) -> tuple[Scalar, tuple[Any, Float[Array, " periods"], Bool[Array, ""]]]:
        """What was commanded then acts, and what is commanded now waits."""
        inner, waiting, begun = state
        u, inner = self.controller.step(inner, reference, measured, period)
        waiting = jnp.where(begun, waiting, u)
        return waiting[0], (inner, jnp.append(waiting[1:], u), jnp.ones((), bool))


def undelayed(controller: Controller) -> Controller:
    """The controller that commands, whenever its commands act."""
    return controller.controller if isinstance(controller, Delayed) else controller
