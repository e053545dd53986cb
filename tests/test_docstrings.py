"""Docstrings of the public names: their examples run, and every name has a description."""

import doctest

import jax.numpy as jnp
import pytest

import jaxid as jd
from jaxid.loop.disturbances import NoDisturbance

MAIN = (
    jd.System, jd.acceleration_limit, jd.Limits, jd.Boundary, jd.Task, jd.JerkTrajectory,
    jd.planned_error, jd.sampled_error, jd.lower_bound, jd.Servo, jd.evaluate,
    jd.LeastSquaresError, jd.optimal_motion, jd.run, jd.identify, jd.assumptions,
    jd.filtered_least_squares,
)  # fmt: skip


def test_the_examples_of_the_main_names_run(capsys):
    names = {"jd": jd, "jnp": jnp, "NoDisturbance": NoDisturbance}
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL)
    for main in MAIN:
        text = doctest.DocTestParser().get_doctest(main.__doc__, names, main.__name__, None, 0)
        assert text.examples, main.__name__
        runner.run(text, clear_globs=False)
        names = text.globs
    assert runner.failures == 0, capsys.readouterr().out


@pytest.mark.parametrize("name", jd.__all__)
def test_every_public_name_says_what_it_is(name):
    """The first line has at least three words, and the docstring of the package lists the name."""
    own = getattr(jd, name)
    first = (own.__doc__ or "").strip().partition("\n")[0]
    assert len(first.split()) >= 3, f"{name}: {first!r}"
    assert name in (jd.__doc__ or "")
