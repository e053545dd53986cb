"""A result folder is the old or the new one: if writers are killed, fail or run in parallel."""

import hashlib
import json
import os
import shutil
import threading
from pathlib import Path

import pytest

from jaxid.io import exchange, locks
from jaxid.io.results import read_result, write_result
from tests.processes import finish, start
from tests.writers import MINE, NAMES, NEW, OLD, PART, begun, snapshot

VERSIONS = [{name: data.decode() for name, data in files.items()} for files in (OLD, NEW)]


def printed(what, folder):
    """Run `tests.writers`, which forks and kills processes, and return what it printed."""
    (text,) = finish(start("-m", "tests.writers", what, folder))
    return [json.loads(line) for line in text.splitlines()]


def is_whole(files):
    """Return whether the files are those of one result; their digests are recomputed here."""
    manifest = json.loads(files["manifest.json"])
    for part in manifest["parts"].values():
        for name, digest in part["files"].items():
            assert hashlib.sha256(files[name].encode()).hexdigest() == digest
    return {files[name].split()[0] for name in NAMES} in ({"old"}, {"new"})


def without(files, names):
    return {name: text for name, text in files.items() if name not in names}


def test_a_writer_that_is_killed_leaves_the_old_or_the_new_one(tmp_path):
    found = printed("moments", tmp_path / "slide")
    assert len(found) > 40
    seen = []
    for one in found:
        assert is_whole(one["left"])
        assert without(one["left"], (*NAMES, "manifest.json")) == MINE
        assert one["read"] in VERSIONS
        seen.append(VERSIONS.index(one["read"]))
        # the next writer removes what was left
        assert {path.split("/")[0] for path in one["next"]} == {"slide"}
        assert is_whole({path.removeprefix("slide/"): x for path, x in one["next"].items()})
    assert seen == sorted(seen)  # it changes from old to new once
    assert set(seen) == {0, 1}


def test_without_an_exchange_there_is_none_for_an_instant_but_no_mixture(tmp_path):
    found = printed("renames", tmp_path / "slide")
    absent = [one for one in found if not one["left"]]
    assert len(absent) == 1
    for one in found:
        if one["left"]:
            assert is_whole(one["left"])
            assert without(one["left"], (*NAMES, "manifest.json")) == MINE
        assert one["read"] in VERSIONS
        assert {path.split("/")[0] for path in one["next"]} == {"slide"}
        assert (
            MINE.items()
            <= {path.removeprefix("slide/"): x for path, x in one["next"].items()}.items()
        )


def test_a_writer_may_be_killed_at_any_time(tmp_path):
    found = [one["left"] for one in printed("times", tmp_path / "slide")]
    for left in found:
        assert is_whole(left)
        assert without(left, (*NAMES, "manifest.json")) == MINE
    assert len({left["design.json"] for left in found}) == 2


@pytest.mark.parametrize("locked", ["first", "first_unlocked"])
def test_of_those_who_begin_at_once_one_is_first(tmp_path, locked):
    for k, one in enumerate(printed(locked, tmp_path)):
        assert sorted(one["codes"]) == [0, 1, 1]
        winner = one["codes"].index(0)
        assert without(one["left"], ["manifest.json"]) == {
            name: f"{winner} {name}" for name in NAMES
        }
        assert sorted(one["beside"]) == sorted(str(j) for j in range(k + 1))


def test_those_who_may_replace_each_other_do_so_as_a_whole(tmp_path):
    (found,) = printed("last", tmp_path / "slide")
    assert found["codes"] == [0, 0, 0, 0]
    left = {path.removeprefix("slide/"): text for path, text in found["left"].items()}
    assert {left[name].split()[0] for name in NAMES} in ({"0.39"}, {"1.39"})
    by_hand = {f"by_hand_{k}": "mine" for k in range(40)}
    assert without(left, (*NAMES, "manifest.json")) == MINE | by_hand


def test_two_parts_that_are_written_at_once_are_both_kept(tmp_path):
    for one in printed("parts", tmp_path / "slide"):
        assert one["codes"] == [0, 0]
        assert {"simulate.json", "sweep.json"} <= one["left"].keys()
        manifest = json.loads(one["left"]["manifest.json"])
        assert set(manifest["parts"]) == {"design", "simulate", "sweep"}


FAILING = ("rename", "replace", "link", "mkdir", "fsync", "unlink", "rmdir", "chmod", "scandir")


@pytest.mark.parametrize("name", FAILING)
@pytest.mark.parametrize("can_exchange", [True, False])
def test_what_fails_is_told_and_mixes_nothing(tmp_path, monkeypatch, name, can_exchange):
    """Every call of each system function fails in turn.

    The folder stays one whole result, and the error is raised unless the new result is complete.
    """
    folder, working = tmp_path / "slide", getattr(os, name)
    if not can_exchange:
        monkeypatch.setattr(exchange, "_exchanged", lambda one, other: False)
    for moment in range(100):
        begun(folder)
        count = 0

        def failing(*arguments, moment=moment, **named):
            nonlocal count
            count += 1
            if count == moment + 1:
                raise OSError(28, "No space left on device")
            return working(*arguments, **named)

        with monkeypatch.context() as patched:
            patched.setattr(os, name, failing)
            try:
                write_result(folder, "design", PART, NEW, replace=True)
                told = ""
            except OSError as error:
                told = str(error)
        left = snapshot(folder)
        assert is_whole(left)
        assert without(left, (*NAMES, "manifest.json")) == MINE
        assert "No space left" in told or left["design.json"].startswith("new")
        if count <= moment:
            break
    else:
        pytest.fail("it was called again and again")
    begun(folder)
    assert os.listdir(tmp_path) == ["slide"]


