"""The pages of the guide, which are Markdown files of the package."""

from importlib import resources

from jaxid._checks import require

_FIRST = "index"


def guide_page(name: str = "") -> str:
    """Return the text of a page of the guide, in Markdown.

    Args:
        name: name of the page; default the list of pages.

    Raises:
        ValueError: if there is no such page.
    """
    folder = resources.files("jaxid") / "guide"
    names = sorted(file.name[:-3] for file in folder.iterdir() if file.name.endswith(".md"))
    page = name or _FIRST
    require(page in names, f"The guide has no page {page!r}; its pages are {', '.join(names)}.")
    return (folder / f"{page}.md").read_text(encoding="utf-8")
