"""The speed of many closed loops in parallel on one processor, and the speed-up on two.

Every lane is a plant with its own parameters on its own motion, from the jerk to log J_f.
"""

import functools
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.bench import compiled
from experiments.bench.answers import AT_LEAST, AT_MOST, Answer, compared, per_step
from experiments.bench.closed_loop import TICKS, loop_error, nominal
from experiments.bench.loop_against_c import motion
from experiments.bench.remote import Remote
from experiments.bench.timing import Action, interleaved
from jaxid._batches import map_in_batches

QUESTION = "batches"
_AGAIN = 25  # runs of a loop per timed action, on two processors
VECTOR = 8  # lanes of the vectorised loop.c: one register of AVX-512
# the best of JAX against loop.c
TARGETS = {"c lanes 1": (AT_MOST, 2.5), f"c -ffast-math lanes {VECTOR}": (AT_MOST, 1.6)}


def ask(lanes: tuple[int, ...], repetitions: int) -> list[Answer]:
    """Return the nanoseconds per plant and sample period, and their ratio to loop.c."""
    actions = {**jax_actions(lanes), **batched_actions(max(lanes)), **c_actions()}
    times = interleaved(actions, repetitions)
    counts = {name: int(name.split()[-1]) for name in times}
    found = [per_step(QUESTION, name, one, TICKS * counts[name]) for name, one in times.items()]
    rates = {name: one.least / counts[name] for name, one in times.items()}
    best = min((name for name in times if name.startswith("jax")), key=lambda name: rates[name])
    for name in times:
        if name.startswith("c "):
            pair = (times[best], times[name])
            scale = counts[name] / counts[best]
            case = f"{best} / {name}"
            found.append(compared(QUESTION, case, "per step", pair, TARGETS.get(name), scale))
    return found


def jax_actions(lanes: tuple[int, ...]) -> Mapping[str, Action]:
    """Return `loop_error` under vmap, for each number of lanes."""
    value = jax.jit(jax.vmap(functools.partial(loop_error, repeats=1)))
    arguments = {count: plants(count) for count in lanes}
    return {f"jax, lanes {count}": lambda a=a: value(*a) for count, a in arguments.items()}


def batched_actions(count: int) -> Mapping[str, Action]:
    """Return `loop_error` of many lanes, in batches as in all parts of the library."""

    def one(lane: tuple[Float[Array, " n"], Float[Array, " m"]]) -> Float[Array, ""]:
        return loop_error(*lane, repeats=1)

    value, arguments = jax.jit(functools.partial(map_in_batches, one)), plants(count)
    return {f"jax in batches, lanes {count}": lambda: value(arguments)}


def c_actions() -> dict[str, Action]:
    """Return loop.c for one lane, and for a vector register of lanes."""
    if compiled.compiler() is None:
        return {}
    found: dict[str, Action] = {}
    for name, count, flags in (
        ("c lanes", 1, ()),
        ("c lanes", VECTOR, ()),
        ("c -ffast-math lanes", VECTOR, compiled.FAST_MATH),
    ):
        jerk, theta = (np.asarray(x).T for x in plants(count))
        found[f"{name} {count}"] = compiled.Loop(1, count, *flags).value(jerk, theta)
    return found


def plants(count: int) -> tuple[Float[Array, "lanes n"], Float[Array, "lanes m"]]:
    """Return jerks and parameters that differ slightly from lane to lane."""
    share = 1 - 0.1 * np.arange(count)[:, None] / count
    return jnp.asarray(share * motion()), jnp.asarray(share * np.asarray(nominal()))


def _again_and_again(lanes: int) -> dict[str, Action]:
    """Return an action that repeats a loop.

    A single loop of a few milliseconds is too short on two processors: waking up the second one
    takes as long.
    """
    ((name, action),) = jax_actions((lanes,)).items()

    def repeated() -> object:
        return [action() for _ in range(_AGAIN)]

    return {name: repeated}


def ask_both(lanes: int, available: list[int], repetitions: int) -> list[Answer]:
    """Return the speed-up of the same work on two processors at once, each in its own process."""
    if len(available) < 2:
        return []
    make = functools.partial(_again_and_again, lanes)
    name = next(iter(make()))
    with Remote(make, available[0]) as one, Remote(make, available[1]) as other:

        def both() -> None:
            one.start(name)
            other.start(name)
            one.wait()
            other.wait()

        alone = {"first": lambda: one.run(name), "second": lambda: other.run(name)}
        times = interleaved({**alone, "both": both}, repetitions)
    slower = max(times["first"], times["second"], key=lambda one: one.least)
    case = f"{lanes} lanes on each of 2 processors"
    pair = (slower, times["both"])
    return [compared(QUESTION, case, "speed-up", pair, (AT_LEAST, 1.7), 2.0)]
