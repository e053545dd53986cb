"""The log that a motion can be expected to leave, before it is run: what designs are made for.

An axis in the middle of its box, undisturbed, stands for all of them: the weights that guarantee
most hardly depend on where in the box the axis is, or on what disturbs it.
"""

import abc

import equinox as eqx
import jax.numpy as jnp

from jaxid._types import Scalar, as_array, dot
from jaxid.loop.closed_loop import ClosedLoop, closed_loop
from jaxid.loop.controllers import Controller
from jaxid.loop.disturbances import NoDisturbance
from jaxid.loop.log import Log, whole
from jaxid.loop.sensors import IdealSensor
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant
from jaxid.model.system import System
from jaxid.motion.trajectory import JerkTrajectory, States, ticks_of


class NominalLog(eqx.Module):
    """A log, as a differentiable function of the motion that leaves it."""

    @abc.abstractmethod
    def __call__(self, trajectory: JerkTrajectory) -> tuple[Log, States]:
        """The log, its positions exact, and the states of the axis half-way through each tick."""


class ExactTracking(NominalLog):
    """Of an axis that follows its reference exactly.

    Attributes:
        system: for the middle of its box.
        period: of the servo, s.
        resolution: of the encoder, m or rad.
        count: of ticks of the longest motion.
    """

    system: System
    period: Scalar = eqx.field(converter=as_array("period"))
    resolution: Scalar = eqx.field(converter=as_array("resolution"))
    count: int = eqx.field(static=True)

    def __call__(self, trajectory: JerkTrajectory) -> tuple[Log, States]:
        h = self.period
        position = trajectory.states(jnp.arange(self.count + 1) * h).position
        ticks = ticks_of(trajectory, h, self.count)
        states = ticks.held(trajectory.states((jnp.arange(self.count) + 0.5) * h))
        input = dot(self.system.regressors(*states), self.system.centre)
        return Log(input, position, h, self.resolution, _count=ticks.count), states


class ClosedLoopTracking(NominalLog):
    """Of an axis in a closed loop.

    Attributes:
        loop: with an `IdealSensor`, since steps of an encoder have no slope.
        plant: in the middle of its box.
        resolution: of the encoder that the log is kept with, m or rad.
    """

    loop: ClosedLoop
    plant: Plant
    resolution: Scalar = eqx.field(converter=as_array("resolution"))

    def __call__(self, trajectory: JerkTrajectory) -> tuple[Log, States]:
        record, signals = self.loop(self.plant, trajectory)
        ends = signals.position, signals.velocity
        position, velocity = (x[:: self.loop.substeps] for x in ends)
        y, v = ((x[:-1] + x[1:]) / 2 for x in (position, velocity))
        count = self.loop.ticks_of(trajectory).total
        log = Log(signals.input, position, self.loop.period, self.resolution, _count=count)
        return log, States(y, v, record.rows.columns[0])


def nominal_log_model(
    system: System,
    trajectory: JerkTrajectory,
    servo: Servo,
    controller: Controller | None = None,
) -> NominalLog:
    """The nominal log as a differentiable function of motions as long as this one, or shorter.

    The arguments are those of `nominal_log`.
    """
    count = servo.ticks(trajectory)
    if controller is None:
        return ExactTracking(system, servo.period, servo.resolution, count)
    loop = closed_loop(controller, servo, trajectory, sensor=IdealSensor())
    return ClosedLoopTracking(loop, Plant(system, system.centre, NoDisturbance()), servo.resolution)


def nominal_log(
    system: System,
    trajectory: JerkTrajectory,
    servo: Servo,
    controller: Controller | None = None,
) -> Log:
    """The log that a motion leaves on an undisturbed axis in the middle of its prior box.

    Args:
        system: with the prior box.
        trajectory: the motion.
        servo: sample period and resolution of the log.
        controller: whose closed loop is expected; default an axis that follows the motion exactly.

    Raises:
        ValueError: if the period does not divide the motion into two periods or more.
    """
    return _log(nominal_log_model(system, trajectory, servo, controller), trajectory)


@eqx.filter_jit
def _log(model: NominalLog, trajectory: JerkTrajectory) -> Log:
    return whole(model(trajectory)[0])  # as long as the motion that the model is for
