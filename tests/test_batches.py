"""Many items in batches: the results of `jax.vmap`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._batches import LANES, map_in_batches


def function(item):
    x, parameters = item
    return {"sum": x + jnp.sum(parameters), "all": jnp.sin(parameters)}


@pytest.mark.parametrize("count", [1, 2, LANES, LANES + 1, 3 * LANES - 1])
def test_batches_have_the_results_of_vmap(count):
    items = jnp.arange(count) * 1.0, jnp.arange(3.0 * count).reshape(count, 3)
    found, expected = map_in_batches(function, items), jax.vmap(function)(items)
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-14)


def test_no_more_lanes_are_computed_at_once_and_one_program_serves_all_batches():
    sizes = []

    @jax.custom_batching.custom_vmap
    def seen(x):
        return x

    @seen.def_vmap
    def _(size, batched, x):
        sizes.append(size)
        return x, True

    map_in_batches(seen, jnp.arange(2.0 * LANES + 1))
    assert sizes == [-(-(2 * LANES + 1) // 3)]


def test_gradients_pass_through_batches():
    items = jnp.linspace(0.0, 1.0, LANES + 3)
    found = jax.grad(lambda x: jnp.sum(map_in_batches(jnp.sin, x)))(items)
    np.testing.assert_allclose(found, jnp.cos(items), rtol=1e-14)
