"""Progress of long computations: what is being done, and the share of the work that is done."""

from collections.abc import Callable

# called as each step begins, with its name and the share of the work that is done, from 0 to 1
Report = Callable[[str, float], None]


def silent(message: str, share: float) -> None:
    """Ignore the progress of a computation, as its default does."""


def within(report: Report, first: float, last: float, label: str = "") -> Report:
    """Return the report of a part of the work, which passes it on as progress of the whole.

    Args:
        report: report of the whole.
        first: share of the whole that is done as the part begins.
        last: share of the whole that is done as the part ends.
        label: words before the name of each step; default none.
    """
    return lambda message, share: report(label + message, first + (last - first) * share)
