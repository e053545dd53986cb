"""Parallel work in several processes, each on its own processor."""

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
    """Yield a pool of processes that share only the cache of compiled code."""
    context = multiprocessing.get_context("spawn")
    arguments = (context.Value("i", 0),)
    with ProcessPoolExecutor(processes, context, _begin, arguments) as workers:
        yield workers


def chained(
    step: Callable[[Item, Result | None], Result], chains: Sequence[Sequence[Item]], processes: int
) -> Iterator[Result]:
    """Yield the results of all items as they are completed, item after item within each chain.

    Each item receives the result of the item before it in its chain. The results do not depend on
    the number of processes. No more chains are under way than there are processes. If an item
    fails, no new item is started, the items of other chains under way are still completed and
    yielded, and then the error is raised.
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
    """Yield the results of a function for all items, as they are completed."""
    yield from chained(partial(_alone, function), [[item] for item in items], processes)


def _alone(function: Callable[[Item], Result], item: Item, last: Result | None) -> Result:
    return function(item)


def processors() -> list[int]:
    """Return the processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def pin(processor: int) -> None:
    """Bind this process to one processor, if the system allows it; call it before `configure`."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {processor})


def make_room(most: int = 30_000) -> None:
    """Clear the caches of compiled code once about half of the memory mappings are in use.

    Linux gives a process 65,530 mappings, and each compiled function takes some of them. When none
    is left, the compiler aborts the process.

    Args:
        most: number of mappings up to which the caches are kept.
    """
    if _MAPPINGS.exists() and _MAPPINGS.read_bytes().count(b"\n") > most:
        jax.clear_caches()


def _begin(counter: "Synchronized[int]") -> None:
    """Bind a worker to one processor: two searches in parallel then take no longer than one."""
    with counter.get_lock():
        pin(processors()[counter.value % len(processors())])
        counter.value += 1
    configure()
