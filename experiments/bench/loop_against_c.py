"""How far is one closed loop, and its gradient, from C by hand, and does CasADi come closer?

One loop of 3,000 ticks (a motion) and of 9,000 (three): JAX folded and not, loop.c as the physical
limit, CasADi's generated C. All compute the same number: that is checked before it is timed.
"""

import functools
import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments._support.processes import processors
from experiments.bench import compiled
from experiments.bench.answers import AT_MOST, Answer, compared, per_step
from experiments.bench.closed_loop import TICKS, loop_error, nominal
from experiments.bench.remote import UNFOLDED, Remote
from experiments.bench.timing import Action, Times, interleaved
from jaxid.io.files import read_trajectory

QUESTION = "loop_against_c"
MOTION = Path(__file__).parents[2] / "figures" / "trajectory_M_N30.csv"

Jerk = Float[np.ndarray, " n"]


def ask(repeats: int, repetitions: int) -> list[Answer]:
    """The answers for a loop of `repeats` motions; `repetitions` of the folded ones."""
    actions = jax_actions(repeats) | c_actions(repeats) | casadi_actions(repeats)
    agree(actions)
    return answers(interleaved(actions, repetitions), TICKS * repeats)


def ask_folding(repeats: int, repetitions: int) -> list[Answer]:
    """What folding gains: the same beside a process whose flags forbid it."""
    names = {"value": "value", "gradient": "value and gradient"}
    with Remote(functools.partial(jax_actions, repeats), processors()[0], UNFOLDED) as other:
        unfolded = {f"unfolded {name}": functools.partial(other.run, name) for name in names}
        times = interleaved(jax_actions(repeats) | unfolded, repetitions)
    case = f"{TICKS * repeats} ticks"
    return [
        compared(
            QUESTION, case, f"{long}, gain of folding", (times[f"unfolded {name}"], times[name])
        )
        for name, long in names.items()
    ]


def answers(times: Mapping[str, Times], ticks: int) -> list[Answer]:
    """The ratios that have targets, then those that are only reported."""
    case = f"{ticks} ticks"
    steps = functools.partial(per_step, QUESTION, steps=ticks)
    versus = functools.partial(compared, QUESTION, case)
    value, both = times["value"], times["gradient"]
    found = [versus("value and gradient / value", (both, value), (AT_MOST, 3.0))]
    if "casadi gradient" in times:
        pair = (both, times["casadi gradient"])
        found.append(versus("value and gradient / CasADi", pair, (AT_MOST, 1.0)))
        found.append(versus("value / CasADi", (value, times["casadi value"])))
    for name, named in {"value": "value", "gradient": "value and gradient"}.items():
        if "c value" in times:
            found += [
                versus(f"{named} / C", (times[name], times[f"c {name}"])),
                versus(f"{named} / C -ffast-math", (times[name], times[f"c fast {name}"])),
            ]
    return [*found, *(steps(f"{case}, {name}", one) for name, one in times.items())]


def motion() -> Jerk:
    """The jerk of the committed design for M at N = 30."""
    return np.asarray(read_trajectory(MOTION).jerk)


def jax_actions(repeats: int) -> dict[str, Action]:
    """`loop_error` and its gradient, compiled."""
    jerk, theta = jnp.asarray(motion()), nominal()
    value = jax.jit(functools.partial(loop_error, repeats=repeats))
    gradient = jax.jit(jax.value_and_grad(functools.partial(loop_error, repeats=repeats)))
    return {"value": lambda: value(jerk, theta), "gradient": lambda: gradient(jerk, theta)}


def c_actions(repeats: int) -> dict[str, Action]:
    """loop.c, where there is a compiler."""
    if compiled.compiler() is None:
        return {}
    found: dict[str, Action] = {}
    for name, flags in {"c": (), "c fast": compiled.FAST_MATH}.items():
        loop, arguments = compiled.Loop(repeats, 1, *flags), (motion(), np.asarray(nominal()))
        found[f"{name} value"] = loop.value(*arguments)
        found[f"{name} gradient"] = loop.value_and_gradient(*arguments)
    return found


def casadi_actions(repeats: int) -> dict[str, Action]:
    """CasADi's generated C, where both CasADi and a compiler are there."""
    if compiled.compiler() is None or importlib.util.find_spec("casadi") is None:
        return {}
    from experiments.bench import casadi_loop

    loop = casadi_loop.Loop(repeats, np.asarray(nominal()))
    return {
        "casadi value": loop.value(motion()),
        "casadi gradient": loop.value_and_gradient(motion()),
    }


def agree(actions: Mapping[str, Action], tolerance: float = 1e-9) -> None:
    """Refuse to compare the times of programs that compute different numbers."""
    value, gradient = (np.asarray(x) for x in _gradient(actions["gradient"]))
    for name, action in actions.items():
        if name.endswith("value"):
            np.testing.assert_allclose(
                np.squeeze(cast("Any", action())), value, rtol=tolerance, err_msg=name
            )
        else:
            own, slope = _gradient(action)
            size = np.abs(gradient).max()
            np.testing.assert_allclose(own, value, rtol=tolerance, err_msg=name)
            np.testing.assert_allclose(slope / size, gradient / size, atol=tolerance, err_msg=name)


def _gradient(action: Action) -> tuple[Any, Any]:
    value, gradient = cast("tuple[Any, Any]", action())
    return value, gradient
