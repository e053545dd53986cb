"""Mutation test of the bounds, `make mutants`: a term is halved or left out, and a test must fail.

    python tests/mutants.py [NAME...]

This tries every mutation of `mutations.py`, or those whose name contains one of the given words. In
a copy of the package one text is replaced, and the tests that the mutation names are run. The
mutation is killed if one of them fails. It survives if all pass: then no test would notice that the
bound is too small.

The results are kept in `.mutants.json` until the package or one of these tests changes.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from mutations import MUTATIONS, Mutation

ROOT = Path(__file__).parent.parent
KEPT = ROOT / ".mutants.json"
LONGEST = 900  # s, time limit for the tests of one mutation
OWN = ("mutants.py", "mutations.py")  # changes in these files invalidate no result

# run the tests, then print the path of the package that they imported
_RUN = """
import sys, pytest
code = pytest.main(sys.argv[1:])
print(getattr(sys.modules.get("jaxid"), "__file__", None))
sys.exit(code)
"""


class Run(NamedTuple):
    """The result of running some tests in a copy.

    Attributes:
        code: exit code of pytest; None if the time limit was exceeded.
        failed: the first test that failed, and why; None if none failed.
        printed: the whole output.
    """

    code: int | None
    failed: str | None
    printed: str


def main(words: Sequence[str]) -> int:
    """Try all mutations, or those whose name contains a given word; return 0 if all are killed."""
    chosen = [one for one in MUTATIONS if not words or any(word in one.name for word in words)]
    if not chosen:
        raise SystemExit(f"No mutation has a name that contains {' or '.join(words)}.")
    with copied() as folder:
        for one in MUTATIONS:
            require_once(one, folder)
        require_passing({test: None for one in chosen for test in one.tests}, folder)
        results = [tried(one, f"{k} of {len(chosen)}", folder) for k, one in enumerate(chosen, 1)]
    killed, survived = (results.count(result) for result in ("killed", "survived"))
    undecided = len(results) - killed - survived
    print(
        f"{len(results)} mutations: {killed} killed, {survived} survived, {undecided} that no "
        "test decided."
    )
    return int(killed < len(results))


def require_once(one: Mutation, folder: Path = ROOT) -> None:
    """Raise an error unless the text of a mutation occurs exactly once in its file."""
    count = (folder / "jaxid" / one.file).read_text().count(one.source)
    if count != 1:
        raise SystemExit(
            f"The mutation “{one.name}” must name a text that occurs once in {one.file}, but "
            f"{one.source!r} occurs there {count} times."
        )


def require_passing(tests: Iterable[str], folder: Path) -> None:
    """Raise an error if tests fail without a mutation."""
    digests = {test: digest(folder, [test]) for test in tests}
    new = [test for test, own in digests.items() if kept().get(test, {}).get("digest") != own]
    if not new:
        return
    print(f"{len(new)} tests without a mutation … ", end="", flush=True)
    began = time.monotonic()
    found = run(folder, new, len(new) * LONGEST)
    if found.code != 0:
        raise SystemExit(f"{found.failed or found.printed}\nThey must pass, but {ending(found)}.")
    print(f"passed in {time.monotonic() - began:.0f} s", flush=True)
    keep({test: {"digest": digests[test], "result": "passed"} for test in new})


def tried(one: Mutation, number: str, folder: Path) -> str:
    """Return whether a mutation is killed, from the kept results or by running its tests."""
    print(f"{number}: {one.name} … ", end="", flush=True)
    with mutated(folder, one):
        own, known = digest(folder, one.tests), kept().get(one.name, {})
        if known.get("digest") == own:
            print(f"{known['result']}, as before", flush=True)
            return known["result"]
        began = time.monotonic()
        found = run(folder, one.tests, LONGEST)
    seconds = round(time.monotonic() - began)
    if found.code == 1 and found.failed:
        result = "killed"
    elif found.code == 0:
        result = "survived"
    else:
        print(f"neither killed nor survived: {ending(found)}\n{found.printed}", flush=True)
        return "undecided"
    print(f"{result} in {seconds} s", flush=True)
    keep({one.name: {"digest": own, "result": result, "seconds": seconds, "by": found.failed}})
    return result


def run(folder: Path, tests: Sequence[str], seconds: float) -> Run:
    """Run some tests in a copy of the package until the first one fails."""
    report = folder / "report.xml"
    report.unlink(missing_ok=True)
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, (str(folder), os.environ.get("PYTHONPATH")))),
        "PYTHONDONTWRITEBYTECODE": "",  # keep the bytecode for the next run
    }
    try:
        done = subprocess.run(
            [sys.executable, "-c", _RUN, "-x", "-q", f"--junitxml={report}", *tests],
            cwd=folder,
            env=environment,
            timeout=seconds,
            capture_output=True,
            text=True,
        )
    except subprocess.TimeoutExpired:
        return Run(None, None, "")
    printed = done.stdout + done.stderr
    if done.returncode in (0, 1):
        imported = done.stdout.strip().splitlines()[-1]
        if Path(imported) != folder / "jaxid" / "__init__.py":
            raise SystemExit(f"The tests must import the copy in {folder}, but took {imported}.")
    return Run(done.returncode, _first_failure(report), printed)


def _first_failure(report: Path) -> str | None:
    """Return the first failed test and its message; errors before a test runs do not count."""
    cases = ElementTree.parse(report).iter("testcase") if report.exists() else ()
    for case in cases:
        failure = case.find("failure")
        if failure is not None:
            return f"{case.get('name')}: {failure.get('message', '')[:200]}"
    return None


def ending(found: Run) -> str:
    """Return in words how a run of tests ended."""
    if found.code is None:
        return "they took too long"
    return f"pytest ended with exit code {found.code}"


@contextmanager
def copied() -> Iterator[Path]:
    """Yield a temporary folder with the package and everything that its tests need."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        for part in ("jaxid", "experiments", "tests"):
            shutil.copytree(ROOT / part, folder / part)
        shutil.copy2(ROOT / "pyproject.toml", folder)
        (folder / "figures").symlink_to(ROOT / "figures")
        yield folder


@contextmanager
def mutated(folder: Path, one: Mutation) -> Iterator[None]:
    """Apply one mutation to the folder, and undo it afterwards."""
    path = folder / "jaxid" / one.file
    text, state = path.read_text(), path.stat()
    path.write_text(text.replace(one.source, one.replacement))
    yield
    path.write_text(text)
    # with another time stamp, Python would compile the file again
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))


def digest(folder: Path, tests: Sequence[str]) -> str:
    """Return a digest of the package in a folder and of the files that these tests need."""
    files = [*(folder / "jaxid").rglob("*.py"), *(folder / "experiments" / "axes").glob("*.py")]
    helpers = [x for x in (folder / "tests").glob("*.py") if not x.name.startswith("test_")]
    files += [x for x in helpers if x.name not in OWN]
    files += [folder / test.partition("::")[0] for test in tests]
    found = hashlib.sha256(repr(tuple(tests)).encode())
    for file in sorted(set(files)):
        found.update(f"{file.relative_to(folder)}\n".encode() + file.read_bytes())
    return found.hexdigest()[:16]


def kept() -> dict[str, dict]:
    """Return the kept results, by name of the mutation or of the test without a mutation."""
    return json.loads(KEPT.read_text()) if KEPT.exists() else {}


def keep(new: dict[str, dict]) -> None:
    """Add results to the file, which is replaced as a whole."""
    unfinished = KEPT.with_suffix(".new")
    unfinished.write_text(json.dumps(kept() | new, indent=1, ensure_ascii=False))
    unfinished.replace(KEPT)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
