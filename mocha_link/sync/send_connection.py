"""The peer's connection for one served pull, and the credit that the peer grants on it."""

from __future__ import annotations

from mocha_link.clock import Instant
from mocha_link.sync.credit import GRANT, MAX_CHUNK, MIN_CHUNK
from mocha_link.sync.protocol import Route


class SendConnection:
    """The TCP route of a pull, and its credit.

    Attributes:
        route: the peer's connection; None: it has none.
        since_s: when the pull moved to it, steady seconds; 0: it began there.
        sent: bytes sent on it.
        unsent: of these, bytes that wait until TCP's window admits them; None: not known.
        chunk: the largest frame that the peer accepts on it.
    """

    def __init__(self) -> None:
        self.route: Route | None = None
        self.since_s = 0.0
        self.sent = 0
        self.unsent: int | None = None
        self.chunk = MIN_CHUNK
        self._allowed = 0  # total bytes that the peer has granted

    def begin(self, route: Route) -> None:
        """Begin the pull on a connection."""
        self.route = route

    def move(self, route: Route, now: Instant) -> None:
        """Move the pull to another connection, on which nothing was sent yet."""
        self.route, self.sent, self.since_s = route, 0, now.steady_s
        self.unsent = None

    def measured(self, unsent_bytes: int | None) -> None:
        """Note the bytes that wait in the kernel."""
        self.unsent = unsent_bytes

    def lose(self) -> None:
        """Note that the connection was closed."""
        self.route = None

    def grant(self, raw: bytes) -> None:
        """Process a grant of the peer."""
        if len(raw) == GRANT.size:
            allowed, chunk = GRANT.unpack(raw)
            self._allowed = max(self._allowed, allowed)
            self.chunk = min(max(chunk, MIN_CHUNK), MAX_CHUNK)

    @property
    def credit(self) -> int:
        """Bytes that may be sent now."""
        return self._allowed - self.sent

    def spend(self, size: int) -> None:
        """Count sent bytes."""
        self.sent += size
        if self.unsent is not None:
            self.unsent += size
