"""Programs in one kernel: which programs, and with which results."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid import _folding
from jaxid._folding import compiled_apart, is_traced, one_kernel
from jaxid.loop.closed_loop import run
from jaxid.loop.controllers import PDFeedforward
from jaxid.loop.disturbances import random_shares
from jaxid.loop.experiment import _run
from jaxid.loop.sensors import IdealSensor
from jaxid.loop.servo import Servo
from jaxid.loop.simulate import Plant

LENGTH = 40
TABLE = jnp.linspace(0.0, 1.0, LENGTH)
ATTRIBUTE = 'xla_cpu_small_call = "true"'

FOLDED = {
    "arithmetic": lambda x, k, table: jnp.tanh(0.9 * x) + jnp.where(x > 0.5, 0.1, table[0]),
    "table": lambda x, k, table: 0.9 * x + table[k],
    "table at data": lambda x, k, table: 0.5 * x + jnp.interp(x, TABLE, table),
    "branches": lambda x, k, table: jax.lax.cond(x > 1, lambda x: x / 2, lambda x: x + 0.3, x),
    "small arrays": lambda x, k, table: jnp.sum(jnp.stack([x, 2 * x]) * table[:2]) + 0.1,
    "sum": lambda x, k, table: 0.5 * x + jnp.cumsum(table)[k],
    "inner loop": lambda x, k, table: jax.lax.scan(lambda y, t: (0.5 * y + t, None), x, table)[0],
}
UNFOLDED = {
    "sorting": lambda x, k, table: 0.5 * x + jnp.sort(jnp.stack([x, table[k]]))[0],
    "library": lambda x, k, table: jnp.linalg.solve(jnp.eye(2) + x**2, table[:2])[1],
    "product": lambda x, k, table: jnp.sum(jnp.outer(table, table) @ (x * table)) / LENGTH**2,
    "transform": lambda x, k, table: jnp.abs(jnp.fft.fft(x + table))[1] / LENGTH,
    "host": lambda x, k, table: jax.pure_callback(
        lambda x: np.asarray(x) / 2, jax.ShapeDtypeStruct((), float), x, vmap_method="sequential"
    ),
}


def loop(body, first, table):
    def step(x, k):
        x = body(x, k, table)
        return x, x

    return jax.lax.scan(step, first, jnp.arange(LENGTH))[1]


@pytest.mark.parametrize("name", [*FOLDED, *UNFOLDED])
def test_only_tried_operations_become_one_kernel_and_all_keep_their_results(name):
    usual = functools.partial(loop, (FOLDED | UNFOLDED)[name])
    lowered = jax.jit(functools.partial(one_kernel, usual)).lower(jnp.asarray(0.4), TABLE)
    assert (ATTRIBUTE in lowered.as_text()) == (name in FOLDED)
    found, expected = lowered.compile()(jnp.asarray(0.4), TABLE), jax.jit(usual)(0.4, TABLE)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


def experiment(motion):
    """Return the arguments of a run with random disturbance, without sensor and servo."""
    system = motor.system()
    plant = Plant(system, system.centre, random_shares(jax.random.key(0), 3000))
    return plant, PDFeedforward(system, system.centre, kp=2000.0, kd=20.0), motion


def test_a_run_has_the_same_results_without_folding(motion, monkeypatch):
    plant, controller, motion = experiment(motion)
    kinds = {"sensor": IdealSensor()}
    folded = run(plant, controller, Servo(motor.CONTROL_PERIOD), motion, **kinds)
    monkeypatch.setattr(_folding, "_foldable", lambda jaxpr: False)
    _run.clear_cache()
    other = run(plant, controller, Servo(motor.CONTROL_PERIOD), motion, **kinds)
    _run.clear_cache()
    for a, b in zip(*map(jax.tree.leaves, (folded, other)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-11)
    record = folded.record
    rest = record.rows.regressors @ plant.theta + record.disturbance - record.input
    assert np.max(np.abs(rest)) <= 1e-12 * np.max(np.abs(record.input))


def test_a_run_within_another_program_is_no_kernel_of_its_own(motion):
    plant, controller, motion = experiment(motion)
    servo = Servo(motor.CONTROL_PERIOD)

    def known() -> jax.Array:
        return run(plant, controller, servo, motion).log.position

    assert ATTRIBUTE not in jax.jit(known).lower().as_text()
    states = []
    jax.jit(lambda: (states.append(is_traced()), 0.0)[1])()
    jax.grad(lambda x: (states.append(is_traced()), x)[1])(1.0)
    assert states == [True, True]
    assert not is_traced()


def test_a_function_that_is_compiled_apart_has_its_own_bits():
    def function(x):
        return jnp.exp(x) * x + jnp.sin(x)

    points = jnp.linspace(0.0, 3.0, 101)
    alone = jax.jit(compiled_apart(function))(points)

    def program(x):
        found = compiled_apart(function)(x * 1.0)
        return found, jnp.sum(found) * x

    np.testing.assert_array_equal(jax.jit(program)(points)[0], alone)
