"""Five ways to design one experiment: by (18), for J*, for J_f, through the loop, for the worst.

All but the first keep the limits of the axis itself, for every plant of the setting with an exact
sensor: the objective sees an exact one, because steps of an encoder have no slope.
"""

import contextlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from experiments.linear_motor.designs import TOY, Cell
from experiments.linear_motor.runs import PERIODS
from experiments.linear_motor.settings import STUDY, Setting
from jaxid import linear_motor as motor
from jaxid.admissible import inside
from jaxid.axis_conditions import Frozen, frozen, perfect
from jaxid.bound import Norm, individual
from jaxid.design import Effort as SearchEffort
from jaxid.design import design
from jaxid.experiment import design_motion
from jaxid.limits import Limits, Prediction, shrunk
from jaxid.loop import Loop, Sampled, Scenarios, excesses
from jaxid.objective import FilteredError, PerfectTracking, PlannedError, ThroughLoop
from jaxid.problem import Objective, Problem, Task
from jaxid.refine import Effort, refine
from jaxid.sensing import Encoder, IdealSensor, Sensor
from jaxid.trajectory import JerkTrajectory

Motions = dict[str, JerkTrajectory]
_SEED = 0  # of the cold searches
_SPARE = 1e-3  # half-widths of every limit, kept by both sides of the comparison
_COARSE = 0.001  # s: ticks of the cold search through the filter
_BLEND = 0.005  # m/s, about what the speed changes by in a tick
_EFFORT = Effort(rounds=4)  # of every refinement: eight rounds found nothing better
_ACTIVE, _RENEWED = 8, 2  # plants in a search for the worst, and how often they are chosen


@dataclass(frozen=True)
class Case:
    """One experiment to design.

    Attributes:
        setting: the axis and its filter.
        parameter: that the experiment is for.
        horizon: N_i.
        toy: search hardly at all.
    """

    setting: Setting
    parameter: str
    horizon: int
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
        return _some(plants, np.arange(2)) if self.toy else plants

    def loop(self, sensor: Sensor) -> Loop:
        """The experiment of the study with the law of the setting."""
        law, period = self.setting.controller(), motor.CONTROL_PERIOD
        return Loop(law, sensor, period, self.ticks, 1 if self.toy else PERIODS)

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

    def problem(self, objective: Objective, axis: Prediction | None = None) -> Problem:
        """With the limits of the axis itself, by default what the plants do."""
        limits = shrunk(self.setting.limits(), jnp.full(3, _SPARE))
        axis = axis or Sampled(self.loop(IdealSensor()), self.plants)
        return Problem(objective, limits, motor.boundary(), axis)


class Errors(NamedTuple):
    """Of one motion for the parameter of a case.

    Attributes:
        planned: J*, on the desired motion.
        nominal: J_f of the nominal closed loop.
        worst: the largest J_f of the plants of the setting.
        beyond: half-widths by which the worst of these plants leaves a limit, exact sensor.
        beyond_encoder: the same with the encoder.
    """

    planned: float
    nominal: float
    worst: float
    beyond: float
    beyond_encoder: float


def errors(case: Case, motion: JerkTrajectory) -> Errors:
    """What a motion is worth, and whether the axis keeps its limits."""

    def beyond(sensor: Sensor) -> float:
        found = excesses(case.loop(sensor), case.plants, case.setting.limits(), motion)
        return float(jnp.max(found))

    return Errors(
        _value(case.planned(), motion),
        _value(case.through(case.setting.nominal()), motion),
        _value(case.through(case.plants), motion),
        beyond(IdealSensor()),
        beyond(Encoder(motor.ENCODER_RESOLUTION)),
    )


def by_18(case: Case, motions: Motions) -> JerkTrajectory:
    """The paper's way: J* under (18). The axis may leave its limits."""
    if case.setting.label == STUDY.label and "table_1" in motions:
        return motions["table_1"]
    return _cold(case, case.setting.limits_by_18(), None)


def two_stage(case: Case, motions: Motions) -> JerkTrajectory:
    """J*, then the experiment: from the design by (18) and from a cold search."""
    axis = _still(case, motions["by_18"])
    found = _cold(case, case.setting.limits(), axis)
    return _refined(case, case.planned(), [motions["by_18"], found])


def filter_aware(case: Case, motions: Motions) -> JerkTrajectory:
    """J_f of perfect tracking: from the two-stage design and from a cold search of its own."""
    axis, system = _still(case, motions["by_18"]), case.setting.system()
    task = _task(case, case.setting.limits(), axis)
    count = round(case.intervals * motor.KNOT_PERIOD / _COARSE)
    coarse = PerfectTracking(system, case.criterion(_COARSE), case.speed, _COARSE, count)
    found = design(coarse, task, _key(case), effort=_search_effort(case))
    return _refined(case, case.aware(), [motions["two_stage"], found.trajectory])


