"""Experimental design and guaranteed parameter intervals for machine axes, in JAX.

The data flows one way. A folder imports only from those above it in this list:

    model           u = φᵀθ + Δ, θ ∈ Ω_θ, |Δ| ≤ δ
    motion          what a motion is, and which limits it keeps
    search          trajectory optimisation for any criterion
    loop            plant, controller, sensor: what the axis does, and its data
    regression      estimators as weights on data, their exact worst-case errors
    identification  what recorded logs prove
    design          criteria of a motion, and the motion that minimises them
    io              files and pictures
    sweep           many closed loops, resumable
    axis            one axis as a file, and the command

A design runs through the closed loop, but `search` knows nothing of it: the criterion is a function
that is handed in.
"""

from jaxid.axis.file import Axis, read_axis
from jaxid.design.criteria import FilteredError, PlannedError, ThroughLoop, planned_error
from jaxid.design.evaluation import Evaluation, evaluate
from jaxid.design.guaranteed_criterion import GuaranteedError
from jaxid.design.nominal_log import nominal_log
from jaxid.design.optimal_motion import GuaranteedEffort, design_guaranteed, design_motion
from jaxid.identification.assumptions import assumptions
from jaxid.identification.falsification import smallest_disturbance_factor, smallest_factor
from jaxid.identification.feasible_parameter_set import FeasibleSet, feasible_set
from jaxid.identification.identify import Identification, identify
from jaxid.identification.regression_rows import exact_rows
from jaxid.identification.state_bounds import StateBounds, state_bounds
from jaxid.identification.unidentifiable import unidentifiable_directions
from jaxid.io.setpoints import Setpoints, margins, read_setpoints, sampled, write_setpoints
from jaxid.loop.closed_loop import Loop, SampledPlants, log_of, run
from jaxid.loop.controllers import ARC, OpenLoop, PDFeedforward
from jaxid.loop.disturbances import Cogging, LowSpeedFriction, Mixture
from jaxid.loop.log import InconsistentLogError, Log
from jaxid.loop.scenarios import Scenarios
from jaxid.loop.sensors import Encoder, IdealSensor
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant
from jaxid.loop.tube import Tube, parameter_cells
from jaxid.model.disturbance_bound import ConstantBound, SpeedBand
from jaxid.model.regressors import Constant, Coulomb, Custom, OneWay, Sign, Sine, Spring, Viscous
from jaxid.model.system import System, Term
from jaxid.motion.acceleration_limit import acceleration_limit
from jaxid.motion.feasibility import InfeasibleError
from jaxid.motion.limits import Boundary, Limits, Via, position_at_least, through
from jaxid.motion.point_to_point import approach, joined, wait
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.regression.estimate import Estimate, estimate
from jaxid.regression.estimators import ESTIMATORS, Estimator, Filtered, LeastSquares, Minimax
from jaxid.regression.filtered_least_squares import filtered_least_squares
from jaxid.regression.lower_bound import LowerBound, lower_bound
from jaxid.regression.minimax import Optimum, minimax
from jaxid.regression.worst_case import Norm, infinity
from jaxid.runtime import configure
from jaxid.search.local import refine
from jaxid.search.multistart import Design, Effort
from jaxid.search.problem import Problem

__all__ = [
    "ARC",
    "ESTIMATORS",
    "Axis",
    "Boundary",
    "Cogging",
    "Constant",
    "ConstantBound",
    "Coulomb",
    "Custom",
    "Design",
    "Effort",
    "Encoder",
    "Estimate",
    "Estimator",
    "Evaluation",
    "FeasibleSet",
    "Filtered",
    "FilteredError",
    "GuaranteedEffort",
    "GuaranteedError",
    "IdealSensor",
    "Identification",
    "InconsistentLogError",
    "InfeasibleError",
    "JerkTrajectory",
    "LeastSquares",
    "Limits",
    "Log",
    "Loop",
    "LowSpeedFriction",
    "LowerBound",
    "Minimax",
    "Mixture",
    "Norm",
    "OneWay",
    "OpenLoop",
    "Optimum",
    "PDFeedforward",
    "PlannedError",
    "Plant",
    "Problem",
    "SampledPlants",
    "Scenarios",
    "Servo",
    "Setpoints",
    "Sign",
    "Sine",
    "SpeedBand",
    "Spring",
    "StateBounds",
    "System",
    "Task",
    "Term",
    "ThroughLoop",
    "Tube",
    "Via",
    "Viscous",
    "acceleration_limit",
    "approach",
    "assumptions",
    "configure",
    "design_guaranteed",
    "design_motion",
    "estimate",
    "evaluate",
    "exact_rows",
    "feasible_set",
    "filtered_least_squares",
    "identify",
    "infinity",
    "joined",
    "log_of",
    "lower_bound",
    "margins",
    "minimax",
    "nominal_log",
    "parameter_cells",
    "planned_error",
    "position_at_least",
    "read_axis",
    "read_setpoints",
    "refine",
    "run",
    "sampled",
    "smallest_disturbance_factor",
    "smallest_factor",
    "state_bounds",
    "through",
    "unidentifiable_directions",
    "wait",
    "write_setpoints",
]
