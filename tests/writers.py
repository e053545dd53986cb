"""Processes that write results and are killed, in a program without threads, so that it can fork.

`python -m tests.writers WHAT FOLDER` prints what is left in the folder, one JSON text per line. A
child process is killed by SIGKILL before each change of the file system in turn, or at random
times.
"""

import itertools
import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from jaxid.io import exchange, locks
from jaxid.io.manifest import Part
from jaxid.io.results import read_result, write_result

NAMES = ("trajectory.csv", "setpoints.csv", "design.json")
OLD, NEW = ({name: f"{version} {name}".encode() for name in NAMES} for version in ("old", "new"))
MINE = {"notes.txt": "mine", "photos/one.txt": "my photo", "photos/more/two.txt": "and another"}
PART = Part(program="jaxid 0", command="jaxid design", sources={"axis": "0"})
CHANGES = {
    f"os.{name}" for name in ("rename", "link", "mkdir", "remove", "rmdir", "chmod", "utime")
} | {"open", "shutil.rmtree"}


def begun(folder: Path) -> None:
    """Write the old result, and files of a user in its folder."""
    write_result(folder, "design", PART, OLD, replace=True)
    for name, text in MINE.items():
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_text(text)


def snapshot(folder: Path) -> dict[str, str]:
    """Return all files below a folder, including hidden ones."""
    paths = (Path(at, name) for at, _, names in os.walk(folder) for name in names)
    return {str(path.relative_to(folder)): path.read_bytes().decode() for path in paths}


def killed(do: Callable[[], object], moment: int) -> bool:
    """Call `do` in a child process that is killed before the given change of the file system.

    Return whether it was killed.
    """
    child = os.fork()
    if child == 0:
        count = itertools.count()

        def audited(event: str, _: object) -> None:
            if event in CHANGES and next(count) == moment:
                os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(audited)
        do()
        os._exit(0)
    return _ended(child) == -signal.SIGKILL


def _ended(child: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def moments(folder: Path) -> Iterator[dict[str, object]]:
    """Kill a writer before each change; yield what is left, what is read, and the next result."""
    for moment in itertools.count():
        begun(folder)
        more = killed(lambda: write_result(folder, "design", PART, NEW, replace=True), moment)
        left = snapshot(folder)
        try:
            read = {name: data.decode() for name, data in read_result(folder, "design")[1].items()}
        except ValueError as error:
            read = {"refused": str(error)}
        write_result(folder, "design", PART, OLD, replace=True)
        yield {"left": left, "read": read, "next": snapshot(folder.parent)}
        if not more:
            break


def renames(folder: Path) -> Iterator[dict[str, object]]:
    """Do the same on a system that cannot exchange two folders in one step."""
    exchange._exchanged = lambda one, other: False
    yield from moments(folder)


def times(folder: Path) -> Iterator[dict[str, object]]:
    """Kill a writer at random times after its first result, while it writes more of them."""
    chance = random.Random(0)
    begun(folder)
    for k in range(60):
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            for files in itertools.islice(itertools.cycle((NEW, OLD)), k % 2, None):
                write_result(folder, "design", PART, files, replace=True)
                os.write(writer, b".")
        os.read(reader, 1)
        time.sleep(chance.uniform(0.0, 0.02))
        os.kill(child, signal.SIGKILL)
        _ended(child)
        os.close(reader)
        os.close(writer)
        yield {"left": snapshot(folder)}


def together(count: int, do: Callable[[int], object]) -> list[int]:
    """Call `do` in several processes at once; return their exit codes, 1 for a refusal."""
    reader, writer = os.pipe()
    children = []
    for number in range(count):
        child = os.fork()
        if child == 0:
            os.close(writer)
            os.read(reader, 1)  # returns when all processes have started
            try:
                do(number)
            except (ValueError, FileExistsError):
                os._exit(1)
            except BaseException as error:
                print(repr(error), file=sys.stderr, flush=True)
                os._exit(2)
            os._exit(0)
        children.append(child)
    os.close(writer)
    os.close(reader)
    return [_ended(child) for child in children]


def first(folder: Path) -> Iterator[dict[str, object]]:
    """Let three processes write the same new folder, which none may replace."""
    for k in range(30):
        own = folder / str(k)

        def work(number: int, own: Path = own) -> None:
            files = {name: f"{number} {name}".encode() for name in NAMES}
            write_result(own, "design", PART, files)

        yield {
            "codes": together(3, work),
            "left": snapshot(own),
            "beside": sorted(os.listdir(folder)),
        }


def first_unlocked(folder: Path) -> Iterator[dict[str, object]]:
    """Do the same on a file system that cannot lock folders."""
    locks._lock = lambda descriptor, place, until, *, alone: False
    yield from first(folder)


def last(folder: Path) -> Iterator[dict[str, object]]:
    """Let two processes replace each other's results, while one reads and a user adds files."""
    begun(folder)

    def work(number: int) -> None:
        for k in range(40):
            if number < 2:
                files = {name: f"{number}.{k} {name}".encode() for name in NAMES}
                write_result(folder, "design", PART, files, replace=True)
            elif number == 2:
                found = read_result(folder, "design")[1]
                assert len({data.split()[0] for data in found.values()}) == 1, found
            else:
                (folder / f"by_hand_{k}").write_text("mine")
                time.sleep(0.002)

    yield {"codes": together(4, work), "left": snapshot(folder.parent)}


def parts(folder: Path) -> Iterator[dict[str, object]]:
    """Let two processes write two parts that depend on one result; both must be kept."""
    for k in range(20):
        place = folder / str(k)
        design = write_result(place, "design", PART, OLD)
        own = Part(program="jaxid 0", command="jaxid", results={"design": design.digest})

        def work(number: int, place: Path = place, own: Part = own) -> None:
            name = ("simulate", "sweep")[number]
            write_result(place, name, own, {f"{name}.json": b"{}"})

        yield {"codes": together(2, work), "left": snapshot(place)}


if __name__ == "__main__":
    what, where = sys.argv[1:]
    for found in globals()[what](Path(where)):
        print(json.dumps(found), flush=True)
