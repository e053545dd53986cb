"""Settings of a program: the cache of compiled code, and no change on import."""

import os
import stat
import time
from pathlib import Path

import pytest
from processes import finish, start

import jaxid.runtime
from jaxid.runtime import _make_room, compilation_folder, processors

PROGRAM = """
import jax
from jax._src import monitoring
hits = []
monitoring.register_event_listener(lambda name, **_: hits.append(name))
import jaxid
assert not jax.config.jax_compilation_cache_dir
jaxid.configure()
import jax.numpy as jnp
value = jax.jit(lambda x: jnp.cumsum(jnp.sin(x)))(jnp.arange(5.0))
assert value.dtype == jnp.float64
print(value.tolist(), sum("cache_hits" in name for name in hits) > 0)
"""


def run(**variables):
    """Return the printed value, and whether the cache was used. Warnings are errors."""
    program = ("-W", "error::UserWarning", "-c", PROGRAM)
    (printed,) = finish(start(*program, JAX_COMPILATION_CACHE_DIR="", **variables))
    return printed.strip().rpartition(" ")[::2]


def test_a_second_process_reads_what_the_first_has_compiled(tmp_path):
    fresh, hit = run(XDG_CACHE_HOME=tmp_path, JAX_ENABLE_COMPILATION_CACHE=0)
    assert hit == "False"
    first, hit = run(XDG_CACHE_HOME=tmp_path)
    assert hit == "False"
    kept = list((tmp_path / "jaxid").rglob("*-cache"))
    assert kept
    again, hit = run(XDG_CACHE_HOME=tmp_path)
    assert hit == "True"
    assert again == first == fresh


def test_what_is_written_in_part_is_compiled_again(tmp_path):
    """An incomplete entry is ignored: another process may be writing it.

    An empty one is replaced.
    """
    first, _ = run(XDG_CACHE_HOME=tmp_path)
    kept = list((tmp_path / "jaxid").rglob("*-cache"))
    assert kept
    for entry in kept:
        entry.write_bytes(entry.read_bytes()[:-10])
    assert run(XDG_CACHE_HOME=tmp_path) == (first, "False")
    for entry in kept:
        entry.write_bytes(b"")
    assert run(XDG_CACHE_HOME=tmp_path) == (first, "False")
    assert run(XDG_CACHE_HOME=tmp_path) == (first, "True")


def test_each_number_of_threads_has_its_folder(tmp_path, monkeypatch):
    """XLA splits long loops by the number of threads, which is not part of JAX's cache keys."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folders = [compilation_folder(), compilation_folder()]
    monkeypatch.setenv("NPROC", str(processors() + 1))
    folders.append(compilation_folder())
    monkeypatch.delenv("NPROC")
    monkeypatch.setattr(jaxid.runtime, "processors", lambda: processors() + 1)
    folders.append(compilation_folder())
    assert None not in folders
    assert folders[0] == folders[1]
    assert len(set(folders)) == 3


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", "/proc/none"):
        assert run(XDG_CACHE_HOME=place)[1] == "False"
    assert run(XDG_CACHE_HOME="", HOME=tmp_path / "file")[1] == "False"


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is forbidden to root")
def test_a_folder_that_must_not_be_written_is_none(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    tmp_path.chmod(stat.S_IRUSR | stat.S_IXUSR)
    assert compilation_folder() is None
    tmp_path.chmod(stat.S_IRWXU)


def test_a_folder_of_ones_own_is_left_alone(tmp_path):
    finish(
        start(
            "-c",
            PROGRAM.replace("assert not", "assert"),
            JAX_COMPILATION_CACHE_DIR=tmp_path / "own",
            XDG_CACHE_HOME=tmp_path / "usual",
        )
    )
    assert list((tmp_path / "own").iterdir())
    assert not (tmp_path / "usual").exists()


def test_what_was_used_longest_ago_makes_room_and_what_is_empty(tmp_path):
    now = time.time()
    written = {"a": 100, "b": 90, "read": 95, "c": 80, "empty": 0}  # s before now
    for name, ago in written.items():
        (tmp_path / name).write_bytes(bytes(0 if name == "empty" else 100))
        read = now if name == "read" else now - ago
        os.utime(tmp_path / name, (read, now - ago))
    _make_room(Path(tmp_path), most=400)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c", "read"]
    _make_room(Path(tmp_path), most=250)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c", "read"]
