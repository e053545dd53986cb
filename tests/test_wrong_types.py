"""Arguments of a wrong type give a message and no internal error, without a type checker.

The other tests check types at run time; this one starts a process that does not.
"""

import json
import subprocess
import sys

import pytest

PROGRAM = """
import json
import jax

jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import jaxid as jd
from jaxid.identification.feasible_parameter_set import feasible_set
from jaxid.loop.disturbances import NoDisturbance

terms = (jd.Term("m", "kg", (5.0, 9.0)), jd.Term("b", "N s/m", (0.0, 40.0), jd.Viscous()))
slide = jd.System(terms, jd.ConstantBound(6.0), "N")
box = {"position": (0.0, 0.5), "velocity": (-1.0, 1.0), "input": (-150.0, 150.0)}
limits = jd.Limits(acceleration=(-12.0, 12.0), jerk=(-200.0, 200.0), **box)
rest = (0.1, 0.0, 0.0)
ends = jd.Boundary(rest, (jd.through(rest, at=1.0),))
task = jd.Task(limits, ends, intervals=8, period=0.1)
jerk = 100.0 * jnp.array([1, -1, -1, 1, -1, 1, 1, -1.0])
motion = jd.JerkTrajectory(jnp.array(rest), jerk, jnp.full(8, 0.1))
servo = jd.Servo(0.001, 1e-6)
log = jd.Log(jnp.zeros(3), jnp.zeros(4), 0.001, 0.0)
key = jax.random.key(0)
least = jd.lower_bound(slide, limits)
fast = jd.JerkTrajectory(jnp.array(rest), 8 * motion.jerk, motion.durations / 2)
plant = jd.Plant(slide, (7.0, 20.0), NoDisturbance())
wild = jd.PDFeedforward(slide, slide.centre, 1e9, 1e6)
calls = {
    "regressor": lambda: jd.Term("b", "N s/m", (0.0, 1.0), lambda y, v: v),
    "regressor class": lambda: jd.Term("b", "N s/m", (0.0, 1.0), jd.Viscous),
    "function": lambda: jd.Custom(3.0),
    "bound": lambda: jd.System(terms, 6.0, "N"),
    "other bound": lambda: slide.with_disturbance_bound(3.0),
    "coordinate": lambda: jd.System(terms, jd.ConstantBound(6.0), "N", "rot"),
    "least": lambda: jd.evaluate(slide, motion, servo, least.value),
    "beyond": lambda: jd.evaluate(slide, fast, servo, least),
    "logged": lambda: feasible_set(log),
    "logs": lambda: jd.identify(slide, jnp.zeros(3)),
    "durations": lambda: jd.JerkTrajectory(jnp.array(rest), jnp.ones(2), jnp.array([0.1, -0.1])),
    "intervals": lambda: jd.optimal_motion(task._replace(intervals=2.5), lambda m, s: 0.0, key),
    "period": lambda: jd.optimal_motion(task._replace(period=-1.0), lambda m, s: 0.0, key),
    "starts": lambda: jd.optimal_motion(task, lambda m, s: 0.0, key, effort=jd.Effort(starts=0)),
    "criterion": lambda: jd.optimal_motion(task, lambda m, s: m.jerk, motion),
    "target": lambda: jd.LeastSquaresError(slide, "q"),
    "time": lambda: jd.sampled_error(slide, *jnp.zeros((4, 3))),
    "diverges": lambda: jd.run(plant, wild, servo, motion),
    "forward": lambda: jd.OneWay(jd.Viscous(), forward="backward"),
    "one way": lambda: jd.OneWay(3.0),
    "nodes": lambda: jd.planned_error(slide, motion, nodes=0),
    "complex": lambda: jd.ConstantBound(6 + 100j),
    "set-points": lambda: jd.sampled(motion, -0.001),
    "axis file": lambda: jd.read_axis("nowhere/slide.toml"),
}
said = {}
for name, call in calls.items():
    try:
        said[name] = f"no error: {call()!r}"[:200]
    except (ValueError, FileNotFoundError) as error:
        said[name] = str(error)
    except Exception as error:
        said[name] = f"{type(error).__name__}: {error}"[:200]
print(json.dumps(said))
"""
SENTENCES = {
    "regressor": "`regressor` of the term b must be a regressor such as",
    "regressor class": "`regressor` of the term b must be a regressor such as jaxid.Viscous()",
    "function": "`function` of a Custom regressor must be a function of position and velocity",
    "bound": "`disturbance_bound` of a system must be a disturbance bound such as",
    "other bound": "`disturbance_bound` of a system must be a disturbance bound such as",
    "coordinate": "`coordinate` must be linear or rotary, but is 'rot'",
    "least": "`least` must be the result of jaxid.lower_bound(system, limits), but is a",
    "beyond": "`trajectory` has values of the velocity from -2 to 2, outside the limits [-1, 1]",
    "logged": "`logged` must be regression rows, such as",
    "logs": "`logs` must be a jaxid.Log, or a list of them, but is a",
    "durations": "`durations` of a trajectory must be at least zero",
    "intervals": "`intervals` must be a whole number, 1 or more, but is 2.5",
    "period": "`period` of a task must be positive",
    "starts": "`starts` must be a whole number, 1 or more, but is 0",
    "criterion": "`criterion` must return one number for each motion, but returns an array of",
    "target": "`target` must be one of m, b, but is 'q'",
    "time": "`time` of a sampled motion must increase from each sample to the next, but does not "
    "after sample 0",
    "diverges": "The closed loop diverges: its input is not finite from ",
    "forward": "`forward` of a OneWay must be True or False, but is 'backward'",
    "one way": "`regressor` of a OneWay must be a regressor such as jaxid.Viscous()",
    "nodes": "`nodes` must be 1 or more, but is 0",
    "complex": "`level` must be real, but is (6+100j)",
    "set-points": "`period` of set-points must be positive",
    "axis file": "No such file",
}


@pytest.fixture(scope="module")
def said():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("name", SENTENCES)
def test_a_wrong_argument_is_told_in_a_sentence(said, name):
    assert SENTENCES[name] in said[name]
