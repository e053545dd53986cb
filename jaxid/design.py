"""Search by gradients for the motion that minimises any scalar function of it, under limits (16).

The objective is a value: a function of a trajectory and a smoothing. Nothing here knows what it
computes, so the same search designs through a closed loop or on a parabola.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PRNGKeyArray

from jaxid.feasible import MotionSpace, interior, motion_space, trimmed, walk
from jaxid.limits import Boundary, Limits, excess
from jaxid.polish import polish
from jaxid.starts import grown, random_starts, rearranged
from jaxid.system import Scalar
from jaxid.trajectory import JerkTrajectory

Objective = Callable[[JerkTrajectory, Scalar], Scalar]
Report = Callable[[str], None]


class Stage(NamedTuple):
    """One stage of the augmented-Lagrangian search.

    Attributes:
        penalty: ρ, the weight of a squared violation (in half-widths) against the objective.
        step: of the normalised gradient method, in normalised trajectory.
        smoothing: of the objective's corners.
    """

    penalty: Scalar
    step: Scalar
    smoothing: Scalar


class Effort(NamedTuple):
    """How long to search.

    On the motor the default takes about 12 s per design and core. Searches that differ in seed and
    effort have ended up to 0.5 % apart at N = 30, and up to 3 % at N = 60, where dwells are longer.

    Attributes:
        starts: motions that are improved together.
        stages: of the first descent, from soft walls to hard ones.
        steps: of gradient descent per stage.
        rounds: of rearranging the best and descending again.
        round_stages: of each such descent.
        parents: how many of the best are rearranged.
        polished: how many of the best are polished by linear programs.
        polish_steps: linear programs per polish.
    """

    starts: int = 64
    stages: int = 6
    steps: int = 80
    rounds: int = 4
    round_stages: int = 3
    parents: int = 8
    polished: int = 2
    polish_steps: int = 40


class Design(NamedTuple):
    """A motion that keeps every limit exactly, and how it was found.

    Attributes:
        trajectory: the motion.
        value: of the objective, unsmoothed.
        history: the best objective among the admissible starts after each descent.
    """

    trajectory: JerkTrajectory
    value: float
    history: tuple[float, ...]


class _Lane(NamedTuple):
    z: Float[Array, " d"]
    multipliers: tuple[Float[Array, "..."], ...]


class _Pool(NamedTuple):
    """Admissible motions, best first, and the objective of each."""

    trajectories: JerkTrajectory
    values: Float[Array, " k"]


_LAST_SMOOTHING = 0.0003


def first_stages(count: int) -> list[Stage]:
    """From soft walls and large steps to hard walls and small ones, geometrically."""
    return _stages(count, penalty=0.3, step=0.3, smoothing=0.025)


def later_stages(count: int) -> list[Stage]:
    """For starts that are nearly good: walls that are hard from the beginning."""
    return _stages(count, penalty=3.0, step=0.1, smoothing=0.003)


def design(
    objective: Objective,
    limits: Limits,
    boundary: Boundary,
    intervals: int,
    period: float,
    key: PRNGKeyArray,
    *,
    fine: Objective | None = None,
    shorter: JerkTrajectory | None = None,
    effort: Effort = Effort(),
    size: int | None = None,
    report: Report = lambda message: None,
) -> Design:
    """The best motion that many starts find together, and a polish of the best few.

    Args:
        objective: of a trajectory and a smoothing; of order one, so the log of a positive quantity.
        limits: kept exactly, between the knots too.
        boundary: kept exactly.
        intervals: of constant jerk.
        period: of each interval, s.
        key: for the starts.
        fine: the same objective on a finer grid, for the polish and the choice; default the same.
        shorter: a good motion with fewer intervals: half of the starts are longer copies of it.
        effort: how long to search.
        size: pad to this many intervals, so that several lengths share one compilation.
        report: told what goes on, a few words at a time.

    Raises:
        InfeasibleError: if no motion of this length keeps the limits.
    """
    fine = fine or objective
    inside = interior(limits, boundary, intervals, period, size)
    space = motion_space(limits, boundary, intervals, period, size)
    keys = jax.random.split(key, effort.rounds + 2)
    z = random_starts(keys[0], space, effort.starts)
    if shorter is not None:
        half = effort.starts // 2
        longer = grown(keys[1], space, [trimmed(shorter).jerk], intervals, half)
        z = jnp.concatenate([z[half:], longer])
    report("descent")
    z = descend(objective, limits, boundary, space, z, first_stages(effort.stages), effort.steps)
    pool = _admissible(objective, limits, boundary, inside, space, z)
    history = [float(pool.values[0])]
    fastest = float(jnp.max(jnp.abs(limits.acceleration)))
    for k in range(effort.rounds):
        report(f"round {k + 1} of {effort.rounds}")
        parents = [_pick(pool, i).jerk[:intervals] for i in range(effort.parents)]
        z = rearranged(keys[k + 2], space, parents, period, fastest, effort.starts)
        stages = later_stages(effort.round_stages)
        z = descend(objective, limits, boundary, space, z, stages, effort.steps)
        pool = _best(pool, _admissible(objective, limits, boundary, inside, space, z))
        history.append(float(pool.values[0]))
    polished = []
    for k in range(effort.polished):
        report(f"polish {k + 1} of {effort.polished}")
        found = polish(fine, limits, boundary, inside, _pick(pool, k), effort.polish_steps)
        reached = jnp.nan_to_num(_value(fine, found, 0.0), nan=jnp.inf)
        polished.append((float(reached), k, found))
    value, _, best = min(polished)  # k decides between equals
    return Design(trimmed(best), value, tuple(history))


def descend(
    objective: Objective,
    limits: Limits,
    boundary: Boundary,
    space: MotionSpace,
    z: Float[Array, "starts d"],
    stages: Sequence[Stage],
    steps: int,
) -> Float[Array, "starts d"]:
    """All starts together through the stages of an augmented Lagrangian, by Adam within each.

    Args:
        objective: of a trajectory and a smoothing.
        limits: as penalties; what remains of a violation is left to `walk`.
        boundary: equalities hold exactly, inequalities as penalties.
        space: of the motions.
        z: coordinates of the starts.
        stages: what to do one after the other.
        steps: of gradient descent per stage.
    """
    shapes = jax.eval_shape(jax.vmap(lambda z: excess(limits, boundary, space.trajectory(z))), z)
    lanes = _Lane(z, jax.tree.map(lambda c: jnp.zeros(c.shape, c.dtype), shapes))
    for stage in stages:
        lanes = _stage(objective, limits, boundary, space, lanes, stage, steps)
    return lanes.z


def _stages(count: int, penalty: float, step: float, smoothing: float) -> list[Stage]:
    columns = (
        jnp.geomspace(penalty, 100.0, count),
        jnp.geomspace(step, 0.01, count),
        jnp.geomspace(smoothing, _LAST_SMOOTHING, count),
    )
    return [Stage(*values) for values in zip(*columns, strict=True)]


@eqx.filter_jit
def _value(objective: Objective, trajectory: JerkTrajectory, smoothing: float) -> Scalar:
    return objective(trajectory, jnp.asarray(smoothing))


@eqx.filter_jit
def _admissible(
    objective: Objective,
    limits: Limits,
    boundary: Boundary,
    inside: JerkTrajectory,
    space: MotionSpace,
    z: Float[Array, "starts d"],
) -> _Pool:
    """The starts walked back into the limits, best first."""

    def one(z: Float[Array, " d"]) -> tuple[JerkTrajectory, Scalar]:
        found = walk(limits, boundary, inside, space.trajectory(z))
        return found, objective(found, jnp.asarray(_LAST_SMOOTHING))

    return _sorted(_Pool(*jax.vmap(one)(z)))


@eqx.filter_jit
def _best(one: _Pool, other: _Pool) -> _Pool:
    """As many as `other` holds, of both."""
    both = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), one, other)
    return jax.tree.map(lambda x: x[: other.values.size], _sorted(both))


def _sorted(pool: _Pool) -> _Pool:
    # a motion that its walk could not make finite must not win by comparing as equal
    order = jnp.argsort(jnp.nan_to_num(pool.values, nan=jnp.inf))
    return jax.tree.map(lambda x: x[order], pool)


def _pick(pool: _Pool, k: int) -> JerkTrajectory:
    return jax.tree.map(lambda x: x[k], pool.trajectories)


@eqx.filter_jit
def _stage(
    objective: Objective,
    limits: Limits,
    boundary: Boundary,
    space: MotionSpace,
    lanes: _Lane,
    stage: Stage,
    steps: int,
) -> _Lane:
    method = optax.adam(optax.linear_schedule(stage.step, 0.02 * stage.step, steps), b2=0.99)

    def multipliers(lane: _Lane) -> tuple[Float[Array, "..."], ...]:
        """max(0, λ + ρc) for each c ≤ 0 (Rockafellar 1973)."""
        c = excess(limits, boundary, space.trajectory(lane.z))
        return jax.tree.map(
            lambda m, c: jnp.maximum(0.0, m + stage.penalty * c), lane.multipliers, c
        )

    def lagrangian(z: Float[Array, " d"], lane: _Lane) -> Scalar:
        pushed = multipliers(lane._replace(z=z))
        walls = sum(jnp.sum(x**2) for x in pushed) / (2 * stage.penalty)
        return objective(space.trajectory(z), stage.smoothing) + walls

    def step(
        carry: tuple[_Lane, optax.OptState], _: None
    ) -> tuple[tuple[_Lane, optax.OptState], None]:
        lane, state = carry
        slope = jax.grad(lagrangian)(lane.z, lane)
        update, state = method.update(slope, state)
        return (lane._replace(z=optax.apply_updates(lane.z, update)), state), None

    def one(lane: _Lane) -> _Lane:
        (lane, _), _ = jax.lax.scan(step, (lane, method.init(lane.z)), length=steps)
        return lane._replace(multipliers=multipliers(lane))

    # 16 motions at a time stay in the second-level cache: a quarter faster than 64
    return jax.lax.map(one, lanes, batch_size=16)
