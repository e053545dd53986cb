"""Five ways to design one experiment: by (18), for J*, for J_f, through the loop, for the worst.

All but the first keep the limits of the axis itself, for every plant of the setting with an exact
sensor: the objective sees an exact one, because steps of an encoder have no slope.
"""

import contextlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from experiments.linear_motor.designs import TOY, Cell, trajectory_path
from experiments.linear_motor.runs import PERIODS
from experiments.linear_motor.settings import Setting
from jaxid import linear_motor as motor
from jaxid.admissible import inside
from jaxid.axis_conditions import Frozen, frozen, perfect
from jaxid.bound import Norm, individual
from jaxid.design import Effort as SearchEffort
from jaxid.design import design
from jaxid.experiment import design_motion
from jaxid.files import read_trajectory
from jaxid.limits import Limits, Prediction, shrunk
from jaxid.loop import Loop, Sampled, Scenarios, excesses
from jaxid.objective import FilteredError, PerfectTracking, PlannedError, ThroughLoop
from jaxid.problem import Objective, Problem, Task
from jaxid.refine import Effort, refine
from jaxid.sensing import Encoder, IdealSensor, Sensor
from jaxid.trajectory import JerkTrajectory

Designs = Mapping[str, JerkTrajectory]
_SEED = 0  # of the cold searches
_SPARE = 1e-3  # half-widths of every limit, kept by both sides of the comparison
_COARSE = 0.001  # s: ticks of the cold search through the filter
_MOST = 0.9  # of the ticks
_BLEND = 0.005  # m/s, about what the speed changes by in a tick
_EFFORT = Effort(rounds=4, polish_steps=20)  # of every refinement
_ACTIVE = 8  # plants in a search for the worst


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


class Worth(NamedTuple):
    """Of one motion for the parameter of a case.

    Attributes:
        J_star: on the desired motion.
        J_f: of the nominal closed loop.
        J_f_worst: the largest of the plants of the setting.
        beyond: half-widths by which the worst of these plants leaves a limit, exact sensor.
        beyond_with_encoder: the same with the encoder.
    """

    J_star: float
    J_f: float
    J_f_worst: float
    beyond: float
    beyond_with_encoder: float


def worth(case: Case, motion: JerkTrajectory) -> Worth:
    """What a motion is worth, and whether the axis keeps its limits."""

    def beyond(sensor: Sensor) -> float:
        found = excesses(case.loop(sensor), case.plants, case.setting.limits(), motion)
        return float(jnp.max(found))

    return Worth(
        _value(case.planned(), motion),
        _value(case.through(case.setting.nominal()), motion),
        _value(case.through(case.plants), motion),
        beyond(IdealSensor()),
        beyond(Encoder(motor.ENCODER_RESOLUTION)),
    )


def by_18(case: Case, before: Designs) -> JerkTrajectory:
    """The paper's way: J* under (18). The axis may leave its limits."""
    if case.setting.planned_as_in_study:
        cell = Cell(case.parameter, case.horizon)
        return read_trajectory(trajectory_path(case.motions, cell))
    return _cold(case, case.setting.limits_by_18(), None)


def two_stage(case: Case, before: Designs) -> JerkTrajectory:
    """J*, then the experiment: from the design by (18) and from a cold search."""
    axis = _still(case, before["by_18"])
    found = _cold(case, case.setting.limits(), axis)
    return _refined(case, case.planned(), [before["by_18"], found])


def filter_aware(case: Case, before: Designs) -> JerkTrajectory:
    """J_f of perfect tracking: from the two-stage design, and from a cold search of its own.

    Or from the motion for another filter, where there is one.
    """
    other = before.get("filter_aware") or _cold_through_filter(case, before["by_18"])
    return _refined(case, case.aware(), [before["two_stage"], other])


def end_to_end(case: Case, before: Designs) -> JerkTrajectory:
    """J_f of the nominal closed loop, from the better of the two before."""
    objective = case.through(case.setting.nominal())
    begin = _least(objective, [before["two_stage"], before["filter_aware"]])
    return _refined(case, objective, [begin])


def robust(case: Case, before: Designs) -> JerkTrajectory:
    """The worst J_f of all plants, from the best of those before.

    Few plants are ever the worst: only those are in the objective that come nearest to it.
    """
    whole = case.through(case.plants)
    best = _least(whole, [before[name] for name in ("two_stage", "filter_aware", "end_to_end")])
    worst = np.argsort(-np.asarray(_each(whole, best)))[:_ACTIVE]
    return _least(whole, [best, _refined(case, case.through(_some(case.plants, worst)), [best])])


STAGES: dict[str, Callable[[Case, Designs], JerkTrajectory]] = {
    "by_18": by_18,
    "two_stage": two_stage,
    "filter_aware": filter_aware,
    "end_to_end": end_to_end,
    "robust": robust,
}
EFFORTS = (SearchEffort(), _EFFORT, _ACTIVE, _SEED)
FILTERED = ("filter_aware", "end_to_end", "robust")  # those that know the filter


def _cold(case: Case, limits: Limits, axis: Frozen | None) -> JerkTrajectory:
    task, effort = _task(case, limits, axis), _search_effort(case)
    system, key = case.setting.system(), _key(case)
    return design_motion(system, task, case.parameter, key, effort=effort).trajectory


def _cold_through_filter(case: Case, by_18: JerkTrajectory) -> JerkTrajectory:
    system, axis = case.setting.system(), _still(case, by_18)
    count = round(case.intervals * motor.KNOT_PERIOD / _COARSE)
    coarse = PerfectTracking(system, case.criterion(_COARSE), case.speed, _COARSE, count)
    task = _task(case, case.setting.limits(), axis)
    return design(coarse, task, _key(case), effort=_search_effort(case)).trajectory


def _task(case: Case, limits: Limits, axis: Frozen | None) -> Task:
    return Task(limits, motor.boundary(), case.intervals, motor.KNOT_PERIOD, axis)


def _still(case: Case, motion: JerkTrajectory) -> Frozen:
    """An axis for cold searches: what the real one adds to a motion at most ticks, at all times.

    Or as much of it as leaves room for any motion: refinement sees what is really added.
    """
    problem, system = case.problem(case.planned()), case.setting.system()
    assert problem.axis is not None
    added = frozen(problem.axis, problem.limits, motion).added
    usual = [float(jnp.quantile(jnp.maximum(-x.lower, x.upper), _MOST)) for x in added]
    for share in (1.0, 0.7, 0.4):
        y, v, u = (share * margin for margin in usual[:3])
        axis = perfect(system, 5 * case.intervals, (y, v, u, 0.0))
        with contextlib.suppress(ValueError):  # no room
            inside(case.problem(case.planned(), axis), case.intervals, motor.KNOT_PERIOD)
            return axis
    return perfect(system, 5 * case.intervals, (0.0, 0.0, 0.0, 0.0))


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
