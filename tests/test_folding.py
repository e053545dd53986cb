"""Loops in one kernel: which loops, and with which results."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from jaxid import _folding
from jaxid._folding import compiled_apart, folded_scan
from jaxid.loop.controllers import PDFeedforward
from jaxid.loop.disturbances import random_shares
from jaxid.loop.sensors import IdealSensor
from jaxid.loop.simulate import Plant, simulate
from jaxid.motion.trajectory import reference

LENGTH = 40
TABLE = jnp.linspace(0.0, 1.0, LENGTH)

FOLDED = {
    "arithmetic": lambda x, k, table: jnp.tanh(0.9 * x) + jnp.where(x > 0.5, 0.1, table[0]),
    "table": lambda x, k, table: 0.9 * x + table[k],
    "branches": lambda x, k, table: jax.lax.cond(x > 1, lambda x: x / 2, lambda x: x + 0.3, x),
    "small arrays": lambda x, k, table: jnp.sum(jnp.stack([x, 2 * x]) * table[:2]) + 0.1,
    "inner loop": lambda x, k, table: jax.lax.scan(lambda y, t: (0.5 * y + t, None), x, table)[0],
}
UNFOLDED = {
    "sorting": lambda x, k, table: 0.5 * x + jnp.sort(jnp.stack([x, table[k]]))[0],
    "library": lambda x, k, table: jnp.linalg.solve(jnp.eye(2) + x**2, table[:2])[1],
    "product": lambda x, k, table: jnp.sum(jnp.outer(table, table) @ (x * table)) / LENGTH**2,
    "transform": lambda x, k, table: jnp.abs(jnp.fft.fft(x + table))[1] / LENGTH,
    # the gradient of a batch would have an operation that cannot be in one kernel
    "table at data": lambda x, k, table: 0.5 * x + jnp.interp(x, TABLE, table),
    "host": lambda x, k, table: jax.pure_callback(
        lambda x: np.asarray(x) / 2, jax.ShapeDtypeStruct((), float), x, vmap_method="sequential"
    ),
}


def loop(body, scan, first, table):
    def step(x, now):
        x = body(x, now[0], table)
        return x, x

    return scan(step, first)[1]


def folded(step, first):
    return folded_scan(step, first, None, LENGTH)


def usual(step, first):
    return jax.lax.scan(step, first, (jnp.arange(LENGTH), None))


@pytest.mark.parametrize("name", [*FOLDED, *UNFOLDED])
def test_every_loop_has_the_results_of_scan(name, quick_compilation):
    body, lanes = (FOLDED | UNFOLDED)[name], jnp.array([0.3, 0.6, 0.9])
    found, expected = (functools.partial(loop, body, scan) for scan in (folded, usual))
    close = functools.partial(np.testing.assert_allclose, rtol=1e-12, atol=1e-14)
    tables = jnp.stack([TABLE, TABLE / 2, TABLE / 3])
    both = [jax.jit(f)(0.4, TABLE) for f in (found, expected)]
    close(*both)
    close(*(jax.jit(jax.vmap(f))(lanes, tables) for f in (found, expected)))
    if name != "host":
        slopes = (jax.grad(lambda *a, f=f: jnp.sum(f(*a)), (0, 1)) for f in (found, expected))
        for a, b in zip(
            *(jax.jit(jax.vmap(slope))(lanes, tables) for slope in slopes), strict=True
        ):
            close(a, b)


@pytest.mark.parametrize("name", [*FOLDED, *UNFOLDED])
def test_the_compiler_is_asked_for_one_kernel_only_where_it_can_make_one(name):
    text = jax.jit(functools.partial(loop, (FOLDED | UNFOLDED)[name], folded)).lower(0.4, TABLE)
    assert ('xla_cpu_small_call = "true"' in text.as_text()) == (name in FOLDED)


def test_a_closed_loop_has_the_same_results_without_folding(motion, monkeypatch):
    system, period = motor.system(), motor.CONTROL_PERIOD
    desired = jax.tree.map(lambda x: x[:300], reference(motion, period, 3000))
    shares = random_shares(jax.random.key(0), 300)
    plant = Plant(system, system.centre, shares)
    controller = PDFeedforward(system, system.centre, kp=2000.0, kd=20.0)

    def run(theta):
        given = Plant(system, theta, plant.disturbance)
        return simulate.__wrapped__(given, controller, IdealSensor(), desired, period)[0]

    one = jax.jit(lambda theta: run(theta)).lower(system.centre)
    monkeypatch.setattr(_folding, "_foldable", lambda *_, **__: False)
    other = jax.jit(lambda theta: run(theta)).lower(system.centre)
    texts = [lowered.as_text() for lowered in (one, other)]
    assert ['xla_cpu_small_call = "true"' in text for text in texts] == [True, False]
    records = [lowered.compile()(system.centre) for lowered in (one, other)]
    for a, b in zip(*map(jax.tree.leaves, records), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-13)
    record = records[0]
    rest = record.rows.regressors @ system.centre + record.disturbance - record.input
    assert np.max(np.abs(rest)) <= 1e-12 * np.max(np.abs(record.input))


def test_a_function_that_is_compiled_apart_has_its_own_bits():
    def function(x):
        return jnp.exp(x) * x + jnp.sin(x)

    points = jnp.linspace(0.0, 3.0, 101)
    alone = jax.jit(compiled_apart(function))(points)

    def program(x):
        found = compiled_apart(function)(x * 1.0)
        return found, jnp.sum(found) * x

    np.testing.assert_array_equal(jax.jit(program)(points)[0], alone)
