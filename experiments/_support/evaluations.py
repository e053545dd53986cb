"""Tables of evaluated motions, with one row per motion and parameter."""

from collections.abc import Mapping

from jaxid.design.evaluation import Evaluation
from jaxid.io.files import Cell

Row = dict[str, Cell]
WORTH = ("J_lse", "predicted", "lower_bound", "gap")  # columns


def rows_of(worth: Mapping[str, Evaluation], label: str, names: tuple[str, ...]) -> list[Row]:
    """Return table rows with errors, lower bound and optimality gap of each motion and parameter.

    The gap is predicted / lower bound − 1.

    Args:
        worth: evaluation of each motion, by the name of the motion.
        label: column for the name of the motion.
        names: names of the parameters.
    """
    return [
        {label: motion, "parameter": name, **dict(zip(WORTH, numbers, strict=True))}
        for motion, one in worth.items()
        for name, numbers in zip(names, one.by_parameter, strict=True)
    ]
