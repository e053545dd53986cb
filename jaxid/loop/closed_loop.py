"""The closed loop as a function of the motion and the plant."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._types import Motion, Scalar, as_array
from jaxid.loop.controllers import Controller
from jaxid.loop.experiment import Run, simulated
from jaxid.loop.record import Record
from jaxid.loop.scenarios import Scenarios
from jaxid.loop.sensors import Sensor
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant, Signals, simulate
from jaxid.model.interval_arithmetic import Range, exactly
from jaxid.model.system import System
from jaxid.motion.limits import Limits
from jaxid.motion.ticks import Ticks
from jaxid.motion.trajectory import JerkTrajectory, reference, ticks_of
from jaxid.motion.violation import Envelope, Prediction, axis_violations


class ClosedLoop(eqx.Module):
    """A simulated experiment as a function of the plant and the motion.

    Attributes:
        controller: controller of the axis.
        sensor: sensor that the controller reads.
        period: sample period of the controller, s.
        ticks: number of samples of the longest motion. For a shorter motion, the remaining rows of
            the record have zero measure, and the remaining signals keep their last values.
        repeats: number of times that the motion is run, back to back, from rest.
        substeps: number of Runge-Kutta steps per sample period.
    """

    controller: Controller
    sensor: Sensor
    period: Scalar = eqx.field(converter=as_array("period"))
    ticks: int = eqx.field(static=True)
    repeats: int = eqx.field(static=True, default=1)
    substeps: int = eqx.field(static=True, default=1)

    def __call__(self, plant: Plant, trajectory: JerkTrajectory) -> tuple[Record, Signals]:
        """Return the record and the signals of a motion that is run on a plant."""
        desired = reference(trajectory, self.period, self.ticks, self.repeats)
        found = simulate(plant, self.controller, self.sensor, desired, self.period, self.substeps)
        return _within(self.ticks_of(trajectory), self.substeps, *found)

    def ticks_of(self, trajectory: JerkTrajectory) -> Ticks:
        """Return the number of samples of a motion, for arrays of this loop's length."""
        return ticks_of(trajectory, self.period, self.ticks, self.repeats)


@eqx.filter_jit
def _within(
    ticks: Ticks, substeps: int, record: Record, signals: Signals
) -> tuple[Record, Signals]:
    """Return the record and signals with everything after the last sample of the motion held."""
    steps = ("time", "position", "velocity")
    held = {name: ticks.held(getattr(signals, name), substeps, first=1) for name in steps}
    others = {name: ticks.held(x) for name, x in signals._asdict().items() if name not in steps}
    return record.only(ticks.counted), Signals(**held, **others)


class SampledPlants(Prediction):
    """A prediction of the axis from simulations of some plants; for other plants it proves nothing.

    Attributes:
        loop: closed loop that the plants are simulated in.
        scenarios: plants, with their disturbances.
    """

    loop: ClosedLoop
    scenarios: Scenarios

    @property
    def system(self) -> System:
        """The system of all plants."""
        return self.scenarios.system

    def __call__(self, trajectory: JerkTrajectory) -> Envelope:
        """Return the ranges over all plants, repeats and Runge-Kutta steps, one per sample."""
        return _envelope(self.loop, self.scenarios, trajectory)


@eqx.filter_jit
def plant_violations(
    loop: ClosedLoop, scenarios: Scenarios, limits: Limits, trajectory: JerkTrajectory
) -> Float[Array, "k sides"]:
    """Return by how much each simulated plant exceeds each limit at worst, in half-widths.

    A value ≤ 0 means that the plant keeps the limit; a plant whose loop diverges has inf.

    Args:
        loop: closed loop.
        scenarios: k plants, with their disturbances.
        limits: limits of the axis.
        trajectory: motion.

    Returns:
        Array of shape (k, sides), its columns in the order of `axis_violations`.
    """

    def worst(plant: Plant) -> Float[Array, " sides"]:
        columns = _columns(loop, plant, trajectory)
        sides = axis_violations(limits, Envelope(*map(exactly, columns)))
        return jnp.stack([jnp.max(side) for side in sides])

    return scenarios.map(worst)


