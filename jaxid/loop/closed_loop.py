"""The closed loop as a function of the motion, and the plants that it may meet."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxid._checks import require_float64
from jaxid._types import Motion, Scalar, as_array
from jaxid.loop.controllers import Controller
from jaxid.loop.disturbances import Disturbance
from jaxid.loop.log import Log
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
    """An experiment but for its motion and its plant.

    Attributes:
        controller: any feedback law.
        sensor: what the controller sees.
        period: of the controller, s.
        ticks: of the longest motion. Rows of a shorter one that stand for none of its ticks have no
            measure, and its signals stay there what they were in its last tick.
        repeats: how many times the motion is run, back to back, from rest.
        substeps: Runge-Kutta steps per tick.
    """

    controller: Controller
    sensor: Sensor
    period: Scalar = eqx.field(converter=as_array("period"))
    ticks: int = eqx.field(static=True)
    repeats: int = eqx.field(static=True, default=1)
    substeps: int = eqx.field(static=True, default=1)

    def __call__(self, plant: Plant, trajectory: JerkTrajectory) -> tuple[Record, Signals]:
        """Run the motion on a plant."""
        desired = reference(trajectory, self.period, self.ticks, self.repeats)
        found = simulate(plant, self.controller, self.sensor, desired, self.period, self.substeps)
        return _within(self.ticks_of(trajectory), self.substeps, *found)

    def ticks_of(self, trajectory: JerkTrajectory) -> Ticks:
        """Which ticks are those of a motion."""
        return ticks_of(trajectory, self.period, self.ticks, self.repeats)


@eqx.filter_jit
def _within(
    ticks: Ticks, substeps: int, record: Record, signals: Signals
) -> tuple[Record, Signals]:
    """What there is until the end of the last tick."""
    steps = ("time", "position", "velocity")
    held = {name: ticks.held(getattr(signals, name), substeps, first=1) for name in steps}
    others = {name: ticks.held(x) for name, x in signals._asdict().items() if name not in steps}
    return record.only(ticks.counted), Signals(**held, **others)


class SampledPlants(Prediction):
    """What some plants do along a motion: evidence, no proof for the others.

    Attributes:
        loop: that they are in.
        scenarios: the plants.
    """

    loop: ClosedLoop
    scenarios: Scenarios

    @property
    def system(self) -> System:
        return self.scenarios.system

    def __call__(self, trajectory: JerkTrajectory) -> Envelope:
        """The lowest and highest over plants, repeats and Runge-Kutta steps."""
        return _envelope(self.loop, self.scenarios, trajectory)


@eqx.filter_jit
def plant_violations(
    loop: ClosedLoop, scenarios: Scenarios, limits: Limits, trajectory: JerkTrajectory
) -> Float[Array, "k sides"]:
    """How far each plant is beyond each limit, at worst, in half-widths; ≤ 0 keeps it.

    The sides are those of `axis_violations`. A plant whose loop diverges is beyond all limits.
    """

    def worst(item: tuple[Array, Disturbance]) -> Float[Array, " sides"]:
        columns = _columns(loop, Plant(scenarios.system, *item), trajectory)
        sides = axis_violations(limits, Envelope(*map(exactly, columns)))
        return jnp.stack([jnp.max(side) for side in sides])

    # in batches: all signals of all plants at once would fill the memory
    return jax.lax.map(worst, (scenarios.theta, scenarios.disturbance), batch_size=16)


@eqx.filter_jit
def _envelope(loop: ClosedLoop, scenarios: Scenarios, trajectory: JerkTrajectory) -> Envelope:
    ticks = loop.ticks_of(trajectory)

    def extremes(values: Float[Array, "k n"]) -> Range:
        # at each tick of the motion: over plants, repeats and the steps within the tick
        by_tick = values.reshape(values.shape[0], loop.repeats * loop.ticks, -1)
        apart = jax.vmap(ticks.by_repeat)(by_tick)
        lost = jnp.isnan(apart)  # a loop that diverged may be anywhere
        lower, upper = (jnp.where(lost, end, apart) for end in (-jnp.inf, jnp.inf))
        return Range(jnp.min(lower, (0, 1, 3)), jnp.max(upper, (0, 1, 3)))

    return Envelope(*map(extremes, scenarios.map(lambda p: _columns(loop, p, trajectory))))


def _columns(loop: ClosedLoop, plant: Plant, trajectory: JerkTrajectory) -> tuple[Motion, ...]:
    """Position and velocity after every step; input and its rate at every tick."""
    signals = loop(plant, trajectory)[1]
    rate = jnp.diff(signals.input, prepend=jnp.zeros(1)) / loop.period
    rate = loop.ticks_of(trajectory).held(rate)
    return signals.position[1:], signals.velocity[1:], signals.input, rate


class Run(NamedTuple):
    """One simulated experiment.

    Attributes:
        record: exact rows of u = φᵀθ + Δ, one per servo period, and their inputs.
        signals: what the axis did.
        log: what the servo records of it.
    """

    record: Record
    signals: Signals
    log: Log


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
    """Simulate one experiment: a motion, tracked in closed loop, and its log.

    Args:
        plant: the true axis.
        controller: any feedback law; its commands act after the delay of the servo.
        servo: sample period, encoder and delay.
        trajectory: the motion; its duration is a whole number of periods.
        sensor: what the controller measures; default the encoder of the servo.
        repeats: how often the motion is run, back to back, from rest.
        substeps: Runge-Kutta steps per period.

    Raises:
        ValueError: if the period does not divide the duration of the motion.

    Example:
        >>> plant = jd.Plant(slide, (7.0, 20.0, 15.0), NoDisturbance())
        >>> controller = jd.PDFeedforward(slide, slide.centre, kp=5000.0, kd=300.0)
        >>> record, signals, log = jd.run(plant, controller, servo, motion)
        >>> log.position.size
        601
    """
    require_float64(plant=plant, controller=controller, servo=servo, trajectory=trajectory)
    loop = closed_loop(
        controller, servo, trajectory, sensor=sensor, repeats=repeats, substeps=substeps
    )
    record, signals = loop(plant, trajectory)
    return Run(record, signals, servo.log(signals))


def closed_loop(
    controller: Controller,
    servo: Servo,
    trajectory: JerkTrajectory,
    *,
    sensor: Sensor | None = None,
    repeats: int = 1,
    substeps: int = 1,
) -> ClosedLoop:
    """The experiment as a function of the plant and of motions as long as this one."""
    return ClosedLoop(
        servo.delayed(controller),
        servo.sensor if sensor is None else sensor,
        servo.period,
        servo.ticks(trajectory),
        repeats,
        substeps,
    )
