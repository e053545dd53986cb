"""Work shared by processes of one processor each."""

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from typing import TypeVar

import jax

from jaxid.runtime import configure

_MAPPINGS = Path("/proc/self/maps")
Item = TypeVar("Item")
Result = TypeVar("Result")


@contextmanager
def pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that share nothing but what they compile."""
    context = multiprocessing.get_context("spawn")
    arguments = (context.Value("i", 0),)
    with ProcessPoolExecutor(processes, context, _begin, arguments) as workers:
        yield workers


def chained(
    step: Callable[[Item, Result | None], Result], chains: Sequence[Sequence[Item]], processes: int
) -> Iterator[Result]:
    """The results of all items as they come; each is given that of the item before in its chain.

    They do not depend on how many processes share the work. No more chains are under way than there
    are processes. If one fails, the others' items under way are still returned, and nothing new is
    begun.
    """
    if processes == 1:
        for chain in chains:
            last = None
            for item in chain:
                last = step(item, last)
                yield last
        return
    failed: BaseException | None = None
    todo = deque(chain for chain in chains if chain)
    with pool(processes) as workers:

        def submit(chain: Sequence[Item], last: Result | None) -> Future[Result]:
            future = workers.submit(step, chain[0], last)
            rest[future] = chain[1:]
            return future

        rest: dict[Future[Result], Sequence[Item]] = {}
        waiting = {submit(todo.popleft(), None) for _ in range(min(processes, len(todo)))}
        while waiting:
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                chain = rest.pop(future)
                if error := future.exception():
                    failed = failed or error
                    continue
                if chain and not failed:
                    waiting.add(submit(chain, future.result()))
                elif todo and not failed:
                    waiting.add(submit(todo.popleft(), None))
                yield future.result()
    if failed:
        raise failed


def each(
    function: Callable[[Item], Result], items: Sequence[Item], processes: int
) -> Iterator[Result]:
    """The results as they come."""
    yield from chained(partial(_alone, function), [[item] for item in items], processes)


def _alone(function: Callable[[Item], Result], item: Item, last: Result | None) -> Result:
    return function(item)


def processors() -> list[int]:
    """Those that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def pin(processor: int) -> None:
    """Stay on one processor, where the system can be told so; before `configure`."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {processor})


def make_room(most: int = 30_000) -> None:
    """Drop what was compiled, once it takes about half of the mappings Linux gives a process.

    Each compiled function takes some of 65,530; without any left the compiler ends the process.

    Args:
        most: mappings that are left alone.
    """
    if _MAPPINGS.exists() and _MAPPINGS.read_bytes().count(b"\n") > most:
        jax.clear_caches()


def _begin(counter: "Synchronized[int]") -> None:
    """One processor per process: two searches side by side then take no longer than one."""
    with counter.get_lock():
        pin(processors()[counter.value % len(processors())])
        counter.value += 1
    configure()
