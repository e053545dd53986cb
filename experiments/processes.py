"""Work shared by processes of one processor each."""

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing.sharedctypes import Synchronized
from typing import TypeVar

from jaxid.runtime import configure

Item = TypeVar("Item")
Result = TypeVar("Result")


def pool(processes: int) -> ProcessPoolExecutor:
    """Processes that know neither one another nor what this one has computed."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(processes, context, _begin, (context.Value("i", 0),))


def each(
    function: Callable[[Item], Result], items: Iterable[Item], processes: int
) -> Iterator[Result]:
    """The results as they come; with one process in this one, in order."""
    if processes == 1:
        yield from map(function, items)
        return
    with pool(processes) as workers:
        for future in as_completed([workers.submit(function, item) for item in items]):
            yield future.result()


def processors() -> list[int]:
    """Those that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def pin(processor: int) -> None:
    """Stay on one processor, where the system can be told so; before JAX starts its threads."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {processor})


def _begin(counter: "Synchronized[int]") -> None:
    """One processor per process: two searches side by side then take no longer than one."""
    configure()
    with counter.get_lock():
        pin(processors()[counter.value % len(processors())])
        counter.value += 1
