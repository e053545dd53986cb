"""A rotary axis with asymmetric limits: one link in the vertical plane, driven by a torque.

    J q̈ + B q̇ + F_c S_f(q̇) + G sin(q) + T₀ + Δ = u,     θ = [J, B, F_c, G, T₀]

All numbers are chosen: a small laboratory arm that hangs down at q = 0 and may swing to 100° on one
side and 20° on the other.
"""

from jaxid.loop.controllers import ARC
from jaxid.loop.disturbances import LowSpeedFriction
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant
from jaxid.model.disturbance_bound import ConstantBound
from jaxid.model.regressors import Constant, Coulomb, Sine, Viscous
from jaxid.model.system import System, Term
from jaxid.motion.acceleration_limit import acceleration_limit
from jaxid.motion.limits import Boundary, Limits, Via, through

KNOT_PERIOD = 0.02  # s
CONTROL_PERIOD = 0.0005  # s
ENCODER_RESOLUTION = 1e-5  # rad

TRUE_PARAMETERS = (0.052, 0.031, 0.118, 0.62, -0.02)  # kg m², N m s/rad, N m, N m, N m


def system() -> System:
    """Return the model of the arm, with its prior box Ω_θ and a disturbance bound of 60 mN m."""
    return System(
        terms=(
            Term("J", "kg m²", (0.03, 0.08)),
            Term("B", "N m s/rad", (0.0, 0.1), Viscous()),
            Term("Fc", "N m", (0.0, 0.3), Coulomb(beta=100.0)),
            Term("G", "N m", (0.3, 1.0), Sine()),
            Term("T0", "N m", (-0.1, 0.1), Constant()),
        ),
        disturbance_bound=ConstantBound(0.06),
        input_unit="N m",
        coordinate="rotary",
    )


def limits() -> Limits:
    """Return the limits of position, velocity, torque and jerk, and acceleration limits (18)."""
    position, velocity, input = (-0.35, 1.75), (-5.0, 6.0), (-4.0, 5.0)
    return Limits(
        position=position,
        velocity=velocity,
        acceleration=acceleration_limit(system(), position, velocity, input),
        jerk=(-1500.0, 1200.0),
        input=input,
    )


def boundary() -> Boundary:
    """Return the boundary: rest at 0 to rest at 0.2 rad, above 1.2 rad at 40 % of the time."""
    free = float("inf")
    raised = Via(0.4, (1.2, -free, -free), (free, free, free))
    return Boundary(start=(0.0, 0.0, 0.0), vias=(raised, through((0.2, 0.0, 0.0), at=1.0)))


def servo() -> Servo:
    """Return the servo of the arm: the sample period and encoder of its logs."""
    return Servo(CONTROL_PERIOD, ENCODER_RESOLUTION)


def controller() -> ARC:
    """Return ARC with gains tuned by hand; it knows Ω_θ and δ but not the true parameters."""
    return ARC(system(), k1=60.0, k2=2.0, epsilon=0.3, gamma=(1e-3,) * 5)


def plant() -> Plant:
    """Return the simulated arm, with 50 mN m of Stribeck friction at low speed."""
    return Plant(system(), TRUE_PARAMETERS, LowSpeedFriction(amplitude=0.05, speed=0.2))
