"""Bounds as text: rounded in the safe direction, so that the printed bound holds."""

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from jaxid._text import above_one, at_least, at_most, between

numbers = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e12, max_value=1e12)
digits = st.integers(1, 8)


@given(numbers, digits)
def test_a_printed_bound_is_on_its_side_and_near(value, count):
    """The text is compared with the shortest text of the number, as a user would type it."""
    low, high = Fraction(at_least(value, count)), Fraction(at_most(value, count))
    typed = Fraction(repr(value))
    assert low <= typed <= high
    assert float(low) <= value <= float(high)
    assert high - low <= abs(typed) / 10 ** (count - 1)


def test_what_few_digits_say_is_said_with_few():
    assert at_least(1.2399) == "1.23"
    assert at_least(0.0129999) == "0.0129"
    assert at_least(1.0) == at_most(1.0) == "1"
    assert at_least(-1e-7, 1) == "-1e-07"
    assert at_least(1000.0) == "1000"
    assert between(-0.123456, 0.123454) == "-0.12346 … 0.12346"
    assert between(0.0, 0.5) == "0 … 0.5"
    assert between(0.1, 0.7) == "0.1 … 0.7"


@given(st.floats(1.0 + 1e-9, 5.0))
def test_a_bound_above_one_is_printed_above_one(value):
    text = above_one(value)
    assert 1.0 < float(text) <= value
    assert len(text) <= 4 or value < 1.01
