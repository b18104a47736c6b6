"""How many requests to an original node are under way, by what the link carries."""

from __future__ import annotations

from mocha_link.clock import Instant

# An original server replies in order. As many as keep the link busy, by the sizes seen so far.
MIN_WINDOW, MAX_WINDOW = 16, 256
_GUESS_BYTES = 512  # of a message, while none has come
_LARGE_BYTES = 8192  # the same where more must not come than was meant to
_AHEAD_BYTES = 64 * 1024
_AHEAD_S = 0.25
_WEIGHT = 0.125  # of a new size in the average


class RequestWindow:
    """Measures the replies of one pull, and says how many requests may be under way.

    Attributes:
        size: that many.
        fetched_s: when the list came, or the last message, steady clock.
    """

    def __init__(self) -> None:
        self.size = MIN_WINDOW
        self.fetched_s = 0.0
        self._listed_s = 0.0  # when the list came
        self._fetched_bytes = 0  # of replies with messages
        self._reply_bytes = float(_GUESS_BYTES)  # of one, smoothed

    def listed(self, now: Instant) -> None:
        """The list of headers has come."""
        self._listed_s = self.fetched_s = now.steady_s

    def fetched(self, size: int, now: Instant) -> None:
        """A reply with a message has come."""
        self.fetched_s = now.steady_s
        self._fetched_bytes += size
        self._reply_bytes += _WEIGHT * (size - self._reply_bytes)

    @property
    def bandwidth_bytes_s(self) -> float | None:
        """Bytes per second from the list to the last message; None without any message."""
        taken_s = self.fetched_s - self._listed_s
        return self._fetched_bytes / taken_s if self._fetched_bytes and taken_s > 0 else None

    def adapt(self, rate_bytes_s: float | None, rtt_s: float | None) -> None:
        """Adapt to the rate and round trip of the link, as far as they are known."""
        ahead = float(_AHEAD_BYTES)
        if rate_bytes_s:
            ahead = max(ahead, rate_bytes_s * ((rtt_s or 0.0) + _AHEAD_S))
        self.size = int(min(max(ahead / self._reply_bytes, MIN_WINDOW), MAX_WINDOW))

    def limit(self, left_bytes: int, messages: int) -> None:
        """Have no more come than so many bytes, by the sizes of the messages that have come."""
        seen = self._fetched_bytes / max(messages, 1) or _LARGE_BYTES
        self.size = min(self.size, max(int(left_bytes / max(self._reply_bytes, seen)), 1))
