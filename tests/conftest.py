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

# all workers, the programs that tests start and the next run share one compilation cache
configure()
jax.config.update("jax_numpy_rank_promotion", "raise")

# the same examples in every run; no deadline, because the first example compiles
settings.register_profile("jaxid", deadline=None, derandomize=True, max_examples=25)
settings.load_profile("jaxid")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the tests of programs first: the longest one must not start last, on one worker."""
    items.sort(key=lambda item: "test_programs" not in item.nodeid)


# Every compiled function holds memory maps. Linux allows 65,530 of them per process; with more, the
# compiler crashes. The whole suite on one worker would need more.
MAPS, MOST_MAPS = Path("/proc/self/maps"), 30_000


def pytest_runtest_teardown() -> None:
    if MAPS.exists() and MAPS.read_bytes().count(b"\n") > MOST_MAPS:
        jax.clear_caches()


ROOT = Path(__file__).parent.parent


def tables() -> Path:
    """Return the folder of the tables as they are committed or staged.

    On another processor `make reproduce` may find other motions. Tables made from the committed
    motions by other commands would then not match the motions in the working tree.
    """
    listed = ["git", "ls-files", "-z", "--", "figures"]
    changed = subprocess.run([*listed, "--modified"], cwd=ROOT, capture_output=True)
    if changed.returncode or not changed.stdout:  # no repository, or no changes
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
    """Return the committed design for M at N = 30."""
    return read_trajectory(FIGURES / "trajectory_M_N30.csv")


@pytest.fixture
def quick_compilation() -> Iterator[None]:
    """Compile without most optimisations, for code that takes longer to compile than to run."""
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
