import os
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("MPLCONFIGDIR", tempfile.mkdtemp())

import jax
import jax.numpy as jnp
import pytest
from hypothesis import settings

from jaxid.io.files import read_trajectory
from jaxid.motion.trajectory import JerkTrajectory
from jaxid.runtime import configure

# all workers, the programs that tests start and the next run share what they compile
configure()
jax.config.update("jax_numpy_rank_promotion", "raise")

# examples differ from run to run only on purpose; compiling makes the first one slow
settings.register_profile("jaxid", deadline=None, derandomize=True, max_examples=25)
settings.load_profile("jaxid")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Programs first: the longest test must not begin last, on one worker."""
    items.sort(key=lambda item: "test_programs" not in item.nodeid)


# Every compiled function holds memory maps, of which Linux allows a process 65,530; when they run
# out, the compiler crashes. The whole suite on one worker needs more.
MAPS, MOST_MAPS = Path("/proc/self/maps"), 30_000


def pytest_runtest_teardown() -> None:
    if MAPS.exists() and MAPS.read_bytes().count(b"\n") > MOST_MAPS:
        jax.clear_caches()


ROOT = Path(__file__).parent.parent


def tables() -> Path:
    """The tables as they are committed or staged.

    `make reproduce` may find other motions on another processor, and then tables that other
    commands made of the committed motions do not belong to them.
    """
    listed = ["git", "ls-files", "-z", "--", "figures"]
    changed = subprocess.run([*listed, "--modified"], cwd=ROOT, capture_output=True)
    if changed.returncode or not changed.stdout:  # no repository, or nothing was changed
        return ROOT / "figures"
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, check=True).stdout
    folder = Path(tempfile.mkdtemp())
    out = ["git", "checkout-index", "-z", "--stdin", f"--prefix={folder}/"]
    subprocess.run(out, cwd=ROOT, input=names, check=True)
    return folder / "figures"


FIGURES = tables()


@pytest.fixture(scope="session")
def figures() -> Path:
    return FIGURES


@pytest.fixture(scope="session")
def motion() -> JerkTrajectory:
    """The committed design for M at N = 30."""
    return read_trajectory(FIGURES / "trajectory_M_N30.csv")


@pytest.fixture
def quick_compilation() -> Iterator[None]:
    """For what is compiled longer than it runs."""
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)


@pytest.fixture
def key() -> jax.Array:
    return jax.random.key(0)


def uniform_in_box(key: jax.Array, lower: jax.Array, upper: jax.Array, count: int) -> jax.Array:
    share = jax.random.uniform(key, (count, lower.size))
    return lower[None] + share * (upper - lower)[None]


def close(a: jax.Array, b: jax.Array, relative: float) -> bool:
    return bool(jnp.max(jnp.abs(a - b)) <= relative * jnp.max(jnp.abs(b)))