def test_what_a_user_does_while_it_is_replaced_is_kept(tmp_path, monkeypatch):
    """Files that a user adds or edits just before the folders are exchanged are kept."""
    folder, swap = tmp_path / "slide", exchange._swap

    def quick(new, there, old):
        (folder / "late.txt").write_text("late")
        (folder / "photos" / "late.txt").write_text("late, too")
        (folder / "films").mkdir()
        (folder / "films" / "one.mp4").write_text("a film")
        (folder / "edited").write_text("edited")
        os.replace(folder / "edited", folder / "notes.txt")  # as editors save files
        swap(new, there, old)

    begun(folder)
    monkeypatch.setattr(exchange, "_swap", quick)
    write_result(folder, "design", PART, NEW, replace=True)
    left = snapshot(folder)
    assert is_whole(left)
    assert without(left, (*NAMES, "manifest.json")) == MINE | {
        "late.txt": "late",
        "photos/late.txt": "late, too",
        "films/one.mp4": "a film",
        "notes.txt": "edited",
    }


def test_what_a_killed_run_left_replaces_nothing_that_is_newer(tmp_path):
    """A killed run left a replaced folder beside the new one.

    Files that the new folder lacks are moved to it; files that the user has changed there since are
    kept.
    """
    folder, old = tmp_path / "slide", tmp_path / "copy"
    begun(folder)
    write_result(folder, "simulate", PART, {"simulation.json": b"{}"})
    shutil.copytree(folder, old)
    write_result(folder, "design", PART, NEW, replace=True)
    write_result(folder, "simulate", PART, {"other.json": b"{}"}, replace=True)
    (folder / "notes.txt").write_text("gone on")
    (old / "late.txt").write_text("late")
    old.rename(tmp_path / ".slide.jaxid-old-0")
    (tmp_path / ".slide.jaxid-new-0").mkdir()
    write_result(folder, "identify", PART, {"result.json": b"{}"})
    assert os.listdir(tmp_path) == ["slide"]
    left = snapshot(folder)
    assert left.keys() == {*NAMES, *MINE, "manifest.json", "other.json", "result.json", "late.txt"}
    assert is_whole(left)
    assert left["notes.txt"] == "gone on"


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs the names of open files")
def test_all_is_on_the_disk_before_it_counts(tmp_path, monkeypatch):
    """The order of `fsync` is: files, folders that contain them, exchange, parent folder."""
    folder, swap, sync, done = tmp_path / "slide", exchange._swap, os.fsync, []

    def synced(descriptor):
        done.append(Path(os.readlink(f"/proc/self/fd/{descriptor}")).name)
        sync(descriptor)

    def swapped(*places):
        done.append("exchange")
        swap(*places)

    begun(folder)
    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(exchange, "_swap", swapped)
    write_result(folder, "design", PART, NEW, replace=True)
    at = done.index("exchange")
    assert done[:4] == [*NAMES, "manifest.json"]
    assert done[4].startswith(".slide.jaxid-new-")
    assert sorted(done[5:at]) == ["more", "photos"]
    assert done[at + 1 :] == [tmp_path.name]


def test_a_copy_does_where_a_file_has_one_name_only(tmp_path, monkeypatch):
    def refused(*arguments, **named):
        raise OSError(1, "Operation not permitted")

    begun(tmp_path / "slide")
    monkeypatch.setattr(os, "link", refused)
    write_result(tmp_path / "slide", "design", PART, NEW, replace=True)
    assert MINE.items() <= snapshot(tmp_path / "slide").items()


def test_who_writes_waits_for_who_writes_above_or_below(tmp_path, monkeypatch):
    monkeypatch.setattr(locks, "SECONDS", 0.05)
    write_result(tmp_path / "choice" / "all", "design", PART, OLD)
    for busy, wanted in (("choice", "choice/all"), ("choice/all", "choice"), ("choice", "choice")):
        with locks.alone_in(tmp_path / busy) as alone:
            assert alone
            with pytest.raises(TimeoutError, match=r"process has been writing to .* 0.05 s"):
                write_result(tmp_path / wanted, "sweep", PART, {"sweep.nc": b""})
    monkeypatch.setattr(locks, "SECONDS", 10.0)
    with locks.alone_in(tmp_path / "choice"):
        waiting = threading.Thread(
            target=write_result, args=(tmp_path / "choice" / "all", "design", PART, NEW),
            kwargs={"replace": True},
        )  # fmt: skip
        waiting.start()
        waiting.join(0.1)
        assert waiting.is_alive()
        # another folder takes the place of the locked one
        shutil.copytree(tmp_path / "choice", tmp_path / "other")
        (tmp_path / "choice").rename(tmp_path / "away")
        (tmp_path / "other").rename(tmp_path / "choice")
    waiting.join(10.0)
    assert read_result(tmp_path / "choice" / "all", "design")[1] == NEW
    assert read_result(tmp_path / "away" / "all", "design")[1] == OLD


def test_where_nothing_is_locked_what_is_left_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(locks, "_lock", lambda *arguments, **named: False)
    folder = tmp_path / "slide"
    write_result(folder, "design", PART, OLD)
    folder.rename(tmp_path / ".slide.jaxid-old-0")
    with pytest.raises(FileNotFoundError, match=r"slide is missing, .* rename .*slide.jaxid-old-0"):
        read_result(folder, "design")
    write_result(folder, "design", PART, NEW)
    # it may belong to a process that is still writing
    assert (tmp_path / ".slide.jaxid-old-0").exists()
