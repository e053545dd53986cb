"""The linear motor of the paper: one axis of an Anorad gantry, in SI units.

L. Lu and B. Yao, "Experimental Design for Identification of Nonlinear Systems with Bounded
Uncertainties", American Control Conference, 2010; equations (31)-(33) and Section III.

    M ÿ + B ẏ + F_c S_f(ẏ) + d̄ + Δ = u,     θ = [M, B, F_c, d̄]

Some printed equations of the paper contain errors. This package uses the following instead:

- (13), (15), (16), (29): the bound is ∫ abs(P⁻¹φ) δ, not ∫ abs(Pφ) δ. By (11)-(12) the error is
  P⁻¹∫φΔ, and only this agrees with the numbers of Table I.
- (16): the control is the jerk, y⃛ = v(t), bounded by x₄min and x₄max; the state is [y, ẏ, ÿ], and
  ÿ is bounded by x₃min and x₃max.
- (18) omits Δ and the feedback: it does not ensure |u| ≤ u_max in closed loop. Its product of
  maxima can be read as a sum of products (44.4 m/s²) or by Cauchy-Schwarz (43.8 m/s²); the text
  says "as high as 45". The study uses the sum.
- (20)-(26) mix two sign conventions. Here the regression form u = φᵀθ + Δ is kept throughout:
  φ' = [ẋ₂eq, ẏ, S_f, 1], u_a = φ'ᵀθ̂, M ṗ = u_s + φ'ᵀθ̃ − Δ, θ̂' = Proj(−Γ φ' p).
- (28)-(29): |Δ_f| ≤ δ_f holds because the impulse response of H_f is never negative.
- J_f = J* + J_e after (30): J_e can be slightly negative, because the filter changes both φ and δ.
- S_f is (2/π)·arctan(βẏ): "always between −1 and 1".
- Table I includes N_i = 20, for which no motion exists: y(N_iT) ≥ 0.3 m from rest needs N_i ≥ 22 at
  a jerk of 1000 m/s³.

Values that the paper does not give are marked "chosen" below.
"""

from jaxtyping import Array, Float

from jaxid.design.predicted_error import PredictedError
from jaxid.loop.controllers import ARC
from jaxid.loop.disturbances import Cogging, LowSpeedFriction, Mixture
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant
from jaxid.model.disturbance_bound import SpeedBand
from jaxid.model.regressors import Constant, Coulomb, Viscous
from jaxid.model.system import System, Term
from jaxid.motion.acceleration_limit import acceleration_limit
from jaxid.motion.limits import Boundary, Limits, position_at_least, through

KNOT_PERIOD = 0.01  # s, the T of the paper
HORIZONS = (20, 30, 40, 50, 60)  # N_i; one motion lasts 2·N_i·T
CONTROL_PERIOD = 0.0002  # s, zero-order hold; chosen
ENCODER_RESOLUTION = 0.5e-6  # m
BANDWIDTH = 1000.0  # rad/s, the w of H_f
# m/s, velocity error that designs allow for near the threshold of δ: 95 % of the velocities of 40
# random motors lag by less. Without it, the guaranteed interval of F_c is 3 % wider than predicted
# for some motors.
VELOCITY_ERROR = 0.002
INPUT_RATE = (-10_000.0, 10_000.0)  # V/s; chosen: an amplifier that swings 10 V in 1 ms
OPEN_LOOP_AMPLITUDES = (0.3, 0.5)  # V

# Chosen: tracks within 0.1 mm at a sample period of 0.2 ms without chatter. At ε = 1 the bound of
# Theorem 4 is so wide that the controller nearly keeps it without u_s2; at ε = 0.01 the sampled
# loop is unstable.
ARC_GAINS = {"k1": 200.0, "k2": 40.0, "epsilon": 0.1, "gamma": (1e-4, 1.0, 1.0, 5.0)}

