"""A folder of results: its manifest, the files that it keeps, and what is refused."""

import hashlib
import json
import os
from pathlib import Path

import pytest

from jaxid.io.manifest import Part, sha256_of
from jaxid.io.results import read_result, require_writable, write_result
from tests.writers import NAMES, NEW, OLD, PART, begun


def test_a_manifest_is_what_other_programs_compute(tmp_path):
    part = write_result(tmp_path / "slide", "design", PART, OLD)
    written = json.loads((tmp_path / "slide" / "manifest.json").read_text())
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in OLD.items()}
    assert written == {
        "parts": {
            "design": {
                "program": "jaxid 0",
                "command": "jaxid design",
                "sources": {"axis": "0"},
                "files": digests,
            }
        }
    }
    lines = "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))
    assert part.digest == hashlib.sha256(lines.encode()).hexdigest()
    for name, digest in digests.items():
        assert sha256_of(tmp_path / "slide" / name) == digest
    assert read_result(tmp_path / "slide", "design") == (part, OLD)


def test_what_a_user_put_in_stays_what_it_is(tmp_path):
    folder = tmp_path / "slide"
    begun(folder)
    (folder / "link").symlink_to("notes.txt")
    os.utime(folder / "notes.txt", (1, 1))
    (folder / "photos").chmod(0o700)
    before = (folder / "notes.txt").stat()
    with (folder / "notes.txt").open("a") as opened:
        write_result(folder, "design", PART, NEW, replace=True)
        after = (folder / "notes.txt").stat()
        assert (after.st_ino, after.st_mtime) == (before.st_ino, 1)
        opened.write(", written on")
    assert (folder / "notes.txt").read_text() == "mine, written on"
    assert os.readlink(folder / "link") == "notes.txt"
    assert (folder / "photos").stat().st_mode & 0o777 == 0o700


def test_what_rests_on_a_result_goes_with_it(tmp_path):
    folder = tmp_path / "slide"
    design = write_result(folder, "design", PART, OLD)
    rests = Part(program="jaxid 0", command="jaxid", results={"design": design.digest})
    write_result(folder, "simulate", rests, {"simulation.json": b"{}"})
    write_result(folder, "identify", PART, {"result.json": b"{}"})
    with pytest.raises(ValueError, match=r"slide/simulation.json already exist; .*finished first"):
        write_result(folder, "design", PART, NEW)
    write_result(folder, "design", PART, OLD, replace=True)  # the same result again
    assert (folder / "simulation.json").exists()
    write_result(folder, "design", PART, NEW, replace=True)
    assert sorted(os.listdir(folder)) == sorted([*NAMES, "manifest.json", "result.json"])
    with pytest.raises(
        ValueError, match=r"The design in .*slide was replaced by another run in the meantime"
    ):
        write_result(folder, "simulate", rests, {"simulation.json": b"{}"}, replace=True)
    below = Part(program="jaxid 0", command="jaxid", results={"slide/design": design.digest})
    with pytest.raises(
        ValueError, match=r"The design in .*slide was replaced by another run in the meantime"
    ):
        write_result(tmp_path, "sweep", below, {"sweep.nc": b""})


def test_what_was_changed_is_not_read(tmp_path):
    folder = tmp_path / "slide"
    with pytest.raises(
        ValueError, match=r"slide must be a result of jaxid design, but has no manifest"
    ):
        read_result(folder, "design")
    write_result(folder, "design", PART, OLD)
    with pytest.raises(ValueError, match=r"by its manifest.json it is one of jaxid design"):
        read_result(folder, "identify")
    (folder / "setpoints.csv").write_text("old setpoints.cs_")
    with pytest.raises(
        ValueError, match=r"setpoints.csv was changed after jaxid design wrote it: restore"
    ):
        read_result(folder, "design")
    (folder / "setpoints.csv").unlink()
    with pytest.raises(ValueError, match=r"setpoints.csv was removed after jaxid design wrote it"):
        read_result(folder, "design")
    (folder / "manifest.json").write_text("{")
    with pytest.raises(ValueError, match=r"no manifest.json that can be read"):
        read_result(folder, "design")


def test_a_folder_of_somebody_else_is_asked_for(tmp_path, monkeypatch):
    folder = tmp_path / "photos"
    folder.mkdir()
    write_result(folder / "run", "identify", PART, OLD)
    # a result in a subfolder does not count as a user's file
    require_writable(folder, NAMES, replace=False)
    for k in range(7):
        (folder / f"{k}.jpg").write_text("mine")
    said = r"photos has files that jaxid did not write \(0.jpg, 1.jpg, 2.jpg, 3.jpg, 4.jpg, …\)"
    with pytest.raises(ValueError, match=said):
        require_writable(folder, NAMES, replace=False)
    with pytest.raises(ValueError, match=said):
        write_result(folder, "design", PART, NEW)
    write_result(folder, "design", PART, NEW, replace=True)
    assert (folder / "6.jpg").read_text() == "mine"
    # the folder now contains a result, and the files of the user
    require_writable(folder, ["sweep.nc"], replace=False)
    with pytest.raises(ValueError, match=r"0.jpg must be a folder, or the name of a new one"):
        require_writable(folder / "0.jpg", NAMES, replace=True)
    monkeypatch.chdir(folder / "run")
    for inside in (Path("."), Path("..")):
        with pytest.raises(
            ValueError, match=f"the current directory is in it: change to {tmp_path}"
        ):
            require_writable(inside, ["sweep.nc"], replace=False)
    with pytest.raises(ValueError, match="is a mount point"):
        require_writable(Path("/proc"), ["sweep.nc"], replace=True)


def test_what_a_user_keeps_under_a_name_of_ours_is_not_replaced(tmp_path):
    """A manifest of another program, or a folder named like a file, is never replaced."""
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "manifest.json").write_text('{"name": "my web app"}')
    (tmp_path / "odd" / "run.csv").mkdir(parents=True)
    for folder, name in (("app", "manifest.json"), ("odd", "run.csv")):
        said = f"{folder} has {name}, which jaxid did not write and does not replace"
        with pytest.raises(ValueError, match=said):
            require_writable(tmp_path / folder, ["run.csv"], replace=True)
        with pytest.raises(ValueError, match=said):
            write_result(tmp_path / folder, "run", PART, {"run.csv": b"1"}, replace=True)
    assert (tmp_path / "app" / "manifest.json").read_text() == '{"name": "my web app"}'
    assert (tmp_path / "odd" / "run.csv").is_dir()


def test_a_place_that_is_no_folder_is_refused_before_long_work(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ValueError, match="file is no folder, or not writable"):
        require_writable(tmp_path / "file" / "x", ["run.csv"], replace=False)
