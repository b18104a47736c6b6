"""The peer's connection for one served pull, and the credit that the peer grants on it."""

from __future__ import annotations

from mocha_link.clock import Instant
from mocha_link.sync.credit import GRANT, MAX_CHUNK, MIN_CHUNK
from mocha_link.sync.protocol import Route


class SendConnection:
    """Where frames of a pull go by TCP, and how much.

    Attributes:
        route: the peer's connection; None: it has none.
        since_s: when the pull came to it from another way, steady clock; 0: it began there.
        sent: bytes on it.
        chunk: the largest frame that the peer wants there.
    """

    def __init__(self) -> None:
        self.route: Route | None = None
        self.since_s = 0.0
        self.sent = 0
        self.chunk = MIN_CHUNK
        self._allowed = 0  # bytes that the peer has granted

    def begin(self, route: Route) -> None:
        """The pull begins on a connection."""
        self.route = route

    def move(self, route: Route, now: Instant) -> None:
        """What is sent from now on goes over a connection on which nothing was sent."""
        self.route, self.sent, self.since_s = route, 0, now.steady_s

    def lose(self) -> None:
        """The connection is closed."""
        self.route = None

    def grant(self, raw: bytes) -> None:
        """Take in what may be sent."""
        if len(raw) == GRANT.size:
            allowed, chunk = GRANT.unpack(raw)
            self._allowed = max(self._allowed, allowed)
            self.chunk = min(max(chunk, MIN_CHUNK), MAX_CHUNK)

    @property
    def credit(self) -> int:
        """Bytes that may be sent now."""
        return self._allowed - self.sent

    def spend(self, size: int) -> None:
        """So many bytes were sent."""
        self.sent += size
