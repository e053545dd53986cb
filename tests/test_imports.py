"""The architecture, as a table: each room imports only from rooms before it."""

import ast
from pathlib import Path

import jaxid

PACKAGE = Path(jaxid.__file__).parent


def rooms_of_the_docstring() -> list[tuple[str, set[str]]]:
    """Lines `name: imports` of the package docstring, in order."""
    rooms = []
    for line in (jaxid.__doc__ or "").splitlines():
        name, separator, imports = line.strip().partition(" <- ")
        if separator:
            rooms.append((name, set(imports.split(", ")) - {"-"}))
    return rooms


def imports_of(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            parts = node.module.split(".")
            if parts[0] == "jaxid":
                found |= {parts[1]} if len(parts) > 1 else {alias.name for alias in node.names}
    return found


def test_every_module_imports_exactly_what_the_table_says():
    table = dict(rooms_of_the_docstring())
    assert len(table) == len(rooms_of_the_docstring()), "a room is listed twice"
    modules = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__"}
    assert set(table) == modules
    for name, imports in table.items():
        assert imports_of(PACKAGE / f"{name}.py") == imports, name


def test_the_table_flows_one_way():
    seen: set[str] = set()
    for name, imports in rooms_of_the_docstring():
        assert imports <= seen, f"{name} imports {imports - seen}, which stand below it"
        seen.add(name)


def test_only_the_report_draws():
    for path in PACKAGE.glob("*.py"):
        if path.stem != "report":
            assert "matplotlib" not in path.read_text()


def test_importing_the_library_computes_and_changes_nothing():
    import subprocess
    import sys

    program = (
        "import jax\n"
        f"import {', '.join(f'jaxid.{path.stem}' for path in sorted(PACKAGE.glob('[a-z]*.py')))}\n"
        "assert not jax.config.jax_enable_x64\n"
        "assert not jax._src.xla_bridge.backends_are_initialized()\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_importing_a_program_computes_nothing():
    """What runs before `configure` is in float32, and keeps loops from being folded."""
    import subprocess
    import sys

    root = PACKAGE.parent
    names = [
        ".".join(path.relative_to(root).with_suffix("").parts)
        for path in sorted((root / "experiments").rglob("*.py"))
        if "casadi" not in path.read_text() and path.stem not in ("__init__", "__main__")
    ]
    program = (
        f"import jax, {', '.join(names)}\n"
        "assert not jax.config.jax_enable_x64\n"
        "assert not jax._src.xla_bridge.backends_are_initialized()\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=root)
