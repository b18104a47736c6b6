"""Credit: the bytes that the peer may send ahead on the connection of a pull.

A connection buffers megabytes on a slow link, and urgent messages cannot overtake that buffer.
The pulling node therefore grants just enough credit to keep the link busy.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

GRANT = struct.Struct(">QI")  # bytes since the beginning, largest frame

MIN_WINDOW = 32 * 1024
FIRST_WINDOW = 64 * 1024
KNOWN_WINDOW = 512 * 1024  # the initial limit: the link may be slower than last time
MAX_WINDOW = 32 * 1024 * 1024
MIN_CHUNK, MAX_CHUNK = 2816, 1024 * 1024  # at least: two segments of TCP
SHARED_CHUNK = 60 * 1024  # at most over a connection of the peer, which limits requests
_QUEUE_S = 0.15  # data that may be buffered beyond a round trip
_GROWTH = 1.5  # margin on the measured rate, so that it can rise
_CHUNKS = 32  # frames per window: an incomplete frame is lost when the link breaks
_GRANTS = 4  # per window
_MEMORY_S = 0.5  # the rate is averaged over one to two of these: bytes arrive in bursts


class _Mark(NamedTuple):
    """The bytes received by a time."""

    at_s: float
    received: int


class Credit:
    """The pulling node's account of one connection.

    Args:
        rate_bytes_s, rtt_s: measured in the last contact; None: not known.
        max_chunk: the largest frame that the connection accepts.
    """

    def __init__(
        self, rate_bytes_s: float | None, rtt_s: float | None, max_chunk: int = MAX_CHUNK
    ) -> None:
        self.received = 0  # bytes so far
        self._max_chunk = max_chunk
        self._rtt_s = rtt_s
        self._window = FIRST_WINDOW  # bytes that may be in flight
        self._allowed = FIRST_WINDOW  # total bytes granted so far
        if rate_bytes_s and rtt_s:
            self._adapt(rate_bytes_s)
            self._window = min(self._window, KNOWN_WINDOW)
            self._allowed = self._window
        self._marks: tuple[_Mark, _Mark] | None = None  # the rate is measured from the first one
        self._granted_at = 0  # `received` at the last grant

    @property
    def grant(self) -> bytes:
        """The encoded grant for the peer."""
        chunk = min(max(self._window // _CHUNKS, MIN_CHUNK), self._max_chunk)
        return GRANT.pack(self._allowed, chunk)

    def take(self, size: int, now_s: float, rtt_s: float | None) -> bool:
        """Count received bytes; returns whether to send a new grant."""
        self.received += size
        if rtt_s:  # the lowest: queueing delay must not enlarge the window
            self._rtt_s = min(rtt_s, self._rtt_s or rtt_s)
        here = _Mark(now_s, self.received)
        earlier, later = self._marks = self._marks or (here, here)
        if self.received - self._granted_at < self._window // _GRANTS:
            return False
        self._granted_at = self.received
        passed_s = now_s - earlier.at_s
        if passed_s > 0 and self._rtt_s:
            self._adapt((self.received - earlier.received) / passed_s)
            if now_s - later.at_s > max(_MEMORY_S, 4 * self._rtt_s):
                self._marks = later, here
        self._allowed = max(self._allowed, self.received + self._window)
        return True

    def _adapt(self, rate_bytes_s: float) -> None:
        window = rate_bytes_s * ((self._rtt_s or 0) + _QUEUE_S) * _GROWTH
        self._window = int(min(max(window, MIN_WINDOW), MAX_WINDOW))
