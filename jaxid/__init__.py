"""Optimal experiments and guaranteed parameter intervals for machine axes, in JAX.

An axis obeys u = φ(y, ẏ, ÿ)ᵀθ + Δ: known regressors φ, unknown parameters θ in a prior box, and a
disturbance |Δ| ≤ δ. jaxid plans the motion whose data bound θ best in the worst case, within the
limits of the axis, and turns a recorded log into intervals that contain θ.

Switch on double precision first: `jaxid.configure()`, or JAX's option `jax_enable_x64`. Equation
numbers such as (16) are those of L. Lu and B. Yao, "Experimental Design for Identification of
Nonlinear Systems with Bounded Uncertainties", American Control Conference, 2010.

Describe an axis
    System, Term; the regressors Viscous, Coulomb, Sign, Constant, Spring, Sine, OneWay, Custom, or
    a subclass of Regressor; the bounds ConstantBound, SpeedBand, or a subclass of DisturbanceBound.
Say what a motion must do
    Limits, acceleration_limit, Boundary, Via, through, position_at_least, Task; JerkTrajectory.
Design the motion
    optimal_motion minimises LeastSquaresError, PredictedError, any function of a motion, or a
    subclass of Criterion; Effort; InfeasibleError.
Evaluate the motion
    lower_bound: the error that no motion and no estimator can reduce; evaluate; planned_error, and
    sampled_error for a motion that is given by samples.
Simulate it
    Servo, Plant, run; the controllers ARC, PDFeedforward, or a subclass of Controller; IdealSensor,
    or a subclass of Sensor; Disturbance.
Identify the axis
    Log, identify, assumptions, InconsistentLogError. The paper's own identification, which is no
    certificate: Record, filtered_least_squares.
Files
    read_axis, read_log, sampled, write_setpoints.

Everything else is imported from its folder. A folder imports only from those above it:

    model           u = φᵀθ + Δ, θ ∈ Ω_θ, |Δ| ≤ δ
    motion          what a motion is, and which limits it keeps
    search          trajectory optimisation for any criterion
    loop            plant, controller, sensor: what the axis does, and its data
    regression      estimators as weights on data, their exact worst-case errors
    identification  guaranteed intervals from recorded logs
    design          criteria of a motion, and the motion that minimises them
    io              files and pictures
    sweep           many closed loops, resumable
    axis            one axis as a file, and the command
"""

from jaxid.axis.file import read_axis
from jaxid.design.criteria import Criterion, LeastSquaresError
from jaxid.design.evaluation import evaluate
from jaxid.design.optimal_motion import optimal_motion
from jaxid.design.predicted_error import PredictedError
from jaxid.identification.assumptions import assumptions
from jaxid.identification.identify import identify
from jaxid.io.log_file import read_log
from jaxid.io.setpoints import sampled, write_setpoints
from jaxid.loop.closed_loop import run
from jaxid.loop.controllers import ARC, Controller, PDFeedforward
from jaxid.loop.disturbances import Disturbance
from jaxid.loop.log import InconsistentLogError, Log
from jaxid.loop.record import Record
from jaxid.loop.sensors import IdealSensor, Sensor
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant
from jaxid.model.disturbance_bound import ConstantBound, DisturbanceBound, SpeedBand
from jaxid.model.regressors import (
    Constant,
    Coulomb,
    Custom,
    OneWay,
    Regressor,
    Sign,
    Sine,
    Spring,
    Viscous,
)
from jaxid.model.system import System, Term
from jaxid.motion.acceleration_limit import acceleration_limit
from jaxid.motion.feasibility import InfeasibleError
from jaxid.motion.limits import Boundary, Limits, Via, position_at_least, through
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.error_of_motion import planned_error, sampled_error
from jaxid.regression.filtered_least_squares import filtered_least_squares
from jaxid.regression.lower_bound import lower_bound
from jaxid.runtime import configure
from jaxid.search.effort import Effort

__all__ = [
    "ARC",
    "Boundary",
    "Constant",
    "ConstantBound",
    "Controller",
    "Coulomb",
    "Criterion",
    "Custom",
    "Disturbance",
    "DisturbanceBound",
    "Effort",
    "IdealSensor",
    "InconsistentLogError",
    "InfeasibleError",
    "JerkTrajectory",
    "LeastSquaresError",
    "Limits",
    "Log",
    "OneWay",
    "PDFeedforward",
    "Plant",
    "PredictedError",
    "Record",
    "Regressor",
    "Sensor",
    "Servo",
    "Sign",
    "Sine",
    "SpeedBand",
    "Spring",
    "System",
    "Task",
    "Term",
    "Via",
    "Viscous",
    "acceleration_limit",
    "assumptions",
    "configure",
    "evaluate",
    "filtered_least_squares",
    "identify",
    "lower_bound",
    "optimal_motion",
    "planned_error",
    "position_at_least",
    "read_axis",
    "read_log",
    "run",
    "sampled",
    "sampled_error",
    "through",
    "write_setpoints",
]
