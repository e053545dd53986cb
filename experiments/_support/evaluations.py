"""What motions are worth, as rows of tables: one per motion and parameter."""

from collections.abc import Mapping

from jaxid.design.evaluation import Evaluation
from jaxid.io.files import Cell

Row = dict[str, Cell]
WORTH = ("J_lse", "predicted", "lower_bound", "gap")  # columns


def rows_of(worth: Mapping[str, Evaluation], label: str, names: tuple[str, ...]) -> list[Row]:
    """Errors, lower bound, and gap = predicted / lower bound − 1.

    Args:
        worth: of each motion, by what it is called.
        label: the column for that.
        names: of the parameters.
    """
    return [
        {label: motion, "parameter": name, **dict(zip(WORTH, numbers, strict=True))}
        for motion, one in worth.items()
        for name, numbers in zip(names, one.by_parameter, strict=True)
    ]
