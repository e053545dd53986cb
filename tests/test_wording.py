"""Messages with the names of the axis file, models as formulas, and numbers with units."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxid._text import quantity
from jaxid.axis.wording import in_words_of_files
from jaxid.model.disturbance_bound import ConstantBound
from jaxid.model.regressors import (
    Constant,
    Coulomb,
    Custom,
    OneWay,
    Regressor,
    Sign,
    Sine,
    Spring,
    Viscous,
)
from jaxid.model.system import System, Term


@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("Argument `input` must contain zero.", "`limits.input` must contain zero."),
        ("Argument `period` of a servo must be positive.", "`servo.period` must be positive."),
        ("Argument `recorded` has no row.", "The log has no row."),
        ("Argument `beta` of a Coulomb regressor must be 1.", "`beta` must be 1."),
        ("Argument `level` of a disturbance bound δ must be 1.", "`disturbance.level` must be 1."),
        ("Argument `unheard` must be 1.", "Argument `unheard` must be 1."),
        ("The log: Argument `home` = 2.", "The log: `motion.home` = 2."),
        (
            "Argument `interval` of the term M must be two numbers.",
            "`interval` of the term M must be two numbers.",
        ),
    ],
)
def test_arguments_become_entries_of_the_file(sentence, expected):
    assert in_words_of_files(sentence) == expected
    assert in_words_of_files(expected) == expected


def of_users(position, velocity):
    return velocity**2


class Drag(Regressor):
    """A regressor of a user, which does not define its formula."""

    def __call__(self, position, velocity):
        return velocity**2

    def magnitude(self, position, velocity):
        raise NotImplementedError

    def range(self, position, velocity):
        raise NotImplementedError


@pytest.mark.parametrize(
    ("regressor", "formula"),
    [
        (None, "M·ÿ"),
        (Viscous(), "M·ÿ + f·ẏ"),
        (Constant(), "M·ÿ + f"),
        (Sign(), "M·ÿ + f·sign(ẏ)"),
        (Coulomb(500.0), "M·ÿ + f·(2/π)·arctan(500·ẏ)"),
        (Spring(), "M·ÿ + f·(y)"),
        (Spring(0.2), "M·ÿ + f·(y − 0.2)"),
        (Spring(-0.2), "M·ÿ + f·(y + 0.2)"),
        (Sine(), "M·ÿ + f·sin(y)"),
        (Sine(-0.5, 0.03), "M·ÿ + f·sin(2π·y/0.03 − 0.5)"),
        (OneWay(Viscous(), False), "M·ÿ + f·[ẏ for ẏ < 0]"),
        (Custom(of_users), "M·ÿ + f·of_users(y, ẏ)"),
        (Custom(lambda y, v: v), "M·ÿ + f·f(y, ẏ)"),
        (Drag(), "M·ÿ + f·Drag(y, ẏ)"),
    ],
)
def test_the_model_is_a_formula(regressor, formula):
    terms = (Term("M", "kg", (1.0, 2.0)),)
    if regressor is not None:
        terms += (Term("f", "N", (0.0, 1.0), regressor),)
    assert System(terms, ConstantBound(1.0), "N").equation == f"u = {formula} + Δ"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (2.5e-7, "0.25 µm"),
        (5e-7, "0.5 µm"),
        (1e-3, "1 mm"),
        (0.4, "0.4 m"),
        (0.05, "50 mm"),
        (12.0, "12 m"),
        (3e-9, "3 nm"),
        (2e-14, "0.02 pm"),
        (0.0, "0 m"),
        (4e7, "40000000 m"),
    ],
)
def test_a_quantity_has_a_prefix_that_is_easy_to_read(value, text):
    assert quantity(value, "m") == text


@given(st.floats(1e-13, 1e9))
def test_a_quantity_keeps_its_value(value):
    number, unit = quantity(value, "s").split()
    factor = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9, "ps": 1e-12}[unit]
    assert float(number) * factor == pytest.approx(value, rel=1e-11)
