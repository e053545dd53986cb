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
    quantities <- -
    kinks <- quantities
    regressors <- checks, kinks, quantities, ranges
    disturbance_bounds <- checks, kinks, quantities, ranges
    system <- checks, disturbance_bounds, kinks, quantities, ranges, regressors
    trajectory <- checks, quantities
    limits <- checks, quantities, ranges, system, trajectory
    feasible <- checks, limits, trajectory
    approach <- checks, limits, trajectory
    starts <- feasible
    problem <- limits, quantities, trajectory
    admissible <- checks, feasible, problem, quantities, trajectory
    axis_conditions <- feasible, limits, ranges, system, trajectory
    linear_programs <- feasible
    descent <- problem, quantities, trajectory
    dwells <- feasible, limits, problem, quantities
    polish <- admissible, axis_conditions, feasible, linear_programs, problem, quantities, \
trajectory
    design <- admissible, descent, dwells, feasible, polish, problem, quantities, starts, \
trajectory
    refine <- admissible, axis_conditions, feasible, polish, problem, quantities, trajectory
    record <- system, trajectory
    bound <- checks, quantities, record
    minimax <- bound, checks, quantities, record, system
    floor <- bound, checks, limits, ranges, system
    filters <- quantities, record
    estimators <- bound, filters, minimax, quantities, record
    sensing <- filters, quantities, record, system, trajectory
    disturbance <- quantities
    control <- checks, quantities, sensing, system, trajectory
    tube <- checks, control, limits, quantities, ranges, sensing, system, trajectory
    simulate <- control, disturbance, quantities, record, sensing, system, trajectory
    loop <- control, disturbance, limits, quantities, ranges, record, sensing, simulate, system, \
trajectory
    adversary <- disturbance, limits, loop, quantities, simulate, system, trajectory
    objective <- bound, filters, loop, quantities, record, simulate, system, trajectory
    excitation <- -
    estimate <- bound, record, system
    log <- checks, quantities, ranges
    fit <- checks, log, system
    brackets <- checks, log, quantities, ranges, system
    log_rows <- brackets, estimate, log, quantities, ranges, record, regressors, system
    joint <- brackets, checks, log, log_rows, record, system
    modulating <- bound, checks, log_rows
    feasible_set <- checks, disturbance_bounds, estimate, joint, log, log_rows, modulating, \
quantities, record, system
    guarantee <- checks, estimate, joint, log, log_rows, modulating, system
    stretches <- estimate, feasible_set, guarantee, joint, log, modulating, system
    foresight <- checks, control, disturbance, log, loop, quantities, sensing, simulate, system, \
trajectory
    guaranteed_error <- bound, brackets, checks, disturbance_bounds, foresight, guarantee, \
log_rows, modulating, quantities, ranges, system, trajectory
    motion_design <- admissible, bound, checks, design, feasible, foresight, guaranteed_error, \
objective, polish, problem, quantities, system, trajectory
    appraisal <- checks, floor, foresight, guarantee, objective, system, trajectory
    experiment <- bound, checks, control, estimate, filters, log, record, sensing, simulate, \
system, trajectory
    log_file <- checks
    steady <- checks, log, log_file
    axis_tables <- control, disturbance_bounds, limits, log_file, regressors, system
    axis_file <- axis_tables, checks, control, foresight, log_file, problem, sensing, system, \
trajectory
    files <- checks, trajectory
    setpoints <- checks, files, limits, trajectory
    blocks <- checks, files
    sweep <- checks, control, disturbance, estimate, feasible, filters, quantities, record, \
sensing, simulate, system, trajectory
    dataset <- control, files, sweep
    report <- files, trajectory
    runtime <- checks
    linear_motor <- control, disturbance, disturbance_bounds, foresight, limits, regressors, \
simulate, system
    one_link_arm <- control, disturbance, disturbance_bounds, foresight, limits, regressors, \
simulate, system
    axis_design <- appraisal, approach, axis_file, checks, design, feasible, feasible_set, files, \
floor, foresight, guarantee, motion_design, report, setpoints, trajectory
    axis_tradeoff <- axis_design, axis_file, checks, design, files, floor, limits, motion_design, \
report, trajectory
    axis_prior <- axis_file, checks, disturbance_bounds, feasible_set, fit, log, log_file, \
