"""One experiment to design: its objectives, its limits, and what a motion is worth in it."""

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

_BLEND = 0.005  # m/s, about what the speed changes by in a tick


def encoder() -> Encoder:
    """That of the motor; a constant would be made before `configure`, in float32."""
    return Encoder(motor.ENCODER_RESOLUTION)


@dataclass(frozen=True)
class Case:
    """One experiment to design.

    Attributes:
        setting: the axis and its filter.
        parameter: that the experiment is for.
        horizon: N_i.
        motions: the folder with the trajectories of the study.
        toy: search hardly at all, for one period and two plants.
    """

    setting: Setting
    parameter: str
    horizon: int
    motions: Path = Path("figures")
    toy: bool = False

    @property
    def intervals(self) -> int:
        """Of constant jerk."""
        return Cell(self.parameter, self.horizon).intervals

    @property
    def ticks(self) -> int:
        """Of one motion."""
        return round(self.intervals * motor.KNOT_PERIOD / motor.CONTROL_PERIOD)

    @property
    def index(self) -> int:
        """Of the parameter."""
        return motor.system().index(self.parameter)

    @property
    def norm(self) -> Norm:
        """The error that counts."""
        return individual(self.index, len(motor.system().names))

    @property
    def speed(self) -> float:
        """The largest, m/s."""
        return float(motor.limits().velocity[1])

    @cached_property
    def plants(self) -> Scenarios:
        """That the limits must hold for, and that the worst is taken over."""
        plants = self.setting.plants(self.ticks)
        return plants[np.arange(2)] if self.toy else plants

    def loop(self, sensor: Sensor, substeps: int = 1) -> ClosedLoop:
        """The experiment of the study with the law of the setting."""
        law, period = self.setting.controller(), motor.CONTROL_PERIOD
        return ClosedLoop(law, sensor, period, self.ticks, 1 if self.toy else PERIODS, substeps)

    def criterion(self, period: float = motor.CONTROL_PERIOD) -> FilteredError:
        """Log J_f."""
        return FilteredError(self.norm, self.setting.bandwidth, period)

    def planned(self) -> PlannedError:
        """Log J*."""
        return PlannedError(self.setting.system(), self.norm, self.speed, 64)

    def aware(self) -> PerfectTracking:
        """Log J_f of an axis that follows exactly."""
        repeats = 1 if self.toy else PERIODS
        system, period = self.setting.system(), motor.CONTROL_PERIOD
        return PerfectTracking(system, self.criterion(), self.speed, period, self.ticks, repeats)

    def through(self, scenarios: Scenarios) -> ThroughLoop:
        """Log J_f of the closed loop, the worst of some plants."""
        loop = self.loop(IdealSensor())
        return ThroughLoop(loop, scenarios, self.criterion(), self.speed, _BLEND)

    def problem(self, objective: Objective, axis: Prediction, room: Array) -> Problem:
        """With the limits of the axis itself.

        Args:
            objective: to be minimised.
            axis: what it does.
            room: half-widths of position, velocity and input that are left unused.
        """
        return Problem(objective, shrunk(self.setting.limits(), room), motor.boundary(), axis)

    def axis(self, sensor: Sensor) -> SampledPlants:
        """What the plants do."""
        return SampledPlants(self.loop(sensor), self.plants)

    def beyond(self, sensor: Sensor, motion: JerkTrajectory) -> Array:
        """Half-widths by which each plant leaves its position, velocity and input limits."""
        return plant_violations(self.loop(sensor), self.plants, self.setting.limits(), motion)[
            :, :3
        ]


class Worth(NamedTuple):
    """Of one motion for the parameter of a case.

    Attributes:
        J_star: on the desired motion.
        J_aware: J_f of an axis that follows exactly.
        J_f: of the nominal closed loop, exact sensor.
        J_f_worst: the largest of the plants of the setting, exact sensor.
        beyond: half-widths by which the worst of these plants leaves a limit, with the encoder.
    """

    J_star: float
    J_aware: float
    J_f: float
    J_f_worst: float
    beyond: float


def worth(case: Case, motion: JerkTrajectory) -> Worth:
    """What a motion is worth, and whether the axis keeps its limits."""
    return Worth(
        value(case.planned(), motion),
        value(case.aware(), motion),
        value(case.through(case.setting.nominal()), motion),
        value(case.through(case.plants), motion),
        float(jnp.max(case.beyond(encoder(), motion))),
    )


def value(objective: Objective, motion: JerkTrajectory) -> float:
    """The error itself, not its log."""
    return float(np.exp(_exact(objective, motion)))


@eqx.filter_jit
def _exact(objective: Objective, motion: JerkTrajectory) -> jax.Array:
    return objective(motion, jnp.zeros(()))
