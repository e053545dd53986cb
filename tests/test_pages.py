"""The pages of documentation: files that they name exist, and their commands can be parsed."""

import functools
import re
import shlex
from pathlib import Path

import pytest

from jaxid.axis import cli

ROOT = Path(__file__).parent.parent
COMMAND_NAMES = ("guide", "init", "prior", "design", "simulate", "identify", "sweep")
README = (ROOT / "README.md").read_text()
GALLERY = (ROOT / "figures" / "README.md").read_text()
MAKEFILE = (ROOT / "Makefile").read_text()
EXPERIMENTS = (ROOT / "experiments" / "README.md").read_text()
GUIDE = [path.read_text() for path in sorted((ROOT / "jaxid" / "guide").glob("*.md"))]
COMMANDS = [
    command
    for page in (README, *GUIDE)
    for block in re.findall(r"^ *```sh\n(.*?)```", page, re.M | re.S)
    for command in re.findall(r"^ *jaxid (.*)$", block, re.M)
]


def test_every_figure_is_in_the_gallery_once_with_the_command_that_made_it():
    shown = re.findall(r"^!\[.+\]\((\S+\.png)\)$", GALLERY, re.M)
    there = sorted(path.name for path in (ROOT / "figures").glob("*.png"))
    assert sorted(shown) == there
    for part in GALLERY.split("\n## ")[1:]:
        title, _, rest = part.partition("\n")
        assert re.fullmatch(r"`make \w+( DATA=\S+)?`: .+", title), title
        assert "![" in rest


@pytest.mark.parametrize(
    "page", [README, GALLERY, EXPERIMENTS], ids=["README", "gallery", "experiments"]
)
def test_every_make_target_that_is_named_exists(page):
    targets = set(re.findall(r"make ([a-z-]+)[ `(\n]", page)) - {"and", "the"}
    assert targets
    for target in targets:
        assert re.search(rf"^{target}:", MAKEFILE, re.M), target


def test_every_file_that_the_list_of_experiments_names_is_there():
    named = set(re.findall(r"`([a-z0-9_]+\.(?:csv|png|nc))`", EXPERIMENTS))
    assert len(named) > 20
    missing = [name for name in named if not (ROOT / "figures" / name).exists()]
    assert not missing


def test_every_link_of_a_page_leads_somewhere():
    pages = ["README.md", "experiments/README.md", "figures/README.md", ".github/CONTRIBUTING.md"]
    for page in pages:
        path = ROOT / page
        for link in re.findall(r"\]\(([^)#:]+)\)", path.read_text()):
            assert (path.parent / link).exists(), f"{page}: {link}"


def test_the_commands_of_readme_and_guide_can_be_typed(monkeypatch):
    """Every command line is parsed and calls its function. Other tests run these functions."""
    called = []
    for name in COMMAND_NAMES:
        function = getattr(cli, name)

        @functools.wraps(function)
        def noted(*arguments, name=name, **named):
            called.append(name)

        monkeypatch.setattr(cli, name, noted)
    for command in COMMANDS:
        cli.main(shlex.split(command.partition(" > ")[0], comments=True))
    assert set(called) == set(COMMAND_NAMES)
    assert len(called) == len(COMMANDS)
