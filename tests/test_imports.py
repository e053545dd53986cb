"""Architecture: a folder imports only from folders above it, and imports are not circular."""

import ast
import graphlib
import subprocess
import sys
from pathlib import Path

import jaxid
from jaxid.axis.texts import example

PACKAGE = Path(jaxid.__file__).parent
FOLDERS = (
    "model", "motion", "search", "loop", "regression",
    "identification", "design", "io", "sweep", "axis",
)  # fmt: skip


def modules() -> dict[str, Path]:
    """Return every module of the package, by its dotted name."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(path: Path, known: set[str]) -> set[str]:
    """Return the modules of the package that a file imports.

    Raises an error for relative and dynamic imports, and for imports of experiments or tests.
    """
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        name = node.id if isinstance(node, ast.Name) else getattr(node, "attr", "")
        assert name not in ("import_module", "__import__"), f"{path} imports by {name}"
        if isinstance(node, ast.ImportFrom | ast.Import):
            named = [getattr(node, "module", None) or "", *(alias.name for alias in node.names)]
            assert not any(x.split(".")[0] in ("experiments", "tests") for x in named), path
        if isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path} has a relative import"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= (inner & known) or {node.module}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found & known


def test_the_files_that_name_folders_import_nothing():
    for path in PACKAGE.glob("*/__init__.py"):
        assert not imports_of(path, set(modules())), f"{path} imports"


def floor_of(module: str) -> int:
    """Return the position of a module in the list of folders, −1 for files of the package."""
    parts = module.split(".")
    return FOLDERS.index(parts[1]) if len(parts) > 1 and parts[1] in FOLDERS else -1


def test_the_folders_are_those_of_the_list():
    # the folder guide contains only pages
    there = {path.parent.name for path in PACKAGE.glob("*/*.py")}
    assert there == set(FOLDERS)
    listed = (jaxid.__doc__ or "").partition("imports only from those above it:")[2]
    assert tuple(line.split()[0] for line in listed.strip().splitlines()) == FOLDERS


def test_a_folder_imports_only_from_folders_above_it():
    known = modules()
    for module, path in known.items():
        if module == "jaxid":
            continue
        for imported in imports_of(path, set(known)):
            assert imported != "jaxid", f"{module} imports the package as a whole"
            assert floor_of(imported) <= floor_of(module), f"{module} imports {imported}"


def test_files_form_no_circle():
    known = modules()
    graph = {module: imports_of(path, set(known)) for module, path in known.items()}
    tuple(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError


def test_no_public_name_hides_a_module():
    for name in jaxid.__all__:
        assert f"jaxid.{name}" not in modules()


def test_only_the_plots_draw():
    for module, path in modules().items():
        assert module == "jaxid.io.plots" or "matplotlib" not in path.read_text(), module


def quiet(names: list[str]) -> None:
    """Require that importing these modules starts no computation and changes no setting."""
    program = (
        f"import jax, {', '.join(names)}\n"
        "assert not jax.config.jax_enable_x64\n"
        "assert not jax._src.xla_bridge.backends_are_initialized()\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=PACKAGE.parent)


def test_importing_the_library_computes_and_changes_nothing():
    quiet(list(modules()))


def test_importing_a_program_computes_nothing():
    """A computation before `configure` would be in float32, without the compiler options."""
    root = PACKAGE.parent
    quiet(
        [
            ".".join(path.relative_to(root).with_suffix("").parts)
            for path in sorted((root / "experiments").rglob("*.py"))
            if "casadi" not in path.read_text() and path.stem not in ("__init__", "__main__")
        ]
    )


def test_help_and_guide_import_nothing_that_is_slow():
    program = (
        "import sys; from jaxid.axis.cli import main\n"
        "for words in (['--help'], ['design', '--help'], ['guide', 'faq']):\n"
        "    try: main(words)\n"
        "    except SystemExit as stopped: assert stopped.code == 0\n"
        "print(sorted({'jax', 'numpy', 'scipy', 'matplotlib', 'pandas'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


def test_a_typo_in_a_file_is_told_before_the_library_is_imported(tmp_path):
    (tmp_path / "slide.toml").write_text(example("linear").replace('"viscous"', '"viscos"'))
    program = (
        "import sys; from jaxid.axis.cli import main\n"
        "try: main(['design', 'slide.toml', '--out', 'x'])\n"
        "except SystemExit as stopped: assert stopped.code == 1\n"
        "print(sorted({'jax', 'numpy', 'scipy', 'matplotlib', 'pandas'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=tmp_path
    )
    assert "but is 'viscos'" in done.stderr
    assert done.stdout.splitlines()[-1] == "[]", done.stderr
