"""Addresses of names, looked up where waiting for a name server holds up no other peer."""

from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Callable

FRESH_S = 60.0
RETRY_S = 5.0


class Resolver:
    """Turns host names into IPv4 addresses in threads of its own; numbers at once.

    `wake` is called, from such a thread, when an answer is there.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._found: dict[str, tuple[str | None, str, float]] = {}  # address, why not, when
        self._looking: set[str] = set()  # names asked for

    def address(self, host: str) -> str | None:
        """The address, if it is known; otherwise it is being looked up, or `failure` says why."""
        try:
            socket.inet_pton(socket.AF_INET, host)
        except (OSError, ValueError):
            pass
        else:
            return host
        with self._lock:
            address, why, since_s = self._found.get(host, (None, "", -math.inf))
            stale = time.monotonic() - since_s > (RETRY_S if why else FRESH_S)
            if stale and host not in self._looking:
                self._looking.add(host)
                threading.Thread(target=self._look, args=(host,), daemon=True).start()
            return address

    def failure(self, host: str) -> str | None:
        """Why there is no address; None while it is being looked up, or when there is one."""
        with self._lock:
            address, why, _ = self._found.get(host, (None, "", 0.0))
            return None if address or host in self._looking else why or None

    def _look(self, host: str) -> None:
        address, why = None, ""
        try:
            found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM)
            address = str(found[0][4][0])
        except (OSError, UnicodeError) as error:
            why = f"no address for '{host}': {error}"
        with self._lock:
            if address is None:  # name servers go out of reach as robots do
                address = self._found.get(host, (None, "", 0.0))[0]
            self._found[host] = (address, why, time.monotonic())
            self._looking.discard(host)
        self._wake()
