"""Ports for the programs of a simulation."""

import random
import socket
from typing import Final

PORTS: Final = range(20_000, 32_000)
"""Below the ephemeral ports, of which any program may be given one at any time."""

_CHANCE: Final = random.SystemRandom()  # never the seed: runs with equal seeds are run side by side
_given: Final[set[int]] = set()  # by this process: its programs may not have taken them yet


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

    Raises:
        OSError: no port is left.
    """
    ports = [port for port in PORTS if port not in _given]
    for port in _CHANCE.sample(ports, len(ports)):
        if is_free(kind, "127.0.0.1", port):
            _given.add(port)
            return port
    raise OSError(f"no port from {PORTS.start} to {PORTS.stop - 1} is free")
