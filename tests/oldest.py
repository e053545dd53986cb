"""The oldest versions that pyproject.toml permits, as constraints for pip: `make oldest`."""

import re
import tomllib
from pathlib import Path

PROJECT = Path(__file__).parent.parent / "pyproject.toml"


def oldest() -> list[str]:
    """Return one `name==version` for each dependency that has a lower bound."""
    project = tomllib.loads(PROJECT.read_text())["project"]
    bounds = [*project["dependencies"], *project["optional-dependencies"]["test"]]
    pairs = (re.fullmatch(r"([\w-]+)>=([\w.]+)", bound) for bound in bounds)
    return [f"{pair[1]}=={pair[2]}" for pair in pairs if pair]


if __name__ == "__main__":
    print("\n".join(oldest()))
