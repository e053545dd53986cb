"""Bounds as text: rounded so that what is printed still holds."""

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Context

_PREFIXES = {0: "", -1: "m", -2: "µ", -3: "n", -4: "p"}


def at_least(value: float, digits: int = 3) -> str:
    """Return a lower bound as text, rounded down to a number of significant digits."""
    return _rounded(value, Context(digits, ROUND_FLOOR))


def at_most(value: float, digits: int = 3) -> str:
    """Return an upper bound as text, rounded up to a number of significant digits."""
    return _rounded(value, Context(digits, ROUND_CEILING))


def above_one(value: float) -> str:
    """Return a lower bound above 1 as text that is above 1, with three digits or as many more."""
    texts = (at_least(value, digits) for digits in range(3, 15))
    return next((text for text in texts if float(text) > 1.0), at_least(value, 15))


def between(low: float, high: float, digits: int = 5) -> str:
    """Return an interval as text that contains it: its ends are rounded outwards."""
    return f"{at_least(low, digits)} … {at_most(high, digits)}"


def quantity(value: float, unit: str) -> str:
    """Return a number with its unit and an SI prefix, such as 0.25 µm for 2.5e-07 m.

    Args:
        value: number, in the unit; up to 12 significant digits are printed.
        unit: unit without a prefix.
    """
    if value == 0 or not math.isfinite(value):
        return f"{value:g} {unit}"
    steps = math.floor(math.log10(abs(value) * (1 + 1e-12)) / 3)
    # 0.25 µm rather than 250 nm, and 0.2 ms rather than 200 µs: the prefix of the larger unit
    steps = steps + 1 if -4 <= steps < 0 and abs(value) >= 0.1 * 1000.0 ** (steps + 1) else steps
    steps = min(max(steps, -4), 0)
    return f"{value / 1000.0**steps:.12g} {_PREFIXES[steps]}{unit}"


def _rounded(value: float, context: Context) -> str:
    # the shortest text of a number is the one that a user typed: 0.1, and not 0.1000000000000000056
    return f"{float(context.create_decimal(repr(float(value)))):.15g}"
