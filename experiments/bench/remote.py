"""Actions in a separate process, on another processor or with other flags of XLA."""

import multiprocessing
import os
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from typing import Any

from experiments._support.processes import pin
from experiments.bench.timing import Action, timed
from jaxid.runtime import configure

# the flag that `configure` sets, with a threshold that no loop stays below
UNFOLDED = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=0"

Make = Callable[[], Mapping[str, Action]]


class Remote:
    """A process that runs named actions on request; a context manager that ends it."""

    def __init__(self, make: Make, processor: int, flags: str = "") -> None:
        """Start the process, and run every action once."""
        context = multiprocessing.get_context("spawn")
        self._here, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(there, make, processor, flags))
        self._process.start()
        self._here.recv()

    def start(self, name: str) -> None:
        """Start an action."""
        self._here.send(name)

    def wait(self) -> float:
        """Wait for the action to finish, and return the seconds that it took."""
        return self._here.recv()

    def run(self, name: str) -> float:
        """Run an action, and return the seconds that it took."""
        self.start(name)
        return self.wait()

    def __enter__(self) -> "Remote":
        return self

    def __exit__(self, *_: Any) -> None:
        self._here.send(None)
        self._process.join()


def _serve(connection: Connection, make: Make, processor: int, flags: str) -> None:
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flags}".strip()
    pin(processor)
    configure()
    actions = make()
    for action in actions.values():
        timed(action)
    connection.send(0.0)
    while (name := connection.recv()) is not None:
        connection.send(timed(actions[name]))
