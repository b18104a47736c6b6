"""The number of requests in flight to an original node, by the rate of the link."""

from __future__ import annotations

from mocha_link.clock import Instant

# An original server replies in order. The window keeps the link busy, by the sizes received so far.
MIN_WINDOW, MAX_WINDOW = 16, 256
_GUESS_BYTES = 512  # assumed size of a message until one is received
_LARGE_BYTES = 8192  # the same if a budget must not be exceeded
_AHEAD_BYTES = 64 * 1024
_AHEAD_S = 0.25
_WEIGHT = 0.125  # of a new size in the moving average


class RequestWindow:
    """Measures the replies of one pull, and limits the requests in flight.

    Attributes:
        size: the limit.
        fetched_s: when the list or the last message was received, steady seconds.
    """

    def __init__(self) -> None:
        self.size = MIN_WINDOW
        self.fetched_s = 0.0
        self._listed_s = 0.0  # when the list was received
        self._fetched_bytes = 0  # of all replies with messages
        self._reply_bytes = float(_GUESS_BYTES)  # size of a reply, moving average

    def listed(self, now: Instant) -> None:
        """Note that the list of headers was received."""
        self._listed_s = self.fetched_s = now.steady_s

    def fetched(self, size: int, now: Instant) -> None:
        """Note that a reply with a message was received."""
        self.fetched_s = now.steady_s
        self._fetched_bytes += size
        self._reply_bytes += _WEIGHT * (size - self._reply_bytes)

    @property
    def bandwidth_bytes_s(self) -> float | None:
        """Bytes per second from the list to the last message; None without any message."""
        taken_s = self.fetched_s - self._listed_s
        return self._fetched_bytes / taken_s if self._fetched_bytes and taken_s > 0 else None

    def adapt(self, rate_bytes_s: float | None, rtt_s: float | None) -> None:
        """Adapt the limit to the rate and round trip of the link, if they are known."""
        ahead = float(_AHEAD_BYTES)
        if rate_bytes_s:
            ahead = max(ahead, rate_bytes_s * ((rtt_s or 0.0) + _AHEAD_S))
        self.size = int(min(max(ahead / self._reply_bytes, MIN_WINDOW), MAX_WINDOW))

    def limit(self, left_bytes: int, messages: int) -> None:
        """Keep the replies within `left_bytes`, by the sizes of the messages received so far."""
        seen = self._fetched_bytes / max(messages, 1) or _LARGE_BYTES
        self.size = min(self.size, max(int(left_bytes / max(self._reply_bytes, seen)), 1))
