import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal

from jaxid.regression.filters import adjoint, low_pass

PERIOD = 2e-4
BANDWIDTHS = [30.0, 1000.0, 5000.0]


@pytest.mark.parametrize("w", BANDWIDTHS)
def test_low_pass_is_the_held_filter_of_scipy(w):
    """The filter w/(s + w) is discretised by SciPy with a zero-order hold."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=400)
    numerator, denominator, _ = signal.cont2discrete(([w], [1.0, w]), PERIOD, method="zoh")
    # SciPy's output at sample k depends on inputs before k, `low_pass` gives it after input k
    expected = signal.lfilter(numerator.ravel(), denominator, np.append(x, 0.0))[1:]
    np.testing.assert_allclose(low_pass(jnp.asarray(x), w, PERIOD), expected, atol=1e-12)


@pytest.mark.parametrize("w", BANDWIDTHS)
def test_low_pass_is_the_exact_response_of_the_differential_equation(w):
    x = np.random.default_rng(1).normal(size=50)
    times, held = np.arange(51) * PERIOD, np.append(x, x[-1])
    fine = np.linspace(0, 50 * PERIOD, 50 * 200 + 1)
    input = held[np.minimum((fine / PERIOD + 1e-9).astype(int), 49)]
    _, response, _ = signal.lsim(([w], [1.0, w]), input, fine, interp=False)
    expected = np.interp(times[1:], fine, response)
    np.testing.assert_allclose(low_pass(jnp.asarray(x), w, PERIOD), expected, atol=1e-9)


@pytest.mark.parametrize("w", BANDWIDTHS)
def test_the_matrix_is_toeplitz_and_nowhere_negative_and_the_adjoint_its_transpose(w):
    H = np.asarray(low_pass(jnp.eye(40), w, PERIOD))
    assert np.all(H >= 0)
    np.testing.assert_allclose(np.diag(H, -3), H[3, 0])
    assert np.all(np.triu(H, 1) == 0)
    g = np.random.default_rng(2).normal(size=40)
    np.testing.assert_allclose(adjoint(jnp.asarray(g), w, PERIOD), H.T @ g, rtol=1e-12, atol=1e-15)


def test_low_pass_takes_columns_together():
    x = jnp.asarray(np.random.default_rng(3).normal(size=(30, 2)))
    together = low_pass(x, 300.0, PERIOD)
    np.testing.assert_allclose(together[:, 1], low_pass(x[:, 1], 300.0, PERIOD), rtol=1e-14)
