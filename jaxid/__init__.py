"""Experimental design and guaranteed parameter intervals for machine axes, in JAX.

The data flows one way, from a system and its limits to a motion, a controller, a simulation, a
Record, weights on it and an estimate:

    system - limits - trajectory -> control - simulate -> Record -> weights -> estimate -> report
                          ^                                                       |
                          +----------------- design (takes a function) <----------+

`design` takes its objective as a function, so the arrow back is a value and no import. The table
says which room may import from which; it is tested, and so is that nobody imports from below.

    checks <- -
    ranges <- -
    system <- checks, ranges
    trajectory <- checks, system
    limits <- checks, ranges, system, trajectory
    feasible <- checks, limits, trajectory
    starts <- feasible
    problem <- limits, system, trajectory
    admissible <- checks, feasible, problem, system, trajectory
    axis_conditions <- feasible, limits, ranges, system, trajectory
    linear_programs <- feasible
    descent <- feasible, problem, system
    dwells <- feasible, limits, problem, system
    polish <- admissible, axis_conditions, feasible, linear_programs, problem, system, trajectory
    design <- admissible, descent, dwells, feasible, polish, problem, starts, system, trajectory
    refine <- admissible, axis_conditions, feasible, polish, problem, system, trajectory
    record <- system, trajectory
    bound <- checks, record, system
    minimax <- bound, checks, record, system
    floor <- bound, checks, limits, ranges, system
    filters <- record, system
    estimators <- bound, filters, minimax, record, system
    sensing <- filters, record, system, trajectory
    disturbance <- system
    control <- checks, sensing, system, trajectory
    tube <- checks, control, limits, ranges, sensing, system, trajectory
    simulate <- control, disturbance, record, sensing, system, trajectory
    loop <- control, disturbance, limits, ranges, record, sensing, simulate, system, trajectory
    adversary <- disturbance, limits, loop, simulate, system, trajectory
    objective <- bound, filters, loop, record, simulate, system, trajectory
    excitation <- -
    estimate <- bound, record, system
    log <- checks, ranges, system
    log_rows <- estimate, log, ranges, record, system
    modulating <- bound, log_rows
    feasible_set <- checks, estimate, log_rows, modulating, record, system
    guarantee <- checks, estimate, log, log_rows, modulating, system, trajectory
    guaranteed_error <- bound, guarantee, log, log_rows, modulating, ranges, system, trajectory
    experiment <- admissible, bound, checks, control, design, estimate, filters, guarantee, \
guaranteed_error, log, objective, polish, problem, record, sensing, simulate, system, trajectory
    files <- checks, trajectory
    blocks <- checks, files
    sweep <- checks, control, disturbance, estimate, feasible, filters, record, sensing, \
simulate, system, trajectory
    dataset <- files, sweep
    report <- files, trajectory
    runtime <- checks
    linear_motor <- control, disturbance, limits, simulate, system
    one_link_arm <- disturbance, limits, simulate, system
"""

from jaxid.control import ARC, OpenLoop, PDFeedforward
from jaxid.design import Design, Effort, design
from jaxid.estimate import Estimate, estimate
from jaxid.estimators import ESTIMATORS, Estimator, Filtered, LeastSquares, Minimax
from jaxid.experiment import design_guaranteed, design_motion, identify, log_of, run
from jaxid.feasible import InfeasibleError
from jaxid.feasible_set import FeasibleSet, blind, feasible_set, louder, smallest_factor, unlogged
from jaxid.floor import Floor, floor
from jaxid.guarantee import Guarantee, assumptions, foreseen, identify_log
from jaxid.guaranteed_error import GuaranteedError
from jaxid.limits import (
    Boundary,
    Limits,
    Via,
    acceleration_limit,
    position_at_least,
    through,
)
from jaxid.log import Brackets, Log, brackets
from jaxid.loop import Loop, Sampled, Scenarios
from jaxid.minimax import Optimum, minimax
from jaxid.objective import FilteredError, ThroughLoop, planned_error
from jaxid.problem import Problem, Task
from jaxid.refine import refine
from jaxid.sensing import Encoder, IdealSensor
from jaxid.simulate import Plant
from jaxid.system import (
    Constant,
    ConstantBound,
    Coulomb,
    Custom,
    Sine,
    SpeedBand,
    System,
    Term,
    Viscous,
)
from jaxid.tube import Tube, cells

__all__ = [
    "ARC",
    "ESTIMATORS",
    "Boundary",
    "Brackets",
    "Constant",
    "ConstantBound",
    "Coulomb",
    "Custom",
    "Design",
    "Effort",
    "Encoder",
    "Estimate",
    "Estimator",
    "FeasibleSet",
    "Filtered",
    "FilteredError",
    "Floor",
    "Guarantee",
    "GuaranteedError",
    "IdealSensor",
    "InfeasibleError",
    "LeastSquares",
    "Limits",
    "Log",
    "Loop",
    "Minimax",
    "OpenLoop",
    "Optimum",
    "PDFeedforward",
    "Plant",
    "Problem",
    "Sampled",
    "Scenarios",
    "Sine",
    "SpeedBand",
    "System",
    "Task",
    "Term",
    "ThroughLoop",
    "Tube",
    "Via",
    "Viscous",
    "acceleration_limit",
    "assumptions",
    "blind",
    "brackets",
    "cells",
    "design",
    "design_guaranteed",
    "design_motion",
    "estimate",
    "feasible_set",
    "floor",
    "foreseen",
    "identify",
    "identify_log",
    "log_of",
    "louder",
    "minimax",
    "planned_error",
    "position_at_least",
    "refine",
    "run",
    "smallest_factor",
    "through",
    "unlogged",
]
