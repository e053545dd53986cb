"""Five ways to design an experiment: by (18), for J*, J_f, the closed loop, the worst plant.

All but the first keep the limits of the axis itself, for every plant of the setting and with the
encoder. The objectives assume an exact sensor, since an encoder cannot be differentiated.
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
_SEED = 0  # of the searches with random starts
_COARSE = 0.001  # s: sample period of the search for J_f with random starts
_MOST = 0.9  # share of the samples whose deviations are covered
_SPARE = 1e-3  # half-widths: least margin to every limit
# margin for the encoder, relative to its effect on the motion by (18): other designs needed factors
# of 0.94 to 1.32
_NOISE = 1.3
_REPEATS, _SETTLED = 4, 5e-4  # most further refinements; gain of log J that justifies one
_ROUNDS = 5  # searches with increasing margins
_EFFORT = Effort(newton_rounds=8, programs=20)  # effort of a refinement
_TOY_EFFORT = Effort(newton_rounds=1, newton_steps=2, programs=2)
_ACTIVE = 8  # plants in the objective of a worst-case search
_NEAREST = 16  # plants that a search keeps within their limits


def by_18(case: Case, before: Designs) -> JerkTrajectory:
    """Return the motion of the paper: minimal J* within (18). The axis may exceed its limits."""
    if case.setting.planned_as_in_study:
        cell = Cell(case.parameter, case.horizon)
        return read_trajectory(trajectory_path(case.motions, cell))
    return _cold(case, case.setting.limits_by_18(), None)


def two_stage(case: Case, before: Designs) -> JerkTrajectory:
    """Return the motion of minimal J* that keeps the limits of the axis.

    The search starts from the design by (18), from a search with random starts for J*, and from one
    for J_f. The last start ensures that the gain of `filter_aware` is not due to a better start.
    """
    paper, limits = before["by_18"], case.setting.limits()
    cold = _cold(case, limits, _still(case, paper))
    return _refined(case, paper, case.planned(), paper, cold, _cold_through_filter(case, paper))


def filter_aware(case: Case, before: Designs) -> JerkTrajectory:
    """Return the motion of minimal J_f for an axis that follows it exactly.

    The search starts from the two-stage design, and from the motion for another filter if there is
    one, otherwise from a search with random starts.
    """
    other = before.get("filter_aware") or _cold_through_filter(case, before["by_18"])
    found = _refined(case, before["by_18"], case.aware(), before["two_stage"], other)
    return _least(case.aware(), before["two_stage"], found)


def end_to_end(case: Case, before: Designs) -> JerkTrajectory:
    """Return the motion of minimal J_f of the nominal closed loop.

    The search starts from the better one of the two-stage and the filter-aware design.
    """
    objective = case.through(case.setting.nominal())
    best = _least(objective, before["two_stage"], before["filter_aware"])
    return _least(objective, best, _refined(case, before["by_18"], objective, best))


def robust(case: Case, before: Designs) -> JerkTrajectory:
    """Return the motion of minimal worst-case J_f over all plants.

    The search starts from the best of the earlier designs. Few plants are ever the worst case, so
    the objective contains only those that come nearest to it.
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
FILTERED = ("filter_aware", "end_to_end", "robust")  # designs that depend on the filter


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
    """Return an axis with constant deviations from the motion, for searches with random starts.

    The deviations cover 90 % of the samples of the simulated axis. They are reduced if no motion
    would keep the limits otherwise; the refinement simulates the actual ones.
    """
    system, limits = case.setting.system(), case.setting.limits()
    added = freeze(case.axis(encoder()), limits, motion).added
    usual = [float(jnp.quantile(jnp.maximum(-x.lower, x.upper), _MOST)) for x in added]
    for share in (1.0, 0.7, 0.4):
        y, v, u = (share * margin for margin in usual[:3])
        axis = fixed_margins(system, 5 * case.intervals, (y, v, u, 0.0))
        with contextlib.suppress(ValueError):  # no motion keeps the limits
            problem = case.problem(case.planned(), axis, jnp.zeros(3))
            interior_motion(problem, case.intervals, motor.KNOT_PERIOD)
            return axis
    return fixed_margins(system, 5 * case.intervals, (0.0, 0.0, 0.0, 0.0))


def _refined(
    case: Case, by_18: JerkTrajectory, objective: Objective, *starts: JerkTrajectory
) -> JerkTrajectory:
    """Return the best motion that is found from the given starts.

    The search assumes an exact sensor and keeps a margin for the encoder, whose noise differs from
    motion to motion, so that a step cannot predict it. It keeps the limits of the plants that come
    nearest to a limit. Margin and plants are those of the motion by (18), the same for all designs
    of a case. If some plant still exceeds a limit with the encoder, the search continues with those
    of the motion found as well.
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
    """Yield a refined motion, and up to `repeats` further refinements while the gain suffices.

    The gain of a later stage is then due to its objective, and not to one more search.
    """
    found = improve(problem, start, effort)
    yield found
    for _ in range(repeats):
        before, found = found, improve(problem, found.trajectory, effort)
        yield found
        if before.value - found.value < _SETTLED:
            break


def _seen(case: Case, motion: JerkTrajectory) -> tuple[jax.Array, jax.Array]:
    """Return the effect of the encoder at each limit, and how near each plant comes to a limit."""
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
