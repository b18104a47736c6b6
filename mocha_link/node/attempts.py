"""Parallel connections to the addresses of one peer, until one is established (RFC 8305)."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterator, Sequence

from mocha_link.node.connection import Connection
from mocha_link.node.kernel import Polled, Poller

STAGGER_S = 0.25
"""The next address is tried this long after the previous one, or when that one has failed."""

STRANGER_S = 1.0
"""An untrusted address is tried this long after the previous one, which may still answer."""


class Attempts:
    """The connection attempts to a peer, and the requests that wait for one of them.

    With keys an attempt succeeds only when its other end has proven the peer's key. An impostor
    therefore does not delay the other attempts.

    Args:
        connect: opens a connection to an address; raises OSError.
        poller: also waits for these connections.
        owner: reported by the poller for these connections.
        trusted: whether an address may be tried without delay; see `AddressBook.is_trusted`.

    Attributes:
        frames: requests to send on the first established connection.
        failure: why the first address failed; None: no address has failed.
    """

    def __init__(
        self,
        connect: Callable[[str], Connection],
        poller: Poller,
        owner: str,
        *,
        trusted: Callable[[str], bool],
    ) -> None:
        self.frames: list[bytes] = []
        self.failure: str | None = None
        self._connect = connect
        self._poller = poller
        self._owner = owner
        self._trusted = trusted
        self._open: dict[str, Connection] = {}  # by address
        self._tried: set[str] = set()
        self._tried_s = 0.0  # when an address was tried last, steady seconds
        self._next_s = 0.0  # when the next address is tried if no attempt has failed, steady
        self._has_more = False  # there is a next address

    def __iter__(self) -> Iterator[str]:
        """The addresses of the running attempts."""
        return iter(self._open)

    def adopt(self, connection: Connection, now_s: float) -> None:
        """Continue a connection that is not established yet, in parallel with others."""
        self.frames = connection.take_waiting()
        self._tried_s = now_s
        self._open[connection.host] = connection
        self._tried.add(connection.host)

    def advance(
        self, hosts: Sequence[str], ready: Container[Polled], now_s: float
    ) -> Connection | None:
        """Drive the attempts, and start the next one if it is due.

        Returns the established connection, which is removed here; None: none is established. The
        connection to a single address is returned at once.
        """
        for host, connection in list(self._open.items()):
            if connection.is_ready(ready, now_s):
                connection.advance(now_s)
            if not connection.failure and connection.stands:
                return self._open.pop(host)
        left = [host for host in hosts if host not in self._tried] if self.frames else []
        self._schedule(left)
        if not left or now_s < self.wake_s:
            return None
        self._tried_s = now_s
        self._schedule(left[1:])
        self._tried.add(left[0])
        try:
            connection = self._connect(left[0])
        except OSError as error:
            self.failure = self.failure or f"cannot connect to {left[0]}: {error}"
            return None
        if len(self._tried) == len(hosts) == 1:
            return connection
        self._open[left[0]] = connection
        return None

    def _schedule(self, left: Sequence[str]) -> None:
        self._has_more = bool(left)
        if left:
            wait_s = STAGGER_S if self._trusted(left[0]) else STRANGER_S
            self._next_s = self._tried_s + wait_s

    def settle(self) -> list[str]:
        """Close failed attempts and register the others; returns the addresses that failed."""
        failed = [host for host, each in self._open.items() if each.failure]
        for host in failed:
            self.failure = self.failure or self._open[host].failure
            self._close(self._open.pop(host))
        for each in self._open.values():
            each.watch(self._poller, self._owner)
        return failed

    def exhausted(self, hosts: Sequence[str]) -> bool:
        """Whether every address was tried, and no attempt is running."""
        return bool(self._tried) and not self._open and self._tried.issuperset(hosts)

    def close(self) -> None:
        """Close the running attempts."""
        for each in self._open.values():
            self._close(each)
        self._open.clear()

    def _close(self, connection: Connection) -> None:
        connection.forget(self._poller)
        connection.abort()

    @property
    def wake_s(self) -> float:
        """When to call `advance` if nothing is received, in steady seconds; inf: never."""
        if not self._has_more:
            return math.inf
        return self._next_s if self._open else -math.inf
