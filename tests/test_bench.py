"""The benchmarks compute what they report; no run time is tested."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments._support.processes import processors
from experiments.bench import __main__ as bench
from experiments.bench import batches, closed_loop, compile_time, compiled, loop_against_c
from experiments.bench.answers import AT_MOST, Answer, compared
from experiments.bench.remote import Remote
from experiments.bench.timing import Times, interleaved
from jaxid.io.files import read_table

needs_compiler = pytest.mark.skipif(compiled.compiler() is None, reason="there is no C compiler")
LANES = 3
SHORT = np.array([400.0, -400.0, -300.0, -100.0, 300.0, 100.0])  # jerks, m/s³, over 300 samples


@needs_compiler
@pytest.mark.parametrize("repeats", [1, 2])
def test_the_loop_by_hand_and_its_adjoint_agree_with_jax(repeats):
    theta = np.asarray(closed_loop.nominal()) * 1.1
    loop = compiled.Loop(repeats, intervals=SHORT.size)
    error, slope = loop.value_and_gradient(SHORT, theta)()
    expected = jax.value_and_grad(closed_loop.loop_error)(
        jnp.asarray(SHORT), jnp.asarray(theta), repeats
    )
    np.testing.assert_allclose(error, expected[0], rtol=1e-9)
    np.testing.assert_allclose(loop.value(SHORT, theta)(), [expected[0]], rtol=1e-9)
    np.testing.assert_allclose(slope, expected[1], atol=1e-9 * np.abs(expected[1]).max())


@needs_compiler
@pytest.mark.parametrize("flags", [(), compiled.FAST_MATH])
def test_lanes_by_hand_agree_with_jax(flags):
    share = np.linspace(0.9, 1.0, LANES + 1)[:, None]
    jerk, theta = share * SHORT, share * np.asarray(closed_loop.nominal())
    found = compiled.Loop(1, LANES + 1, *flags, intervals=SHORT.size).value(jerk.T, theta.T)()
    expected = jax.vmap(lambda j, t: closed_loop.loop_error(j, t, 1))(
        jnp.asarray(jerk), jnp.asarray(theta)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    # loading the compiled code does not change the arithmetic of this process
    assert np.array([1e-310]) * 1.0 > 0


@needs_compiler
def test_casadi_agrees_with_jax():
    pytest.importorskip("casadi")
    from experiments.bench import casadi_loop

    theta = np.asarray(closed_loop.nominal())
    error, slope = casadi_loop.Loop(1, theta, SHORT.size).value_and_gradient(SHORT)()
    expected = jax.value_and_grad(closed_loop.loop_error)(jnp.asarray(SHORT), jnp.asarray(theta), 1)
    np.testing.assert_allclose(error, expected[0], rtol=1e-9)
    np.testing.assert_allclose(slope, expected[1], atol=1e-9 * np.abs(expected[1]).max())


@needs_compiler
def test_disagreement_is_refused():
    right = {"value": lambda: 1.0, "gradient": lambda: (1.0, np.ones(2))}
    loop_against_c.agree(right)
    with pytest.raises(AssertionError, match="wrong value"):
        loop_against_c.agree({**right, "wrong value": lambda: 1.0 + 1e-6})
    with pytest.raises(AssertionError, match="wrong gradient"):
        loop_against_c.agree({**right, "wrong gradient": lambda: (1.0, np.array([1.0, 1.1]))})


def test_ratios_are_of_minima_with_the_medians_beside_them():
    fast, slow = Times((1.0, 2.0, 9.0)), Times((4.0, 2.0, 3.0))
    answer = compared("q", "c", "ratio", (slow, fast), (AT_MOST, 1.9))
    assert (answer.least, answer.median) == (2.0, 1.5)
    assert answer.met is False
    assert dataclasses.is_dataclass(bench.Bench)
    assert bench.verdict([answer]).startswith("0 of 1 targets met; missed:")
    assert bench.row(answer)["target"] == "<= 1.9"
    assert Answer("q", "c", "reported", 1.0).met is None


def test_actions_take_turns():
    calls = []
    times = interleaved({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 3)
    assert calls == ["a", "b"] * 4  # the first round is a warm-up
    assert all(len(one.seconds) == 3 for one in times.values())


def doubled():
    return {"double": lambda: jnp.asarray(1.0) * 2}


def test_an_action_runs_in_another_process():
    with Remote(doubled, processors()[0]) as other:
        assert other.run("double") > 0


def test_lanes_are_different_plants():
    jerk, theta = batches.plants(LANES)
    assert jerk.shape == (LANES, closed_loop.INTERVALS)
    assert len(np.unique(theta[:, 0])) == LANES


def test_every_cell_of_table_1_shares_one_trace(quick_compilation):
    traces = compile_time.Traces()
    compile_time.step("M", 30, traces)
    once = traces.count
    compile_time.step("Fc", 60, traces)
    assert traces.count == once > 0


def test_the_table_is_saved_as_it_is_printed(tmp_path, capsys, monkeypatch):
    answers = [Answer("q", "c", "ratio", 1.0, 1.1, (AT_MOST, 2.0)), Answer("q", "c", "s", 3.0)]
    monkeypatch.setattr(bench, "asked", lambda options: [lambda: answers])
    bench.main(bench.Bench(out=tmp_path))
    assert "All 1 targets met." in capsys.readouterr().out
    rows = read_table(tmp_path / "bench.csv")
    assert [row["met"] for row in rows] == ["true", ""]
