"""The design of one experiment: its objectives, its limits, and the evaluation of its motions."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from experiments._support.settings import Setting
from experiments.axes import linear_motor as motor
from experiments.paper.designs import Cell
from experiments.paper.runs import PERIODS
from jaxid.design.criteria import FilteredError, PerfectTracking, PlannedError, ThroughLoop
from jaxid.loop.closed_loop import ClosedLoop, SampledPlants, plant_violations
from jaxid.loop.scenarios import Scenarios
from jaxid.loop.sensors import Encoder, IdealSensor, Sensor
from jaxid.motion.limits import shrunk
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.motion.violation import Prediction
from jaxid.regression.worst_case import Norm, individual
from jaxid.search.problem import Objective, Problem

_BLEND = 0.005  # m/s, about the change of speed in one sample period


def encoder() -> Encoder:
    """Return the encoder of the motor.

    It is not a constant, which would be created before `configure`, in float32.
    """
    return Encoder(motor.ENCODER_RESOLUTION)


@dataclass(frozen=True)
class Case:
    """The design problem of one experiment.

    Attributes:
        setting: axis, controller and filter.
        parameter: name of the parameter that the experiment is designed for.
        horizon: horizon N_i; the motion lasts 2·N_i·T.
        motions: folder with the trajectories of the study.
        toy: whether to search with minimal effort, for one repetition of the motion and two plants.
    """

    setting: Setting
    parameter: str
    horizon: int
    motions: Path = Path("figures")
    toy: bool = False

    @property
    def intervals(self) -> int:
        """The number of intervals of constant jerk."""
        return Cell(self.parameter, self.horizon).intervals

    @property
    def ticks(self) -> int:
        """The number of sample periods of one motion."""
        return round(self.intervals * motor.KNOT_PERIOD / motor.CONTROL_PERIOD)

    @property
    def index(self) -> int:
        """The index of the parameter in θ."""
        return motor.system().index(self.parameter)

    @property
    def norm(self) -> Norm:
        """The norm of the estimation error: the error of the parameter alone."""
        return individual(self.index, len(motor.system().names))

    @property
    def speed(self) -> float:
        """The largest permitted velocity, m/s."""
        return float(motor.limits().velocity[1])

    @cached_property
    def plants(self) -> Scenarios:
        """The plants that must keep the limits, and over which the worst case is taken."""
        plants = self.setting.plants(self.ticks)
        return plants[np.arange(2)] if self.toy else plants

    def loop(self, sensor: Sensor, substeps: int = 1) -> ClosedLoop:
        """Return the closed loop of the experiment, with the controller of the setting."""
        law, period = self.setting.controller(), motor.CONTROL_PERIOD
        return ClosedLoop(law, sensor, period, self.ticks, 1 if self.toy else PERIODS, substeps)

    def criterion(self, period: float = motor.CONTROL_PERIOD) -> FilteredError:
        """Return the criterion log J_f for records with a given sample period, s."""
        return FilteredError(self.norm, self.setting.bandwidth, period)

    def planned(self) -> PlannedError:
        """Return the objective log J* of the desired motion."""
        return PlannedError(self.setting.system(), self.norm, self.speed, 64)

    def aware(self) -> PerfectTracking:
        """Return the objective log J_f of an axis that follows the motion exactly."""
        repeats = 1 if self.toy else PERIODS
        system, period = self.setting.system(), motor.CONTROL_PERIOD
        return PerfectTracking(system, self.criterion(), self.speed, period, self.ticks, repeats)

    def through(self, scenarios: Scenarios) -> ThroughLoop:
        """Return the objective log J_f of the closed loop, the largest one of some plants."""
        loop = self.loop(IdealSensor())
        return ThroughLoop(loop, scenarios, self.criterion(), self.speed, _BLEND)

    def problem(self, objective: Objective, axis: Prediction, room: Array) -> Problem:
        """Return the design problem with the limits of the axis itself.

        Args:
            objective: objective to minimise.
            axis: prediction of the axis.
            room: margins to the limits of position, velocity and input, in half-widths of the
                limit.
        """
        return Problem(objective, shrunk(self.setting.limits(), room), motor.boundary(), axis)

    def axis(self, sensor: Sensor) -> SampledPlants:
        """Return the prediction of the axis by simulations of the plants."""
        return SampledPlants(self.loop(sensor), self.plants)

    def beyond(self, sensor: Sensor, motion: JerkTrajectory) -> Array:
        """Return by how much each plant exceeds its limits of position, velocity and input.

        Values are in half-widths of the limit; a value ≤ 0 means that the plant keeps the limit.
        """
        return plant_violations(self.loop(sensor), self.plants, self.setting.limits(), motion)[
            :, :3
        ]


class Worth(NamedTuple):
    """The evaluation of one motion for the parameter of a case, in the unit of the parameter.

    Attributes:
        J_star: J* of the desired motion.
        J_aware: J_f of an axis that follows the motion exactly.
        J_f: J_f of the nominal closed loop with an exact sensor.
        J_f_worst: largest J_f of all plants of the setting, with an exact sensor.
        beyond: largest excess of a limit by any of these plants with the encoder, in half-widths of
            the limit; ≤ 0 if all keep their limits.
    """

    J_star: float
    J_aware: float
    J_f: float
    J_f_worst: float
    beyond: float


def worth(case: Case, motion: JerkTrajectory) -> Worth:
    """Return the errors of a motion, and by how much the axis exceeds its limits."""
    return Worth(
        value(case.planned(), motion),
        value(case.aware(), motion),
        value(case.through(case.setting.nominal()), motion),
        value(case.through(case.plants), motion),
        float(jnp.max(case.beyond(encoder(), motion))),
    )


def value(objective: Objective, motion: JerkTrajectory) -> float:
    """Return the exact error of a motion, where the objective is the log of it."""
    return float(np.exp(_exact(objective, motion)))


@eqx.filter_jit
def _exact(objective: Objective, motion: JerkTrajectory) -> jax.Array:
    return objective(motion, jnp.zeros(()))
