"""Texts that come with the package: the pages of the guide, and example axis files."""

from importlib import resources
from typing import Literal

_FIRST = "index"


def guide_page(name: str = "") -> str:
    """Return the text of a page of the guide in Markdown, or of a file of the guide.

    Args:
        name: name of the page, or of a file such as jog.csv; default the list of pages.

    Raises:
        ValueError: if there is no such page.
    """
    files = {
        file.name.removesuffix(".md"): file
        for file in (resources.files("jaxid") / "guide").iterdir()
        if file.is_file()
    }
    page, names = name or _FIRST, ", ".join(sorted(files))
    if page not in files:
        raise ValueError(f"The guide has no page {page!r}; its pages are {names}.")
    return files[page].read_text(encoding="utf-8")


def example(coordinate: Literal["linear", "rotary"]) -> str:
    """Return the text of an example axis file, with comments.

    Args:
        coordinate: "linear" (m) or "rotary" (rad).
    """
    return (resources.files("jaxid.axis") / "templates" / f"{coordinate}.toml").read_text(
        encoding="utf-8"
    )
