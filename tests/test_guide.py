"""The guide: its pages are short and linked, and its commands print what the pages show."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from jaxid.axis import cli
from jaxid.axis.texts import guide_page

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "jaxid" / "guide"
PAGES = sorted(path.stem for path in FOLDER.glob("*.md"))
SCREENS = 125  # lines: two screens


def blocks(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```", page, re.M | re.S)


def test_the_list_names_every_page_once():
    listed = re.findall(r"^\| \[(\w+)\]\((\w+)\.md\)", guide_page(), re.M)
    assert sorted(name for name, _ in listed) == sorted(set(PAGES) - {"index"})
    assert all(name == file for name, file in listed)


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_short_and_its_links_lead_somewhere(name):
    page = guide_page(name)
    assert page.startswith("# ")
    assert len(page.splitlines()) <= SCREENS
    for link in re.findall(r"\]\(([^)#]+)\)", page):
        assert (FOLDER / link).exists(), link
    for target in re.findall(r"`make ([a-z-]+)", page):
        assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.M), target


def test_a_page_is_printed(capsys):
    cli.main(["guide", "delta"])
    assert "Choosing the disturbance bound" in capsys.readouterr().out
    cli.main(["guide"])
    assert "tutorial" in capsys.readouterr().out
    with pytest.raises(SystemExit) as stopped:
        cli.main(["guide", "dleta"])
    assert stopped.value.code == 1
    assert "no page 'dleta'; its pages are bounds, cluster, delta" in capsys.readouterr().err


def test_the_python_of_the_page_about_extensions_runs(capsys):
    code = "".join(blocks(guide_page("extending"), "python"))
    exec(compile(code, "extending.md", "exec"), {})
    assert capsys.readouterr().out.count("[") >= 4


def rows(text):
    """Return the numbers in each row of a table of parameters, by name of the parameter."""
    found = re.findall(r"^ +(M|B|Fc|dbar) +V\S*(?: s\S*)? +(.*)$", text, re.M)
    return {name: [float(x.strip("%")) for x in re.findall(r"-?[\d.]+%?", r)] for name, r in found}


def test_the_tutorial_works_as_printed(tmp_path, monkeypatch, capsys):
    """Tables that depend on a search are compared with a tolerance.

    A search may end differently on another processor.
    """
    monkeypatch.chdir(tmp_path)
    page = guide_page("tutorial")
    parts = re.split(r"^```sh\n", page, flags=re.M)[1:]
    assert len(parts) == 7
    for part in parts:
        (command, rest) = part.split("\n```", 1)
        words, _, file = command.partition(" > ")
        words = shlex.split(words)
        cli.main(words[1:])
        said = capsys.readouterr().out
        if file:
            Path(file).write_text(said)
            assert said == (FOLDER / file).read_text()
        shown = blocks(rest, "text")
        if shown:
            exact = words[1] == "prior" or "jog.csv" in words
            expected, found = rows(shown[0]), rows(said)
            assert len(expected) == 4
            for name, numbers in expected.items():
                tolerance = {"rtol": 2e-3} if exact else {"rtol": 0.3, "atol": 0.2}
                np.testing.assert_allclose(found[name], numbers, **tolerance, err_msg=command)
    # the README shows the same table and assumptions
    readme = blocks((ROOT / "README.md").read_text(), "text")[0]
    assert readme.partition("hold provided that:")[2].strip() in said
    assert rows(readme) == rows(shown[0])
    shown_factor, factor = (re.search(r"at least (\S+)·δ", x) for x in (readme, said))
    assert float(factor[1]) == pytest.approx(float(shown_factor[1]), rel=0.3)
    # the intervals contain the true parameters of the simulated plant
    truth = dict(re.findall(r"(M|B|Fc|dbar) (0\.\d+)[,.]", page))
    assert len(truth) == 4
    for name, (*_, low, high) in rows(said).items():
        assert low <= float(truth[name]) <= high
    exec(compile(blocks(page, "python")[0], "tutorial.md", "exec"), {})
    assert "('M', 'B', 'Fc', 'dbar')" in capsys.readouterr().out
