"""The public names, by where they are defined; `__init__.py` imports each when it is used."""

from .axis.file import (
    read_axis as read_axis,
)
from .design.criteria import (
    Criterion as Criterion,
)
from .design.criteria import (
    LeastSquaresError as LeastSquaresError,
)
from .design.evaluation import (
    evaluate as evaluate,
)
from .design.optimal_motion import (
    optimal_motion as optimal_motion,
)
from .design.predicted_error import (
    PredictedError as PredictedError,
)
from .identification.assumptions import (
    assumptions as assumptions,
)
from .identification.identify import (
    identify as identify,
)
from .io.log_file import (
    read_log as read_log,
)
from .io.setpoints import (
    sampled as sampled,
)
from .io.setpoints import (
    write_setpoints as write_setpoints,
)
from .loop.closed_loop import (
    run as run,
)
from .loop.controllers import (
    ARC as ARC,
)
from .loop.controllers import (
    Controller as Controller,
)
from .loop.controllers import (
    PDFeedforward as PDFeedforward,
)
from .loop.disturbances import (
    Disturbance as Disturbance,
)
from .loop.log import (
    InconsistentLogError as InconsistentLogError,
)
from .loop.log import (
    Log as Log,
)
from .loop.record import (
    Record as Record,
)
from .loop.sensors import (
    IdealSensor as IdealSensor,
)
from .loop.sensors import (
    Sensor as Sensor,
)
from .loop.servo import (
    Servo as Servo,
)
from .loop.simulate import (
    Plant as Plant,
)
from .model.disturbance_bound import (
    ConstantBound as ConstantBound,
)
from .model.disturbance_bound import (
    DisturbanceBound as DisturbanceBound,
)
from .model.disturbance_bound import (
    SpeedBand as SpeedBand,
)
from .model.regressors import (
    Constant as Constant,
)
from .model.regressors import (
    Coulomb as Coulomb,
)
from .model.regressors import (
    Custom as Custom,
)
from .model.regressors import (
    OneWay as OneWay,
)
from .model.regressors import (
    Regressor as Regressor,
)
from .model.regressors import (
    Sign as Sign,
)
from .model.regressors import (
    Sine as Sine,
)
from .model.regressors import (
    Spring as Spring,
)
from .model.regressors import (
    Viscous as Viscous,
)
from .model.system import (
    System as System,
)
from .model.system import (
    Term as Term,
)
from .motion.acceleration_limit import (
    acceleration_limit as acceleration_limit,
)
from .motion.feasibility import (
    InfeasibleError as InfeasibleError,
)
from .motion.limits import (
    Boundary as Boundary,
)
from .motion.limits import (
    Limits as Limits,
)
from .motion.limits import (
    Via as Via,
)
from .motion.limits import (
    position_at_least as position_at_least,
)
from .motion.limits import (
    through as through,
)
from .motion.task import (
    Task as Task,
)
from .motion.trajectory import (
    JerkTrajectory as JerkTrajectory,
)
from .regression.error_of_motion import (
    planned_error as planned_error,
)
from .regression.error_of_motion import (
    sampled_error as sampled_error,
)
from .regression.filtered_least_squares import (
    filtered_least_squares as filtered_least_squares,
)
from .regression.lower_bound import (
    lower_bound as lower_bound,
)
from .runtime import (
    configure as configure,
)
from .search.effort import (
    Effort as Effort,
)
