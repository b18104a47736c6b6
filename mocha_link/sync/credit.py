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
# The same while TCP opens its window: BBR's startup gain, 2 / ln 2, is its growth in a round trip.
_START_GROWTH = 2.9
_RISE, _LEVEL = 1.25, 5  # the window is open after so many measurements without such a rise
_CHUNKS = 32  # frames per window: an incomplete frame is lost when the link breaks
_GRANTS = 4  # per window
_MEMORY_S, _START_MEMORY_S = 0.5, 0.02  # the rate is averaged over one to two of these, at least


class _Mark(NamedTuple):
    """The bytes received by a time."""

    at_s: float
    received: int


class _Meter:
    """Measures the rate at which bytes are received.

    They arrive in bursts, so it is an average: over half a round trip while it rises, over several
    later.

    Attributes:
        starting: the rate still rises, as TCP opens its window.
    """

    def __init__(self) -> None:
        self.starting = True
        self._marks: tuple[_Mark, _Mark] | None = None  # the rate is measured from the first one
        self._highest_bytes_s = 0.0  # the last rate that was higher by `_RISE`
        self._level = 0  # measurements since

    def begin(self, received: int, now_s: float) -> None:
        """Note the first bytes; later calls have no effect."""
        self._marks = self._marks or (_Mark(now_s, received),) * 2

    def rate_bytes_s(self, received: int, now_s: float, rtt_s: float) -> float | None:
        """The current rate; None: it is too early."""
        here = _Mark(now_s, received)
        earlier, later = self._marks or (here, here)
        memory_s = max(_START_MEMORY_S, rtt_s / 2) if self.starting else max(_MEMORY_S, 4 * rtt_s)
        rotates = now_s - later.at_s > memory_s
        since = later if rotates else earlier
        if now_s <= since.at_s:
            return None
        rate_bytes_s = (received - since.received) / (now_s - since.at_s)
        if rotates:
            self._marks = later, here
            self._judge(rate_bytes_s)
        return rate_bytes_s

    def _judge(self, rate_bytes_s: float) -> None:
        """Detect the end of the rise."""
        if rate_bytes_s >= _RISE * self._highest_bytes_s:
            self._highest_bytes_s, self._level = rate_bytes_s, 0
        else:
            self._level += 1
            self.starting = self.starting and self._level < _LEVEL


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
        self._meter = _Meter()
        self._window = FIRST_WINDOW  # bytes that may be in flight
        self._allowed = FIRST_WINDOW  # total bytes granted so far
        if rate_bytes_s and rtt_s:
            self._adapt(rate_bytes_s)
            self._window = min(self._window, KNOWN_WINDOW)
            self._allowed = self._window
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
        self._meter.begin(self.received, now_s)
        if self.received - self._granted_at < self._window // _GRANTS:
            return False
        self._granted_at = self.received
        if self._rtt_s:
            rate_bytes_s = self._meter.rate_bytes_s(self.received, now_s, self._rtt_s)
            if rate_bytes_s is not None:
                self._adapt(rate_bytes_s)
        self._allowed = max(self._allowed, self.received + self._window)
        return True

    def _adapt(self, rate_bytes_s: float) -> None:
        growth = _START_GROWTH if self._meter.starting else _GROWTH
        holds_s = growth * (self._rtt_s or 0.0) + _GROWTH * _QUEUE_S
        self._window = int(min(max(rate_bytes_s * holds_s, MIN_WINDOW), MAX_WINDOW))
