"""The nominal log of a motion, predicted before the motion is run; designs are evaluated with it.

It is the log of an undisturbed axis at the centre of the prior box. The optimal weights hardly
depend on the disturbance, or on the true parameters within the box.
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
    """Base class of predicted logs, as differentiable functions of the motion."""

    @abc.abstractmethod
    def __call__(self, trajectory: JerkTrajectory) -> tuple[Log, States]:
        """Return the log with exact positions, and the states in the middle of each sample."""


class ExactTracking(NominalLog):
    """The predicted log of an axis that follows its reference exactly.

    Attributes:
        system: axis; its parameters are those at the centre of the prior box.
        period: sample period of the servo, s.
        resolution: encoder resolution, m or rad.
        count: number of samples of the longest motion.
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
    """The predicted log of an axis in a simulated closed loop.

    Attributes:
        loop: closed loop with an `IdealSensor`, since an encoder cannot be differentiated.
        plant: undisturbed plant at the centre of the prior box.
        resolution: encoder resolution of the log, m or rad.
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
    """Return the predicted log as a differentiable function of the motion.

    Args:
        system: axis with its prior box.
        trajectory: longest motion that the function will be called with.
        servo: sample period, encoder resolution and delay.
        controller: controller of the closed loop; default an axis that follows the motion exactly.

    Raises:
        ValueError: if the motion does not last a whole number of sample periods, two at least.
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
    """Return the predicted log of a motion on an undisturbed axis at the centre of its prior box.

    Args:
        system: axis with its prior box.
        trajectory: motion.
        servo: sample period and encoder resolution of the log.
        controller: controller of the closed loop; default an axis that follows the motion exactly.

    Raises:
        ValueError: if the motion does not last a whole number of sample periods, two at least.
    """
    log, _ = modelled(nominal_log_model(system, trajectory, servo, controller), trajectory)
    return whole(log)  # the model was made for this motion: no padding


@eqx.filter_jit
def modelled(model: NominalLog, trajectory: JerkTrajectory) -> tuple[Log, States]:
    """Return a predicted log with its states, by one compiled function.

    Args:
        model: predicted log as a function of the motion.
        trajectory: motion.
    """
    return model(trajectory)
