"""Ports for the programs of a simulation."""

import random
import socket
import sys
from itertools import chain
from typing import Final

PORTS: Final = range(20_000, 32_000)
"""Below the ephemeral ports, of which any program may be given one at any time."""

_CHANCE: Final = random.SystemRandom()  # never the seed: runs with equal seeds are run side by side
# By port: of what this process has given, whose programs may not have taken it yet.
_given: Final[dict[int, socket.socket | None]] = {}


def is_free(kind: socket.SocketKind, host: str, port: int) -> bool:
    """Whether no program has that port now."""
    with socket.socket(socket.AF_INET, kind) as probe:
        try:
            probe.bind((host, port))
        except OSError:
            return False
    return True


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """A port of 127.0.0.1 that no program has now; never the same twice.

    Nor, on Linux, the same to two processes that run at the same time.

    Raises:
        OSError: no port is left.
    """
    first = _CHANCE.randrange(len(PORTS))
    for port in chain(PORTS[first:], PORTS[:first]):
        if port not in _given and is_free(kind, "127.0.0.1", port) and _reserved(port):
            return port
    raise OSError(f"no port from {PORTS.start} to {PORTS.stop - 1} is free")


def _reserved(port: int) -> bool:
    """Whether it is this process's from now on, by a name in the kernel that ends with it."""
    lock = None
    if sys.platform == "linux":
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            lock.bind(f"\0air-router port {port}")
        except OSError:
            lock.close()
            return False
    _given[port] = lock
    return True
