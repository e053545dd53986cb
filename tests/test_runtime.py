"""What a program switches on: the folder of compiled code, and nothing on import."""

import os
import stat
import time
from pathlib import Path

import pytest
from processes import finish, start

from jaxid.runtime import _make_room, compilation_folder

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
    (printed,) = finish(start("-c", PROGRAM, JAX_COMPILATION_CACHE_DIR="", **variables))
    return printed.strip().rpartition(" ")[::2]


def test_a_second_process_reads_what_the_first_has_compiled(tmp_path):
    first, hit = run(XDG_CACHE_HOME=tmp_path)
    assert hit == "False"
    kept = list((tmp_path / "jaxid").rglob("*-cache"))
    assert kept
    again, hit = run(XDG_CACHE_HOME=tmp_path)
    assert hit == "True"
    assert again == first


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


def test_the_oldest_entries_make_room(tmp_path):
    now = time.time()
    for k in range(5):
        (tmp_path / f"{k}-cache").write_bytes(bytes(100))
        os.utime(tmp_path / f"{k}-cache", (now, now - 100 + k))
    _make_room(Path(tmp_path), most=250)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["3-cache", "4-cache"]
