"""The list of `make mutants`: its texts occur in their files, and its tests exist."""

import ast
from functools import cache
from pathlib import Path

import pytest
from mutants import require_once
from mutations import MUTATIONS

ROOT = Path(__file__).parent.parent


@cache
def functions_of(file):
    return {
        node.name for node in ast.parse((ROOT / file).read_text()).body if hasattr(node, "name")
    }


def test_every_text_occurs_once_and_every_test_exists():
    assert len({one.name for one in MUTATIONS}) == len(MUTATIONS)
    for one in MUTATIONS:
        require_once(one)
        assert one.replacement != one.source, one.name
        assert one.tests, one.name
        for test in one.tests:
            file, _, function = test.partition("::")
            assert function.partition("[")[0] in functions_of(file), test


def test_a_text_that_is_not_there_once_is_refused():
    """The error names the mutation, its file, and how often the text occurs."""
    none = MUTATIONS[0]._replace(name="nothing halved", source="no such text")
    with pytest.raises(SystemExit, match=rf"“nothing halved” .* once in {none.file}, .* 0 times"):
        require_once(none)
    many = none._replace(source="import ")
    with pytest.raises(SystemExit, match=r"'import ' occurs there [2-9]\d* times"):
        require_once(many)
