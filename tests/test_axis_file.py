"""An axis file gives the same axis as Python code; invalid files are refused with a message."""

import sys
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.axes import linear_motor as motor
from experiments.axes import one_link_arm as arm
from jaxid.axis.file import read_axis
from jaxid.axis.texts import example
from jaxid.io.recorded import Columns
from jaxid.loop.controllers import PDFeedforward
from jaxid.model.disturbance_bound import ConstantBound
from jaxid.model.regressors import OneWay, Sine


@pytest.fixture
def read(tmp_path):
    """Return a function that reads the example file with some texts replaced."""

    def changed(*pairs, coordinate="linear"):
        text = example(coordinate)
        for old, new in pairs:
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "axis.toml"
        path.write_text(text)
        return read_axis(path)

    return changed


@pytest.mark.parametrize(("coordinate", "axis"), [("linear", motor), ("rotary", arm)])
def test_the_examples_are_the_axes_of_the_library(read, coordinate, axis):
    found = read(coordinate=coordinate)
    assert eqx.tree_equal(found.system, axis.system())
    assert eqx.tree_equal(found.task.limits, axis.limits())
    assert eqx.tree_equal(found.task.boundary, axis.boundary())
    assert found.servo == axis.servo()
    assert found.task.period == axis.KNOT_PERIOD
    assert (found.gain, found.servo.delay) == (1.0, 0)
    system, unit = axis.system(), "m" if axis is motor else "rad"
    by_hand = PDFeedforward(system, system.centre, 8.0, 0.5)
    assert eqx.tree_equal(found.controller, motor.controller() if axis is motor else by_hand)
    assert found.columns == Columns(f"position_{unit}", "input", "time_s")


def test_limits_of_a_command_become_those_of_the_input(read):
    """The limits are multiplied by the gain; a negative gain exchanges the ends."""
    found = read(("gain = 1.0", "gain = -2.0"), ("input = [-10.0, 10.0]", "input = [-4.0, 5.0]"))
    np.testing.assert_array_equal(found.task.limits.input, [-10.0, 8.0])
    np.testing.assert_array_equal(found.task.limits.input_rate, [-20_000.0, 20_000.0])
    given = read(("# acceleration = [-44.0, 44.0]", "acceleration = [-30.0, 20.0]"))
    np.testing.assert_array_equal(given.task.limits.acceleration, [-30.0, 20.0])


def test_every_kind_of_term_is_what_it_says(read):
    terms = """
[[terms]]
kind = "spring"
name = "K"
unit = "V/m"
interval = [0.0, 1.0]
rest = 0.1
[[terms]]
kind = "cogging"
name = "C2"
unit = "V"
interval = [-0.1, 0.1]
pitch = 0.06
harmonic = 2
phase = 0.5
[[terms]]
kind = "sign"
name = "forward"
unit = "V"
interval = [0.0, 0.5]
direction = "forward"
[[terms]]
kind = "viscous"
name = "backward"
unit = "V s/m"
interval = [0.0, 0.5]
direction = "backward"
"""
    found = read(("[disturbance]", terms + "[disturbance]")).system
    y, v = jnp.array([0.3, 0.02]), jnp.array([0.7, -0.4])
    expected = [y - 0.1, jnp.sin(4 * np.pi * y / 0.06 + 0.5), [1.0, 0.0], [0.0, -0.4]]
    for force, values in zip(found.regressor_values(y, v)[-4:], expected, strict=True):
        np.testing.assert_allclose(force, values, rtol=1e-12)
    kinds = [type(term.regressor) for term in found.terms[-3:]]
    assert kinds == [Sine, OneWay, OneWay]


def test_a_motion_may_begin_elsewhere_and_end_anywhere(read):
    home = ("# home = 0.35 ", "home = 0.35 "), ("# settle = 0.1 ", "settle = 0.1 ")
    found = read(*home, ("end = 0.0 ", "#"))
    assert (found.home, found.waiting) == (0.35, 10)
    last = found.task.boundary.vias[-1]
    np.testing.assert_array_equal(last.lower, [-np.inf, 0.0, 0.0])
    np.testing.assert_array_equal(last.upper, [np.inf, 0.0, 0.0])
    assert read().home == 0.0
    assert read().waiting == 0
    assert found.lasting(0.8).task.intervals == 80
    with pytest.raises(
        ValueError, match=r"the duration = 0.805 s must be a whole multiple of `motion.knot_period`"
    ):
        found.lasting(0.805)


def test_what_is_wanted_of_the_errors(read):
    found = read(("# [wanted]\n# M = 0.004", "[wanted]\nM = 0.004\nFc = 0.2"))
    np.testing.assert_array_equal(found.wanted, [0.004, np.inf, 0.2, np.inf])
    assert np.all(np.isinf(read().wanted))


CODE = """
import jaxid as jd
terms = (jd.Term("m", "N s²/m", (1.0, 2.0)), jd.Term("b", "N s/m", (0.0, 1.0), jd.Viscous()))
axis = jd.System(terms, jd.ConstantBound(0.3), "V")
def make():
    return axis
other = jd.System(terms, jd.ConstantBound(0.3), "N")
"""


