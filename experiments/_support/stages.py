"""Five ways to design one experiment: by (18), for J*, for J_f, through the loop, for the worst.

All but the first keep the limits of the axis itself, for every plant of the setting, encoder
included. The objectives see an exact sensor, because steps of an encoder have no slope.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from itertools import chain

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from experiments._support.cases import Case, encoder, value
from experiments.axes import linear_motor as motor
from experiments.paper.designs import TOY, Cell, trajectory_path
from jaxid.design.criteria import LeastSquaresError, PerfectTracking, ThroughLoop
from jaxid.design.optimal_motion import optimal_motion
from jaxid.io.files import read_trajectory
from jaxid.loop.closed_loop import SampledPlants
from jaxid.loop.sensors import IdealSensor
from jaxid.motion.limits import Limits
from jaxid.motion.task import Task
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.search.effort import Effort
from jaxid.search.frozen_loop import FrozenLoop, fixed_margins, freeze
from jaxid.search.local import improve
from jaxid.search.problem import Design, Objective, Problem
from jaxid.search.restoration import interior_motion

Designs = Mapping[str, JerkTrajectory]
_SEED = 0  # of the cold searches
_COARSE = 0.001  # s: ticks of the cold search through the filter
_MOST = 0.9  # of the ticks
_SPARE = 1e-3  # half-widths of every limit
# times what the encoder adds to the motion by (18): other designs needed 0.94 to 1.32
_NOISE = 1.3
_REPEATS, _SETTLED = 4, 5e-4  # refinements of one motion, and log J that is worth another
_ROUNDS = 5  # of more and more room
_EFFORT = Effort(newton_rounds=8, programs=20)  # of a refinement
_TOY_EFFORT = Effort(newton_rounds=1, newton_steps=2, programs=2)
_ACTIVE = 8  # plants in a search for the worst
_NEAREST = 16  # plants whose limits a search keeps


def by_18(case: Case, before: Designs) -> JerkTrajectory:
    """The paper's way: J* under (18). The axis may leave its limits."""
    if case.setting.planned_as_in_study:
        cell = Cell(case.parameter, case.horizon)
        return read_trajectory(trajectory_path(case.motions, cell))
    return _cold(case, case.setting.limits_by_18(), None)


def two_stage(case: Case, before: Designs) -> JerkTrajectory:
    """J*, then the experiment: from the design by (18), from a cold search, and from one for J_f.

    The last so that what `filter_aware` gains is not a better start.
    """
    paper, limits = before["by_18"], case.setting.limits()
    cold = _cold(case, limits, _still(case, paper))
    return _refined(case, paper, case.planned(), paper, cold, _cold_through_filter(case, paper))


def filter_aware(case: Case, before: Designs) -> JerkTrajectory:
    """J_f of perfect tracking: from the two-stage design, and from a cold search of its own.

    Or from the motion for another filter, where there is one.
    """
    other = before.get("filter_aware") or _cold_through_filter(case, before["by_18"])
    found = _refined(case, before["by_18"], case.aware(), before["two_stage"], other)
    return _least(case.aware(), before["two_stage"], found)


def end_to_end(case: Case, before: Designs) -> JerkTrajectory:
    """J_f of the nominal closed loop, from the better of the two before."""
    objective = case.through(case.setting.nominal())
    best = _least(objective, before["two_stage"], before["filter_aware"])
    return _least(objective, best, _refined(case, before["by_18"], objective, best))


def robust(case: Case, before: Designs) -> JerkTrajectory:
    """The worst J_f of all plants, from the best of those before.

    Few plants are ever the worst: only those are in the objective that come nearest to it.
    """
    whole = case.through(case.plants)
    best = _least(whole, *(before[name] for name in ("two_stage", "filter_aware", "end_to_end")))
    worst = np.argsort(-np.asarray(_each(whole, best)))[:_ACTIVE]
    found = _refined(case, before["by_18"], case.through(case.plants[worst]), best)
    return _least(whole, best, found)


STAGES: dict[str, Callable[[Case, Designs], JerkTrajectory]] = {
    "by_18": by_18,
    "two_stage": two_stage,
    "filter_aware": filter_aware,
    "end_to_end": end_to_end,
    "robust": robust,
}
EFFORTS = (Effort(), _EFFORT, _ACTIVE, _NEAREST, _SEED, _NOISE, _REPEATS, _SETTLED)
FILTERED = ("filter_aware", "end_to_end", "robust")  # those that know the filter


def _cold(case: Case, limits: Limits, axis: FrozenLoop | None) -> JerkTrajectory:
    task, effort = _task(case, limits, axis), _search_effort(case)
    system, key = case.setting.system(), _key(case)
    criterion = LeastSquaresError(system, case.parameter)
    return optimal_motion(task, criterion, key, effort=effort).trajectory


