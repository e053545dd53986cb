"""Tables as aligned text."""

from collections.abc import Sequence


def text_table(header: Sequence[str], rows: Sequence[Sequence[object]], title: str = "") -> str:
    """Return a table as aligned text; floats have four significant digits, None is a dash.

    Args:
        header: names of the columns.
        rows: cells of each row.
        title: line above the table; default none.
    """
    cells = [list(header), *([_text(cell) for cell in row] for row in rows)]
    widths = [max(len(line[k]) for line in cells) for k in range(len(header))]
    lines = [
        "  ".join(cell.rjust(w) for cell, w in zip(line, widths, strict=True)) for line in cells
    ]
    lines.insert(1, "  ".join("-" * w for w in widths))
    return "\n".join(([title] if title else []) + lines)


def _text(cell: object) -> str:
    if cell is None:
        return "-"
    if isinstance(cell, float):
        return f"{cell:.4g}" if abs(cell) < 1e5 else f"{cell:.3e}"
    return str(cell)