@pytest.fixture
def coded(tmp_path):
    """Yield a function that writes a file with its terms in a Python module beside it."""
    (tmp_path / "own_axis_code.py").write_text(CODE)
    text = example("linear")
    start, end = text.index("# One table per unknown"), text.index("[limits]")
    control, log = text.index("# Optional: the controller"), text.index("# Columns of a recorded")
    kept = text[:start] + text[end:control] + text[log:]

    def named(name):
        path = tmp_path / "axis.toml"
        path.write_text(kept.replace("coordinate =", f'python = "{name}"\ncoordinate =', 1))
        return path

    yield named
    for own in [name for name in sys.modules if name.startswith("jaxid_axis_")]:
        del sys.modules[own]


@pytest.mark.parametrize("name", ["own_axis_code:axis", "own_axis_code:make"])
def test_python_code_runs_only_if_that_is_allowed(coded, name):
    path = coded(name)
    with pytest.raises(ValueError, match=f"refers to Python code .{name}.; add --run-python"):
        read_axis(path)
    assert not [name for name in sys.modules if name.startswith("jaxid_axis_")]
    found = read_axis(path, run_python=True)
    assert found.system.names == ("m", "b")
    # acceleration limit by (18) with these terms: (10 − 1·2)/2
    np.testing.assert_allclose(found.task.limits.acceleration, [-4.0, 4.0])
    before = found.digest
    code = path.parent / "own_axis_code.py"
    code.write_text(code.read_text().replace("0.3", "0.4"))
    again = read_axis(path, run_python=True)
    assert again.digest != before
    assert float(again.system.disturbance_bound(jnp.zeros(()), jnp.zeros(()))) == 0.4
    path.write_text(path.read_text() + "[disturbance]\nlevel = 9.0\n")
    with pytest.raises(ValueError, match=r"either by .*terms.* or by `python`"):
        read_axis(path, run_python=True)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("own_axis_code:nothing", "must be module:object, but .*has no 'nothing'"),
        ("no_such_module:axis", "must be module:object, with module.py in the folder"),
        ("own_axis_code:terms", "must name a jaxid.System, .*, but own_axis_code:terms is a tuple"),
        ("own_axis_code:other", "must agree with .*, linear and V, but is linear"),
    ],
)
def test_python_names_that_are_no_axis(coded, name, sentence):
    with pytest.raises(ValueError, match=sentence):
        read_axis(coded(name), run_python=True)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("import beside", "in line 1 raises ModuleNotFoundError: No module named 'beside'"),
        ("1 / 0", "in line 1 raises ZeroDivisionError: division by zero"),
        ("def (", "raises SyntaxError"),
        ("exit(0)", "in line 1 raises SystemExit"),
    ],
)
@pytest.mark.parametrize("relative", [False, True])
def test_code_that_does_not_run_is_refused_in_a_sentence(
    coded, line, sentence, relative, monkeypatch
):
    path = coded("own_axis_code:axis")
    code = path.parent / "own_axis_code.py"
    code.write_text(f"{line}\n{code.read_text()}")
    monkeypatch.chdir(path.parent)
    with pytest.raises(
        ValueError, match=f"own_axis_code.py must run without an error, but.*{sentence}"
    ):
        read_axis(Path(path.name) if relative else path, run_python=True)


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ("jnp.tanh(v)", r"raises NameError: name 'jnp' is not defined"),
        ("math.tanh(v)", r"raises TypeError: "),
        ("v if v > 0 else -v", r"raises \w+Error: "),
    ],
)
def test_a_regressor_that_takes_no_arrays_is_refused_in_a_sentence(coded, body, sentence):
    path = coded("own_axis_code:axis")
    code = path.parent / "own_axis_code.py"
    own = f"import math\nfrom jaxid import Custom\ndef own(y, v):\n    return {body}\n"
    code.write_text(own + code.read_text().replace("jd.Viscous()", "Custom(own)"))
    with pytest.raises(ValueError, match=f"must run without an error, but in line 4 {sentence}"):
        read_axis(path, run_python=True)


