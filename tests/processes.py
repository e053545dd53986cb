"""Start and end of separate processes, for tests of parallel work."""

import os
import socket
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
SECONDS = 300


def start(*arguments: object, **variables: object) -> subprocess.Popen[str]:
    """Start Python with these arguments and these additional environment variables."""
    environment = {"PYTHONPATH": ROOT} | variables
    return subprocess.Popen(
        [sys.executable, *map(str, arguments)],
        cwd=ROOT,
        env=os.environ | {name: str(value) for name, value in environment.items()},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(*processes: subprocess.Popen[str]) -> list[str]:
    """Wait for the processes, require exit code 0, and return what they printed."""
    printed = []
    for process in processes:
        out, err = process.communicate(timeout=SECONDS)
        assert process.returncode == 0, err[-2000:]
        printed.append(out)
    return printed


def free_port(lowest: int, highest: int) -> int:
    """Return a port of this machine on which no process listens."""
    ports = range(lowest, highest)
    first = os.getpid() % len(ports)
    for port in (*ports[first:], *ports[:first]):
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) != 0:
                return port
    raise OSError(f"No port from {lowest} to {highest} is free.")
