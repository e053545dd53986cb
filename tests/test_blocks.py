"""Blocks: each computed once, written whole or not at all, with the same bits in every setting."""

import os
import signal
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental import multihost_utils
from processes import SECONDS, finish, free_port, start

from jaxid.sweep import blocks
from jaxid.sweep.blocks import Work, collect, compute


def squares(data, index):
    return {"square": data[index] ** 2, "pair": jnp.stack([index, -index])}


WORK = Work(squares, np.arange(7.0) / 3, 7, lanes=3)


def contents(path):
    with np.load(path) as archive:
        return dict(archive)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_every_item_once_and_in_order(tmp_path):
    told = []
    compute(WORK, tmp_path, report=lambda done, total: told.append((done, total)))
    assert told == [(0, 3), (1, 3), (2, 3), (3, 3)]
    found = collect(WORK, tmp_path)
    np.testing.assert_array_equal(found["square"], WORK.data**2)
    np.testing.assert_array_equal(found["pair"], [[k, -k] for k in range(7)])
    assert names(tmp_path) == [f"block_00000{k}.npz" for k in range(3)]


def test_finished_blocks_are_not_touched_again(tmp_path):
    compute(WORK, tmp_path)
    for path in tmp_path.iterdir():
        os.utime(path, (1, 1))
    (tmp_path / "block_000001.npz").unlink()
    told = []
    compute(WORK, tmp_path, report=lambda done, total: told.append(done))
    assert told == [2, 3]
    ages = [path.stat().st_mtime == 1 for path in sorted(tmp_path.iterdir())]
    assert ages == [True, False, True]


def test_a_torn_block_is_computed_again(tmp_path):
    compute(WORK, tmp_path)
    torn = tmp_path / "block_000001.npz"
    whole = torn.read_bytes()
    for size in (0, 10, len(whole) // 2):
        torn.write_bytes(whole[:size])
        compute(WORK, tmp_path)
        np.testing.assert_array_equal(collect(WORK, tmp_path)["square"], WORK.data**2)


@pytest.mark.parametrize(
    "other",
    [
        replace(WORK, data=WORK.data + 1e-16),
        replace(WORK, lanes=4),
        replace(WORK, count=6),
        replace(WORK, function=lambda data, index: {"square": data[index] ** 3}),
    ],
    ids=["data", "lanes", "count", "function"],
)
def test_blocks_of_other_work_are_refused(tmp_path, other):
    compute(other, tmp_path)
    with pytest.raises(ValueError, match=r"blocks of other work .* must not be mixed with these"):
        compute(WORK, tmp_path)
    with pytest.raises(ValueError, match=r"block_000000\.npz is missing, or of other work"):
        collect(WORK, tmp_path)


def test_other_flags_of_the_compiler_are_other_work(monkeypatch):
    before = replace(WORK).fingerprint
    assert replace(WORK).fingerprint == before
    monkeypatch.setenv("XLA_FLAGS", os.environ["XLA_FLAGS"] + " --xla_cpu_enable_fast_math=true")
    assert replace(WORK).fingerprint != before


def test_a_process_with_other_inputs_is_refused(tmp_path, monkeypatch):
    def from_process_0(values):
        fingerprint, found = values
        return fingerprint[::-1], found

    monkeypatch.setattr(multihost_utils, "broadcast_one_to_all", from_process_0)
    with pytest.raises(ValueError, match="process 0 has other inputs, options or versions"):
        compute(WORK, tmp_path)


def test_an_interruption_leaves_whole_blocks_and_nothing_else(tmp_path, monkeypatch):
    replace_file, calls = os.replace, []

    def interrupted(source, target):
        calls.append(target)
        if len(calls) == 2:
            raise KeyboardInterrupt
        replace_file(source, target)

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        compute(WORK, tmp_path)
    assert names(tmp_path) == ["block_000000.npz"]
    monkeypatch.undo()
    compute(WORK, tmp_path)
    np.testing.assert_array_equal(collect(WORK, tmp_path)["square"], WORK.data**2)


def test_the_compiled_program_has_no_collective():
    program = jax.jit(lambda data, numbers: blocks._block_or_nothing(WORK, data, numbers))
    text = program.lower(WORK.data, np.zeros(1, np.int32)).compile().as_text() or ""
    assert not any(word in text for word in ("all-reduce", "all-gather", "collective-permute"))


# 13 pendulums with random forces. The program is killed by SIGKILL when `survivors` blocks are in
# place and the next one is written, but not yet renamed.
PENDULUMS = """
import os, signal, sys
from pathlib import Path
import jax, jax.numpy as jnp, numpy as np
from jaxid.sweep.blocks import Work, collect, compute
from jaxid.runtime import configure, connect

def pendulum(damping, index):
    def step(state, force):
        angle, rate = state
        rate = rate + 0.01 * (force - jnp.sin(angle) - damping[index] * rate)
        return (angle + 0.01 * rate, rate), angle

    forces = jax.random.normal(jax.random.fold_in(jax.random.key(0), index), (400,))
    _, angles = jax.lax.scan(step, (1.0 + index, 0.0), forces)
    return {"angle": angles[::50], "work": angles @ forces}

def replace_or_die(source, target):
    global survivors
    if survivors == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    survivors -= 1
    print("block", flush=True)
    replace(source, target)

folder, devices, survivors = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
others = (sys.argv[4], int(sys.argv[5]), int(sys.argv[6])) if sys.argv[4:] else ()
replace, os.replace = os.replace, replace_or_die
configure()
connect(devices, *others)
work = Work(pendulum, np.linspace(0.1, 0.3, 13), 13, lanes=2)
compute(work, folder, devices)
if jax.process_index() == 0:
    np.savez(folder / "all.npz", **collect(work, folder))
"""


def test_the_same_bits_on_any_devices_and_processes_and_after_kill_9(tmp_path):
    def pendulums(name: str, devices: int, survivors: int = -1, *others: object):
        return start("-c", PENDULUMS, tmp_path / name, devices, survivors, *others)

    killed = pendulums("1x2", 2, 3)
    running = [pendulums("1x1", 1)]
    for devices in (1, 2):
        coordinator = f"127.0.0.1:{free_port(20_000 * devices, 20_000 * devices + 10_000)}"
        running += [pendulums(f"2x{devices}", devices, -1, coordinator, 2, k) for k in range(2)]
    _, errors = killed.communicate(timeout=SECONDS)
    assert killed.returncode == -signal.SIGKILL, errors
    # two rounds of two blocks, except the one that was not yet renamed
    assert len(list((tmp_path / "1x2").glob("block_*"))) == 3
    written, *others = finish(pendulums("1x2", 2), *running)
    assert [text.count("block") for text in (written, *others)] == [4, 7, 4, 3, 4, 3]
    expected = contents(tmp_path / "1x1" / "all.npz")
    assert expected["angle"].shape == (13, 8)
    for name in ("1x2", "2x1", "2x2"):
        found = contents(tmp_path / name / "all.npz")
        assert all(found[key].tobytes() == expected[key].tobytes() for key in expected), name
