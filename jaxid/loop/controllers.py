"""Tracking controllers (19)-(27), one sample at a time, with a zero-order hold of the input.

No guarantee of this package depends on the controller: estimation uses the recorded input only.
"""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxid._checks import is_concrete, require
from jaxid._types import Scalar, as_array, dot
from jaxid.loop.sensors import Measurement
from jaxid.model.system import System, require_parameters
from jaxid.motion.trajectory import States


class Controller(eqx.Module):
    """Base class of sampled controllers."""

    @property
    def k1_of_p(self) -> Scalar:
        """The ratio k₁, in 1/s, of the worst-case disturbance, which drives ė + k₁e from zero.

        With zero, the default, that disturbance depends on the velocity error alone.
        """
        return jnp.zeros(())

    @abc.abstractmethod
    def initial(self) -> Any:
        """Return the state of the controller before the first sample."""

    @abc.abstractmethod
    def step(
        self, state: Any, reference: States, measured: Measurement, period: Scalar
    ) -> tuple[Scalar, Any]:
        """Return the input for one sample period, and the next state of the controller.

        Args:
            state: state of the controller.
            reference: desired position, velocity and acceleration at this sample.
            measured: measured position and velocity at this sample.
            period: sample period, s.
        """


class ARC(Controller):
    """The adaptive robust controller (ARC) of Lu and Yao (2010), in the form u = φᵀθ + Δ.

    With M = θ_x2 and φ' = [ẋ₂eq, f], (1) becomes M ṗ = u_s + φ'ᵀθ̃ − Δ. The signs of (20)-(26) as
    printed are inconsistent; those used here are consistent (see `experiments.axes.linear_motor`).

    In continuous time and with exact states Theorem 4 holds:

    A. V_s = M p²/2 stays below exp(−λt)·V_s(0) + (ε/λ)(1 − exp(−λt)), λ = 2k₂/θ_x2,max (27).
    B. without Δ, e and p converge to zero.

    Sampling weakens both. The input is held, so the loop is stable only while (k₂ +
    h²/4ε)·period/θ_x2,min stays below about 1; then A was found to hold at the samples (tested, not
    proved). In B, e and p decrease to a small value instead, since the feed-forward lags the
    reference by half a sample period on average; this value decreases with the sample period.

    Attributes:
        system: model that is compensated, with Ω_θ and δ.
        k1: gain k₁ of (19), 1/s.
        k2: gain k₂ of (25), unit of the input per m/s or rad/s.
        epsilon: ε of (26), unit of the input times m/s or rad/s.
        gamma: diagonal of Γ, one adaptation rate per parameter; with 0 the estimate of that
            parameter stays at the centre of Ω_θ.

    Raises:
        ValueError: if `k1`, `k2` or `epsilon` is not above zero, or an entry of `gamma` is below
            zero.
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
                bool(np.all(np.asarray(self.gamma) >= 0)),
                "Argument `gamma` must have no negative entry, but is "
                f"{np.asarray(self.gamma).tolist()}.",
            )

    @property
    def k1_of_p(self) -> Scalar:
        """The gain k₁ of the combined error p = ė + k₁e (19), in 1/s."""
        return self.k1

    def initial(self) -> tuple[Scalar, ...]:
        """Return the first parameter estimate θ̂, the centre of Ω_θ, as m scalars."""
        centre = self.system.centre
        return tuple(centre[j] for j in range(centre.size))

    def step(
        self,
        state: tuple[Scalar, ...],
        reference: States,
        measured: Measurement,
        period: Scalar,
    ) -> tuple[Scalar, tuple[Scalar, ...]]:
        """Return the input u = u_a + u_s1 + u_s2 of (19)-(26), and the adapted θ̂.

        Args:
            state: parameter estimate θ̂, m scalars.
            reference: desired position, velocity and acceleration at this sample.
            measured: measured position and velocity at this sample.
            period: sample period, s.
        """
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
        """Return φ' of (20): the regressors of the system with ẋ₂eq instead of the acceleration.

        Args:
            y: measured position, m or rad.
            v: measured velocity, m/s or rad/s.
            x2eq_rate: ẋ₂eq, m/s² or rad/s².
        """
        return self.system.regressors(y, v, x2eq_rate)

    def mismatch(self, phi: tuple[Scalar, ...], y: Scalar, v: Scalar) -> Scalar:
        """Return the h of (26), an upper bound of |φ'ᵀθ̃ − Δ| in the unit of the input.

        With it, −h²p/4ε meets (26); ε is reached at |p| = 2ε/h.

        Args:
            phi: φ' of (20), m scalars.
            y: measured position, m or rad.
            v: measured velocity, m/s or rad/s.
        """
        return dot([jnp.abs(f) for f in phi], self.reach) + self.system.disturbance_bound(y, v)

    @property
    def reach(self) -> Float[Array, " m"]:
        """The largest estimation error |θ̂ − θ| of each parameter during control, shape (m,).

        It is the width of Ω_θ where θ̂ is adapted, and half of it where θ̂ stays at the centre.
        """
        widths = self.system.upper - self.system.lower
        return jnp.where(self.gamma > 0, widths, widths / 2)

    def _adapt(
        self, theta: tuple[Scalar, ...], phi: tuple[Scalar, ...], p: Scalar, period: Scalar
    ) -> tuple[Scalar, ...]:
        """Return θ̂ after one sample period of (22)-(23), a projected Euler step."""
        lower, upper = self.system.lower, self.system.upper
        return tuple(
            jnp.clip(t - period * self.gamma[j] * f * p, lower[j], upper[j])
            for j, (t, f) in enumerate(zip(theta, phi, strict=True))
        )


class PDFeedforward(Controller):
    """Proportional-derivative feedback with feed-forward of the model's input for the reference.

    Attributes:
        system: model of the feed-forward.
        theta: parameters of the feed-forward, shape (m,), in the units of the parameters.
        kp: proportional gain, unit of the input per m or rad.
        kd: derivative gain, unit of the input per m/s or rad/s.
    """

    system: System
    theta: Float[Array, " m"] = eqx.field(converter=as_array("theta"))
    kp: Scalar = eqx.field(converter=as_array("kp"))
    kd: Scalar = eqx.field(converter=as_array("kd"))

    def __check_init__(self) -> None:
        require_parameters("theta", "a PDFeedforward", self.theta, self.system)

    @property
    def k1_of_p(self) -> Scalar:
        """The ratio kp/kd, in 1/s, so that the feedback is −kd·(ė + k₁e)."""
        return self.kp / self.kd

    def initial(self) -> tuple[()]:
        """Return the empty state: the controller has no memory."""
        return ()

    def step(
        self, state: tuple[()], reference: States, measured: Measurement, period: Scalar
    ) -> tuple[Scalar, tuple[()]]:
        """Return the input φᵀθ of the reference minus kp·e + kd·ė, and the empty state.

        Args:
            state: empty.
            reference: desired position, velocity and acceleration at this sample.
            measured: measured position and velocity at this sample.
            period: sample period, s; not used.
        """
        feedforward = dot(self.system.regressors(*reference), self.theta)
        e = measured.position - reference.position
        e_rate = measured.velocity - reference.velocity
        return feedforward - self.kp * e - self.kd * e_rate, ()


class OpenLoop(Controller):
    """A controller that plays a prescribed input and ignores all measurements.

    Attributes:
        input: input of each sample period, shape (n,), in the unit of the input.
    """

    input: Float[Array, " n"] = eqx.field(converter=as_array("input"))

    def initial(self) -> Int[Array, ""]:
        """Return the index of the first sample, 0."""
        return jnp.zeros((), int)

    def step(
        self, state: Int[Array, ""], reference: States, measured: Measurement, period: Scalar
    ) -> tuple[Scalar, Int[Array, ""]]:
        """Return the prescribed input of this sample, and the index of the next sample.

        Args:
            state: index of this sample.
            reference: not used.
            measured: not used.
            period: not used.
        """
        return self.input[state], state + 1


class Delayed(Controller):
    """Another controller whose commands act a number of sample periods later.

    Until the first command acts, its value is the input, too.

    Attributes:
        controller: controller that gives the commands.
        periods: number of sample periods from a command until it acts, 1 or more.
    """

    controller: Controller
    periods: int = eqx.field(static=True)

    @property
    def k1_of_p(self) -> Scalar:
        """The k₁ of the other controller, in 1/s."""
        return self.controller.k1_of_p

    def initial(self) -> tuple[Any, Float[Array, " periods"], Bool[Array, ""]]:
        """Return the state before the first sample: that of the other controller and no command."""
        return self.controller.initial(), jnp.zeros(self.periods), jnp.zeros((), bool)

    def step(
        self,
        state: tuple[Any, Float[Array, " periods"], Bool[Array, ""]],
        reference: States,
        measured: Measurement,
        period: Scalar,
    ) -> tuple[Scalar, tuple[Any, Float[Array, " periods"], Bool[Array, ""]]]:
        """Return the command of `periods` samples ago, and the next state.

        Args:
            state: state of the other controller, waiting commands, and whether there is any.
            reference: desired position, velocity and acceleration at this sample.
            measured: measured position and velocity at this sample.
            period: sample period, s.
        """
        inner, waiting, begun = state
        u, inner = self.controller.step(inner, reference, measured, period)
        waiting = jnp.where(begun, waiting, u)
        return waiting[0], (inner, jnp.append(waiting[1:], u), jnp.ones((), bool))


def delayed(controller: Controller, periods: int) -> Controller:
    """Return a controller whose commands act `periods` sample periods later, 0 or more."""
    return Delayed(controller, periods) if periods else controller


def undelayed(controller: Controller) -> Controller:
    """Return the controller without its delay; one without delay is returned as it is."""
    return controller.controller if isinstance(controller, Delayed) else controller