regressors, report, steady, stretches, system
    axis_identify <- axis_file, checks, feasible_set, files, fit, guarantee, limits, log, \
log_file, report, steady, stretches, system
    axis_simulate <- axis_design, axis_file, checks, disturbance, files, guarantee, limits, log, \
loop, report, sensing, simulate, trajectory
    axis_sweep <- axis_design, axis_file, blocks, checks, control, dataset, disturbance, files, \
report, runtime, sweep, trajectory
    cli <- axis_design, axis_file, axis_identify, axis_prior, axis_simulate, axis_sweep, \
axis_tradeoff, checks, design, files, log_file, motion_design, runtime
"""

from jaxid.appraisal import Appraisal, appraise
from jaxid.approach import approach, joined, wait
from jaxid.axis_file import Axis, read_axis
from jaxid.bound import Norm, infinity
from jaxid.brackets import Brackets, brackets
from jaxid.control import ARC, OpenLoop, PDFeedforward
from jaxid.design import Design, Effort, design
from jaxid.disturbance import Cogging, LowSpeedFriction, Mixture
from jaxid.disturbance_bounds import ConstantBound, SpeedBand
from jaxid.estimate import Estimate, estimate
from jaxid.estimators import ESTIMATORS, Estimator, Filtered, LeastSquares, Minimax
from jaxid.experiment import identify, log_of, run
from jaxid.feasible import InfeasibleError
from jaxid.feasible_set import (
    FeasibleSet,
    blind,
    explaining_factor,
    feasible_set,
    louder,
    smallest_factor,
    unlogged,
)
from jaxid.floor import Floor, floor
from jaxid.foresight import Servo, foreseen
from jaxid.guarantee import Guarantee, assumptions, identify_log, identify_logs
from jaxid.guaranteed_error import GuaranteedError
from jaxid.limits import (
    Boundary,
    Limits,
    Via,
    acceleration_limit,
    position_at_least,
    through,
)
from jaxid.log import ContradictionError, Log
from jaxid.loop import Loop, Sampled, Scenarios
from jaxid.minimax import Optimum, minimax
from jaxid.motion_design import GuaranteedEffort, design_guaranteed, design_motion
from jaxid.objective import FilteredError, PlannedError, ThroughLoop, planned_error
from jaxid.problem import Problem, Task
from jaxid.refine import refine
from jaxid.regressors import Constant, Coulomb, Custom, OneWay, Sign, Sine, Spring, Viscous
from jaxid.runtime import configure
from jaxid.sensing import Encoder, IdealSensor
from jaxid.setpoints import Setpoints, margins, read_setpoints, sampled, write_setpoints
from jaxid.simulate import Plant
from jaxid.system import System, Term
from jaxid.trajectory import JerkTrajectory
from jaxid.tube import Tube, cells

__all__ = [
    "ARC",
    "ESTIMATORS",
    "Appraisal",
    "Axis",
    "Boundary",
    "Brackets",
    "Cogging",
    "Constant",
    "ConstantBound",
    "ContradictionError",
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
    "GuaranteedEffort",
    "GuaranteedError",
    "IdealSensor",
    "InfeasibleError",
    "JerkTrajectory",
    "LeastSquares",
    "Limits",
    "Log",
    "Loop",
    "LowSpeedFriction",
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
    "Sampled",
    "Scenarios",
    "Servo",
    "Setpoints",
    "Sign",
    "Sine",
    "SpeedBand",
    "Spring",
    "System",
    "Task",
    "Term",
    "ThroughLoop",
    "Tube",
    "Via",
    "Viscous",
    "acceleration_limit",
    "appraise",
    "approach",
    "assumptions",
    "blind",
    "brackets",
    "cells",
    "configure",
    "design",
    "design_guaranteed",
    "design_motion",
    "estimate",
    "explaining_factor",
    "feasible_set",
    "floor",
    "foreseen",
    "identify",
    "identify_log",
    "identify_logs",
    "infinity",
    "joined",
    "log_of",
    "louder",
    "margins",
    "minimax",
    "planned_error",
    "position_at_least",
    "read_axis",
    "read_setpoints",
    "refine",
    "run",
    "sampled",
    "smallest_factor",
    "through",
    "unlogged",
    "wait",
    "write_setpoints",
]