def end_to_end(case: Case, motions: Motions) -> JerkTrajectory:
    """J_f of the nominal closed loop, from the better of the two before."""
    objective = case.through(case.setting.nominal())
    begin = _least(objective, [motions["two_stage"], motions["filter_aware"]])
    return _refined(case, objective, [begin])


def robust(case: Case, motions: Motions) -> JerkTrajectory:
    """The worst J_f of all plants, from the best of those before.

    Few plants are ever the worst: only those are in the objective that came nearest to it on a
    motion so far.
    """
    whole = case.through(case.plants)
    best = _least(whole, [motions[name] for name in ("two_stage", "filter_aware", "end_to_end")])
    nearest = np.full(case.plants.theta.shape[0], -np.inf)
    for _ in range(1 if case.toy else _RENEWED):
        values = np.asarray(_each(whole, best))
        nearest = np.maximum(nearest, values - values.max())
        part = case.through(_some(case.plants, np.argsort(-nearest)[:_ACTIVE]))
        better = _least(whole, [best, _refined(case, part, [best])])
        if better is best:
            break
        best = better
    return best


STAGES: dict[str, Callable[[Case, Motions], JerkTrajectory]] = {
    "by_18": by_18,
    "two_stage": two_stage,
    "filter_aware": filter_aware,
    "end_to_end": end_to_end,
    "robust": robust,
}


def _cold(case: Case, limits: Limits, axis: Frozen | None) -> JerkTrajectory:
    task, effort = _task(case, limits, axis), _search_effort(case)
    system, key = case.setting.system(), _key(case)
    return design_motion(system, task, case.parameter, key, effort=effort).trajectory


def _task(case: Case, limits: Limits, axis: Frozen | None) -> Task:
    return Task(limits, motor.boundary(), case.intervals, motor.KNOT_PERIOD, axis)


def _still(case: Case, motion: JerkTrajectory) -> Frozen:
    """An axis for cold searches: the most that the real one adds to a motion, at all times.

    Or as much of it as leaves room for any motion: refinement sees what is really added.
    """
    problem = case.problem(case.planned())
    assert problem.axis is not None
    added = frozen(problem.axis, problem.limits, motion).added
    y, v, u, _ = (float(jnp.max(jnp.maximum(-x.lower, x.upper))) for x in added)
    for share in (1.0, 0.7, 0.4):
        margins = (share * y, share * v, share * u, 0.0)
        axis = perfect(case.setting.system(), 5 * case.intervals, margins)
        with contextlib.suppress(ValueError):
            inside(case.problem(case.planned(), axis), case.intervals, motor.KNOT_PERIOD)
            return axis
    return perfect(case.setting.system(), 5 * case.intervals, (0.0, 0.0, 0.0, 0.0))


def _refined(case: Case, objective: Objective, starts: Iterable[JerkTrajectory]) -> JerkTrajectory:
    effort = Effort(rounds=1, steps=2, polish_steps=2) if case.toy else _EFFORT
    problem = case.problem(objective)
    found = [refine(problem, start, effort) for start in starts]
    return min(found, key=lambda refined: refined.value).trajectory


def _least(objective: Objective, motions: list[JerkTrajectory]) -> JerkTrajectory:
    return min(motions, key=lambda motion: _value(objective, motion))


def _value(objective: Objective, motion: JerkTrajectory) -> float:
    """The error itself, not its log."""
    return float(np.exp(_exact(objective, motion)))


@eqx.filter_jit
def _exact(objective: Objective, motion: JerkTrajectory) -> jax.Array:
    return objective(motion, jnp.zeros(()))


@eqx.filter_jit
def _each(objective: ThroughLoop, motion: JerkTrajectory) -> jax.Array:
    return objective.each(motion, jnp.zeros(()))


def _some(plants: Scenarios, chosen: Int[np.ndarray, " k"]) -> Scenarios:
    items = plants.theta, plants.disturbance
    return Scenarios(plants.system, *jax.tree.map(lambda x: x[chosen], items))


def _key(case: Case) -> jax.Array:
    key = jax.random.fold_in(jax.random.key(_SEED), case.horizon)
    return jax.random.fold_in(key, case.index)


def _search_effort(case: Case) -> SearchEffort:
    return TOY if case.toy else SearchEffort()
