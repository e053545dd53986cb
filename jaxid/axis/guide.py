"""The pages of the guide, which are Markdown files of the package."""

from importlib import resources

from jaxid._checks import require

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
    require(page in files, f"The guide has no page {page!r}; its pages are {names}.")
    return files[page].read_text(encoding="utf-8")