# Chosen for a narrow proved tube: low position gain, no adaptation. With k₁ = 5 the tube takes up
# to 9 mm of the stroke; with k₁ ≥ 20, or a larger k₂, it takes more of the input.
PROVABLE_GAINS = {"k1": 10.0, "k2": 60.0, "epsilon": 1.0, "gamma": (0.0, 0.0, 0.0, 0.0)}

# Chosen, near Table II: true parameters of the simulated plant, unknown to design and controller.
TRUE_PARAMETERS = (0.122, 0.226, 0.193, 0.02)  # V s²/m, V s/m, V, V

# Tables I, II and III of the paper, to print beside those of this study.
PAPER_TABLE_1 = {"M": (30, 0.0055), "B": (50, 0.1966), "Fc": (30, 0.2598)}
PAPER_TABLE_2 = {"M": (0.12233, 0.01820), "B": (0.22593, 0.24737), "Fc": (0.19254, 0.41782)}
PAPER_TABLE_3 = {0.3: (0.076, 3.653, 0.540, 0.189), 0.5: (0.056, 2.507, 0.510, 0.182)}


def seconds(horizon: int) -> float:
    """Return the duration 2·N·T of a motion with horizon N, s."""
    return 2 * horizon * KNOT_PERIOD


def system() -> System:
    """Return the model (31) of the motor, with its prior box Ω_θ and disturbance bound δ (33)."""
    return System(
        terms=(
            Term("M", "V s²/m", (0.08, 0.18)),
            Term("B", "V s/m", (0.0, 0.5), Viscous()),
            Term("Fc", "V", (0.0, 0.5), Coulomb(beta=1000.0)),  # β in s/m, chosen
            Term("dbar", "V", (-0.5, 0.5), Constant()),
        ),
        disturbance_bound=SpeedBand(slow=0.25, fast=0.15, threshold=0.1),
        input_unit="V",
        coordinate="linear",
    )


def limits() -> Limits:
    """Return the limits (32), with the acceleration limit (18) and a jerk limit of 1000 m/s³.

    The jerk limit is chosen: 44 m/s² are reached within 45 ms.
    """
    position, velocity, input = (-0.01, 0.4), (-2.0, 2.0), (-10.0, 10.0)
    return Limits(
        position=position,
        velocity=velocity,
        acceleration=acceleration_limit(system(), position, velocity, input),
        jerk=(-1000.0, 1000.0),
        input=input,
        input_rate=INPUT_RATE,
    )


def boundary() -> Boundary:
    """Return the boundary: from rest at 0 to rest at 0, with at least 0.3 m half-way."""
    rest = (0.0, 0.0, 0.0)
    return Boundary(start=rest, vias=(position_at_least(0.3, at=0.5), through(rest, at=1.0)))


def controller() -> ARC:
    """Return ARC with the gains of the study; it knows Ω_θ and δ but not the true parameters."""
    return ARC(system(), **ARC_GAINS)


def servo() -> Servo:
    """Return the servo of the motor: the sample period and encoder of its logs."""
    return Servo(CONTROL_PERIOD, ENCODER_RESOLUTION)


def predicted_error(targets: Float[Array, " m"]) -> PredictedError:
    """Return the criterion of designs for all parameters: predicted errors relative to targets."""
    return PredictedError(system(), targets, servo(), velocity_error=VELOCITY_ERROR)


def provable_controller() -> ARC:
    """Return ARC with gains for which the proved tube is narrow."""
    return ARC(system(), **PROVABLE_GAINS)


def plant() -> Plant:
    """Return the simulated motor, with cogging and additional friction at low speed (chosen).

    The cogging has a pitch of 60 mm, an amplitude of 50 mV and a third harmonic of 20 mV. The
    friction of 120 mV fades within 30 mm/s. Their sum stays below 0.19 V at all speeds and below
    0.08 V above 0.1 m/s, within (33).
    """
    cogging = Cogging(pitch=0.06, harmonics=[1.0, 3.0], amplitudes=[0.05, 0.02])
    friction = LowSpeedFriction(amplitude=0.12, speed=0.03)
    return Plant(system(), TRUE_PARAMETERS, Mixture((cogging, friction), [1.0, 1.0]))
