"""Bounds as text: rounded so that what is printed still holds."""

from decimal import ROUND_CEILING, ROUND_FLOOR, Context


def at_least(value: float, digits: int = 3) -> str:
    """Return a lower bound as text, rounded down to a number of significant digits."""
    return _rounded(value, Context(digits, ROUND_FLOOR))


def at_most(value: float, digits: int = 3) -> str:
    """Return an upper bound as text, rounded up to a number of significant digits."""
    return _rounded(value, Context(digits, ROUND_CEILING))


def between(low: float, high: float, digits: int = 5) -> str:
    """Return an interval as text that contains it: its ends are rounded outwards."""
    return f"{at_least(low, digits)} … {at_most(high, digits)}"


def _rounded(value: float, context: Context) -> str:
    return f"{float(context.create_decimal_from_float(value)):.15g}"