def _cold_through_filter(case: Case, by_18: JerkTrajectory) -> JerkTrajectory:
    system, axis = case.setting.system(), _still(case, by_18)
    count = round(case.intervals * motor.KNOT_PERIOD / _COARSE)
    coarse = PerfectTracking(system, case.criterion(_COARSE), case.speed, _COARSE, count)
    task = _task(case, case.setting.limits(), axis)
    return optimal_motion(task, coarse, _key(case), effort=_search_effort(case)).trajectory


def _task(case: Case, limits: Limits, axis: FrozenLoop | None) -> Task:
    return Task(limits, motor.boundary(), case.intervals, motor.KNOT_PERIOD, axis)


def _still(case: Case, motion: JerkTrajectory) -> FrozenLoop:
    """An axis for cold searches: what the real one adds to a motion at most ticks, at all times.

    Or as much of it as leaves room for any motion: refinement sees what is really added.
    """
    system, limits = case.setting.system(), case.setting.limits()
    added = freeze(case.axis(encoder()), limits, motion).added
    usual = [float(jnp.quantile(jnp.maximum(-x.lower, x.upper), _MOST)) for x in added]
    for share in (1.0, 0.7, 0.4):
        y, v, u = (share * margin for margin in usual[:3])
        axis = fixed_margins(system, 5 * case.intervals, (y, v, u, 0.0))
        with contextlib.suppress(ValueError):  # no room
            problem = case.problem(case.planned(), axis, jnp.zeros(3))
            interior_motion(problem, case.intervals, motor.KNOT_PERIOD)
            return axis
    return fixed_margins(system, 5 * case.intervals, (0.0, 0.0, 0.0, 0.0))


def _refined(
    case: Case, by_18: JerkTrajectory, objective: Objective, *starts: JerkTrajectory
) -> JerkTrajectory:
    """The best that is found from these starts.

    With an exact sensor and room for what the encoder adds, whose noise is another one for each
    motion: a step cannot foresee it. And with the plants that come nearest to a limit. Both are
    taken from the motion by (18), the same for all designs of a case; where with the encoder some
    plant still leaves a limit, also from what was found, and the search goes on.
    """
    effort, repeats = (_TOY_EFFORT, 0) if case.toy else (_EFFORT, _REPEATS)
    seen = [_seen(case, by_18)]
    for more in range(_ROUNDS):
        noise, nearness = (jnp.max(jnp.stack(part), axis=0) for part in zip(*seen, strict=True))
        room = _SPARE + (_NOISE + 0.1 * more) * noise
        nearest = case.plants[np.argsort(-nearness)[:_NEAREST]]
        axis = SampledPlants(case.loop(IdealSensor()), nearest)
        problem = case.problem(objective, axis, room)
        found = chain.from_iterable(
            _refinements(problem, start, effort, repeats) for start in starts
        )
        motions = [x.trajectory for x in sorted(found, key=lambda refined: refined.value)]
        for motion in motions:
            if jnp.max(case.beyond(encoder(), motion)) <= 0:
                return motion
        starts = (motions[0],)
        seen.append(_seen(case, motions[0]))
    raise ValueError(
        f"Argument `case`: with the encoder the axis of {case} leaves its limits even after "
        f"{_ROUNDS} searches with more and more room for it."
    )


def _refinements(
    problem: Problem, start: JerkTrajectory, effort: Effort, repeats: int
) -> Iterator[Design]:
    """Refined, and again at most `repeats` times while that gains what is worth a stage.

    What a later stage gains is then its objective's doing, not that of searching once more.
    """
    found = improve(problem, start, effort)
    yield found
    for _ in range(repeats):
        before, found = found, improve(problem, found.trajectory, effort)
        yield found
        if before.value - found.value < _SETTLED:
            break


def _seen(case: Case, motion: JerkTrajectory) -> tuple[jax.Array, jax.Array]:
    """What the encoder adds on each side, and how near each plant comes to the nearest one's."""
    exact, real = case.beyond(IdealSensor(), motion), case.beyond(encoder(), motion)
    noise = jnp.maximum(jnp.max(real, axis=0) - jnp.max(exact, axis=0), 0.0)
    return noise, jnp.max(exact - jnp.max(exact, axis=0), axis=1)


def _least(objective: Objective, *motions: JerkTrajectory) -> JerkTrajectory:
    return min(motions, key=lambda motion: value(objective, motion))


@eqx.filter_jit
def _each(objective: ThroughLoop, motion: JerkTrajectory) -> jax.Array:
    return objective.each(motion, jnp.zeros(()))


def _key(case: Case) -> jax.Array:
    key = jax.random.fold_in(jax.random.key(_SEED), case.horizon)
    return jax.random.fold_in(key, case.index)


def _search_effort(case: Case) -> Effort:
    return TOY if case.toy else Effort()