@eqx.filter_jit
def _envelope(loop: ClosedLoop, scenarios: Scenarios, trajectory: JerkTrajectory) -> Envelope:
    ticks = loop.ticks_of(trajectory)

    def extremes(values: Float[Array, "k n"]) -> Range:
        # per sample of the motion: over plants, repeats and steps within the sample period
        by_tick = values.reshape(values.shape[0], loop.repeats * loop.ticks, -1)
        apart = jax.vmap(ticks.by_repeat)(by_tick)
        lost = jnp.isnan(apart)  # the range of a diverged loop is unbounded
        lower, upper = (jnp.where(lost, end, apart) for end in (-jnp.inf, jnp.inf))
        return Range(jnp.min(lower, (0, 1, 3)), jnp.max(upper, (0, 1, 3)))

    return Envelope(*map(extremes, scenarios.map(lambda p: _columns(loop, p, trajectory))))


def _columns(loop: ClosedLoop, plant: Plant, trajectory: JerkTrajectory) -> tuple[Motion, ...]:
    """Return position and velocity after every step, and input and its rate at every sample."""
    signals = loop(plant, trajectory)[1]
    rate = jnp.diff(signals.input, prepend=jnp.zeros(1)) / loop.period
    rate = loop.ticks_of(trajectory).held(rate)
    return signals.position[1:], signals.velocity[1:], signals.input, rate


def run(
    plant: Plant,
    controller: Controller,
    servo: Servo,
    trajectory: JerkTrajectory,
    *,
    sensor: Sensor | None = None,
    repeats: int = 1,
    substeps: int = 1,
) -> Run:
    """Simulate one experiment: a motion that is tracked in closed loop.

    Args:
        plant: true axis: parameters and disturbance.
        controller: controller; its commands act after the delay of the servo.
        servo: sample period, encoder resolution and delay.
        trajectory: motion; its duration is a whole number of sample periods.
        sensor: sensor that the controller reads; default the encoder of the servo.
        repeats: number of times that the motion is run, back to back, from rest.
        substeps: number of Runge-Kutta steps per sample period.

    Returns:
        `Run(record, signals, log)`: exact regression rows, true states and inputs over time, and
        the log that the encoder records.

    Raises:
        ValueError: if the motion does not last a whole number of sample periods, two at least, or
            the closed loop diverges.

    Example:
        >>> plant = jd.Plant(slide, (7.0, 20.0, 15.0), NoDisturbance())
        >>> controller = jd.PDFeedforward(slide, slide.centre, kp=5000.0, kd=300.0)
        >>> record, signals, log = jd.run(plant, controller, servo, motion)
        >>> log.position.size
        601
    """
    return simulated(plant, controller, servo, trajectory, sensor, repeats, substeps)


def closed_loop(
    controller: Controller,
    servo: Servo,
    trajectory: JerkTrajectory,
    *,
    sensor: Sensor | None = None,
    repeats: int = 1,
    substeps: int = 1,
) -> ClosedLoop:
    """Return a simulated experiment as a function of the plant and the motion.

    Args:
        controller: controller; its commands act after the delay of the servo.
        servo: sample period, encoder resolution and delay.
        trajectory: longest motion that will be run.
        sensor: sensor that the controller reads; default the encoder of the servo.
        repeats: number of times that the motion is run, back to back, from rest.
        substeps: number of Runge-Kutta steps per sample period.

    Raises:
        ValueError: if the motion does not last a whole number of sample periods, two at least.
    """
    return ClosedLoop(
        servo.delayed(controller),
        servo.sensor if sensor is None else sensor,
        servo.period,
        servo.ticks(trajectory),
        repeats,
        substeps,
    )
