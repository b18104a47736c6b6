"""Host names become addresses in threads of their own: a name server that hangs delays no peer."""

from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from mocha_link.addresses.limits import FRESH_S, MAX_OF_NAME, RETRY_S
from mocha_link.hosts import host_of


@dataclass(frozen=True, slots=True)
class _Found:
    """What the last resolution of a name found."""

    hosts: tuple[str, ...] = ()
    failure: str = ""  # why there was nothing; `hosts` are of a resolution before then
    at_s: float = -math.inf  # steady seconds


class Resolver:
    """Turns host names into addresses, IPv4 and IPv6. Every method returns at once.

    Args:
        wake: called from another thread when it has a result.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._found: dict[str, _Found] = {}  # by name
        self._resolving: set[str] = set()  # names that a thread resolves

    def hosts(self, name: str) -> tuple[str, ...]:
        """The addresses of a name, in the order of the system's preference.

        Empty: resolution is under way, or `failure` has the reason. Those of before stay while the
        name server is out of reach.
        """
        with self._lock:
            found = self._found.get(name, _Found())
            if time.monotonic() - found.at_s > (RETRY_S if found.failure else FRESH_S):
                self._begin(name)
            return found.hosts

    def failure(self, name: str) -> str | None:
        """Why resolution failed; None while it is under way, or when there is an address."""
        with self._lock:
            found = self._found.get(name, _Found())
            return None if found.hosts or name in self._resolving else found.failure or None

    def again(self, name: str) -> None:
        """Resolve a name anew, since its addresses did not help; at most every `RETRY_S`."""
        with self._lock:
            if time.monotonic() - self._found.get(name, _Found()).at_s > RETRY_S:
                self._begin(name)

    def _begin(self, name: str) -> None:
        """Resolve a name in a thread, unless one does; with the lock."""
        if name in self._resolving:
            return
        self._resolving.add(name)
        try:
            threading.Thread(target=self._resolve, args=(name,), daemon=True).start()
        except RuntimeError as error:  # the system has none left
            self._note(name, (), f"cannot resolve '{name}': {error}")

    def _note(self, name: str, hosts: tuple[str, ...], failure: str) -> None:
        """Note the end of a resolution; with the lock."""
        if not hosts:  # name servers go out of reach as robots do
            hosts = self._found.get(name, _Found()).hosts
        self._found[name] = _Found(hosts, failure, time.monotonic())
        self._resolving.discard(name)

    def _resolve(self, name: str) -> None:
        hosts: tuple[str, ...] = ()
        failure = ""
        try:
            found = socket.getaddrinfo(name, None, 0, socket.SOCK_STREAM)
            each = [host_of(address) for *_, address in found if isinstance(address[0], str)]
            hosts = tuple(dict.fromkeys(each))[:MAX_OF_NAME]
        except (OSError, UnicodeError) as error:
            failure = f"no address for '{name}': {error}"
        with self._lock:
            self._note(name, hosts, failure)
        self._wake()
