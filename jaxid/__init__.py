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

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