def test_one_level_of_the_disturbance_is_enough(read):
    one = read(("slow = 0.25 ", "#"), ("threshold = 0.1 ", "#")).system.disturbance_bound
    assert eqx.tree_equal(one, ConstantBound(0.15))


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[0.08, 0.18]", "[0.08]", r"`interval` in entry 1 .*\(M\) must be a list of 2 numbers"),
        ("gain = 1.0", "gain = 1.0\ngain = 2.0", r"line 13, `gain = 2.0 .* stands there twice"),
        ("[servo]", "[servo]\n[servo]", r"line 16, `\[servo\]`, .* a table stands there twice"),
        ("[servo]", "[servo", r"axis.toml: line \d+, .* is no valid TOML"),
        (
            'kind = "coulomb"',
            'kind = "columb"',
            r"`kind` in entry 3 of \[\[terms\]\] \(Fc\) must be one of inertia, .*'columb'",
        ),
        (
            'kind = "inertia"',
            'kind = "constant"',
            "first of the .* must have kind = .inertia., but .* constant, viscous",
        ),
        (
            "beta = 1000.0",
            'beta = "steep"',
            r"`beta` in entry 3 of .* must be a number, but is text",
        ),
        ('name = "M"', 'name = "m/M"', r"`name` is used as a folder name.*'m/M'"),
        ("beta = 1000.0", "", r"Entry 3 of \[\[terms\]\] \(Fc\) must have an entry `beta`"),
        (
            "jerk =",
            "jrek =",
            r"\[limits\] has the unknown entry `jrek`; it may have position, velocity",
        ),
        ('name = "M"', 'name = ".."', "`name` is used as a folder name"),
        ('name = "M"', 'name = "all"', "`name` must not be all or wanted"),
        ("duration = 0.6 ", "duration = 1e300 ", "`motion.duration` = 1e.300 s must be at most 10"),
        ("delay = 0 ", "delay = 99999999 ", "`delay` must be 0 to 10000"),
        ("[0.08, 0.18]", "[0.18, 0.08]", "lower end below its upper end"),
        (
            "[0.08, 0.18]",
            "[0.08, nan]",
            r"`interval` must be finite.*, in entry 1 of \[\[terms\]\] \(M\)",
        ),
        ("start = 0.0 ", "start = inf ", r"`start` must be finite, but is inf, in \[motion\]"),
        (
            "# settle = 0.1 ",
            "settle = 0.105 ",
            "`motion.settle` = 0.105 s must be a whole multiple",
        ),
        ("# settle = 0.1 ", "settle = -0.1 ", "`motion.settle` must be 0 s or more, but is -0.1 s"),
        (
            "# [wanted]\n# M = 0.004",
            "[wanted]\nK = 0.004",
            r"\[wanted\] must have names of parameters, M, B, .*, but has 'K'",
        ),
        ("# [wanted]\n# M = 0.004", "[wanted]\nM = 0.0", "`wanted.M` must be above zero"),
        (
            "coordinate =",
            'python = "os:getcwd"\ncoordinate =',
            "either by .*terms.* or by `python`",
        ),
        ("gain = 1.0", "gain = 0.0", r"`gain` must not be zero, in \[input\]"),
        ("delay = 0 ", "delay = -1 ", r"`delay` must be 0 to 10000, but is -1, in \[input\]"),
        ("delay = 0 ", "delay = 0.5 ", "`input.delay` must be a whole number, but is a fraction"),
        ('unit = "V" ', 'unit = "kg" ', "`input.unit` must be one of A, N, N m, V, but is 'kg'"),
        (
            "knot_period = 0.01",
            "knot_period = 0.007",
            "`motion.duration` = 0.6 s must be a whole multiple of `motion.knot_period`",
        ),
        (
            "knot_period = 0.01",
            "knot_period = 0.0",
            "`motion.duration` = 0.6 s must be a whole multiple of `motion.knot_period`",
        ),
        (
            "period = 0.0002 ",
            "period = 0.00021 ",
            "`servo.period` = 0.00021 s must divide the duration",
        ),
        ("resolution = 0.5e-6", "resolution = -1.0", "`servo.resolution` must be at least"),
        ("slow = 0.25 ", "#", "must have both `slow` and `threshold`, or neither"),
        ("level = 0.15", "level = 0.0", "`disturbance.level` must be positive and finite"),
        (
            "at = 0.5",
            "at = 2.0",
            r"`at` in \[\[motion.via\]\] must be a fraction of the whole time",
        ),
        ("velocity = [-2.0, 2.0]", "velocity = [1.0, 2.0]", "`limits.velocity` must contain zero"),
        ("k2 = 40.0 ", "k2 = -40.0 ", "`controller.k2` must be positive"),
        ("M = 1e-4,", "M = inf,", "`gamma` must be finite"),
        (
            "B = 1.0,",
            "b = 1.0,",
            r"\[controller.gamma\] must have names of parameters, .* but has 'b'",
        ),
        (
            'position_unit = "m"',
            'position_unit = "deg"',
            "`log.position_unit` must be m, mm, um, nm",
        ),
        (
            'time_unit = "s"',
            "time_unit = 0.0",
            "`log.time_unit` must be s, ms, us, ns, or a number above zero, but is 0",
        ),
        ('position = "position_m"', "", r"\[log\] must have an entry `position`"),
    ],
)
def test_what_cannot_be_is_refused(read, old, new, sentence):
    with pytest.raises(ValueError, match=sentence):
        read((old, new))


def test_a_wrong_pitch_is_refused(read):
    cogging = 'kind = "cogging"\npitch = 0.0'
    with pytest.raises(
        ValueError, match=r"`pitch` must be above zero.*, in entry 4 of \[\[terms\]\]"
    ):
        read(('kind = "constant"', cogging))


def test_a_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "axis.toml"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(ValueError, match=r"File .*axis.toml must be text in UTF-8"):
        read_axis(path)
