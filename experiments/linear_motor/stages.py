"""Five ways to design one experiment: by (18), for J*, for J_f, through the loop, for the worst.

All but the first keep the limits of the axis itself, for every plant of the setting, encoder
included. The objectives see an exact sensor, because steps of an encoder have no slope.
"""

import contextlib
from collections.abc import Callable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from experiments.linear_motor.cases import Case, encoder, value
from experiments.linear_motor.designs import TOY, Cell, trajectory_path
from jaxid import linear_motor as motor
from jaxid.admissible import inside
from jaxid.axis_conditions import Frozen, frozen, perfect
from jaxid.design import Effort as SearchEffort
from jaxid.design import design
from jaxid.experiment import design_motion
from jaxid.files import read_trajectory
from jaxid.limits import Limits
from jaxid.objective import PerfectTracking, ThroughLoop
from jaxid.problem import Objective, Task
from jaxid.refine import Effort, refine
from jaxid.sensing import IdealSensor
from jaxid.trajectory import JerkTrajectory

Designs = Mapping[str, JerkTrajectory]
_SEED = 0  # of the cold searches
_COARSE = 0.001  # s: ticks of the cold search through the filter
_MOST = 0.9  # of the ticks
_SPARE = 1e-3  # half-widths of every limit
_EFFORT = Effort(rounds=4, polish_steps=20)  # of a refinement with an exact sensor
_LAST_EFFORT = Effort(rounds=0, polish_steps=5)  # and, after it, with the encoder
_TOY_EFFORT = Effort(rounds=1, steps=2, polish_steps=2)
_ACTIVE = 8  # plants in a search for the worst


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
    return _refined(case, case.planned(), before["by_18"], found)


def filter_aware(case: Case, before: Designs) -> JerkTrajectory:
    """J_f of perfect tracking: from the two-stage design, and from a cold search of its own.

    Or from the motion for another filter, where there is one.
    """
    other = before.get("filter_aware") or _cold_through_filter(case, before["by_18"])
    found = _refined(case, case.aware(), before["two_stage"], other)
    return _least(case.aware(), before["two_stage"], found)


def end_to_end(case: Case, before: Designs) -> JerkTrajectory:
    """J_f of the nominal closed loop, from the better of the two before."""
    objective = case.through(case.setting.nominal())
    best = _least(objective, before["two_stage"], before["filter_aware"])
    return _least(objective, best, _refined(case, objective, best))


def robust(case: Case, before: Designs) -> JerkTrajectory:
    """The worst J_f of all plants, from the best of those before.

    Few plants are ever the worst: only those are in the objective that come nearest to it.
    """
    whole = case.through(case.plants)
    best = _least(whole, *(before[name] for name in ("two_stage", "filter_aware", "end_to_end")))
    worst = np.argsort(-np.asarray(_each(whole, best)))[:_ACTIVE]
    return _least(whole, best, _refined(case, case.through(case.plants[worst]), best))


STAGES: dict[str, Callable[[Case, Designs], JerkTrajectory]] = {
    "by_18": by_18,
    "two_stage": two_stage,
    "filter_aware": filter_aware,
    "end_to_end": end_to_end,
    "robust": robust,
}
EFFORTS = (SearchEffort(), _EFFORT, _LAST_EFFORT, _ACTIVE, _SEED)
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
    system, limits = case.setting.system(), case.setting.limits()
    added = frozen(case.axis(encoder()), limits, motion).added
    usual = [float(jnp.quantile(jnp.maximum(-x.lower, x.upper), _MOST)) for x in added]
    for share in (1.0, 0.7, 0.4):
        y, v, u = (share * margin for margin in usual[:3])
        axis = perfect(system, 5 * case.intervals, (y, v, u, 0.0))
        with contextlib.suppress(ValueError):  # no room
            problem = case.problem(case.planned(), axis, jnp.zeros(3))
            inside(problem, case.intervals, motor.KNOT_PERIOD)
            return axis
    return perfect(system, 5 * case.intervals, (0.0, 0.0, 0.0, 0.0))


def _refined(case: Case, objective: Objective, *starts: JerkTrajectory) -> JerkTrajectory:
    """The best that is found from these starts.

    First with an exact sensor and room for what the encoder adds: its noise is another one for each
    motion, which a step cannot foresee. Then what is left, with the encoder itself.
    """
    effort = _TOY_EFFORT if case.toy else _EFFORT
    exact, real = case.axis(IdealSensor()), case.axis(encoder())
    found = []
    for start in starts:
        room = _SPARE + 1.1 * jnp.maximum(
            case.beyond(encoder(), start) - case.beyond(IdealSensor(), start), 0.0
        )
        near = refine(case.problem(objective, exact, room), start, effort).trajectory
        found.append(
            refine(case.problem(objective, real, jnp.full(3, 0.1 * _SPARE)), near, _LAST_EFFORT)
        )
    return min(found, key=lambda refined: refined.value).trajectory


def _least(objective: Objective, *motions: JerkTrajectory) -> JerkTrajectory:
    return min(motions, key=lambda motion: value(objective, motion))


@eqx.filter_jit
def _each(objective: ThroughLoop, motion: JerkTrajectory) -> jax.Array:
    return objective.each(motion, jnp.zeros(()))


def _key(case: Case) -> jax.Array:
    key = jax.random.fold_in(jax.random.key(_SEED), case.horizon)
    return jax.random.fold_in(key, case.index)


def _search_effort(case: Case) -> SearchEffort:
    return TOY if case.toy else SearchEffort()
