"""What earlier pulls have shown of the way to a peer, for the next one."""

from __future__ import annotations

from mocha_link.sync.protocol import NEAR_S

MAX_MISSES = 2  # pulls on which datagrams carried nothing although the peer took them
RETRY_EVERY = 8  # then they are tried again only so often


class PathMemory:
    """The round trip and rate of the way to one peer, and what does not get through on it.

    Attributes:
        rtt_s: the lowest round trip of the last pull; None: not known.
        rate_bytes_s: of the last pull that moved enough; None: not known.
        udp_misses: pulls in a row on which datagrams brought nothing.
    """

    def __init__(self) -> None:
        self.rtt_s: float | None = None
        self.rate_bytes_s: float | None = None
        self.udp_misses = 0
        self._cut: dict[int, int] = {}  # by topic key: messages that were cut, one after the other

    @property
    def is_near(self) -> bool:
        """Whether round trips are so short that connections serve best."""
        return self.rtt_s is not None and self.rtt_s < NEAR_S

    def measured(self, rtt_s: float) -> None:
        """A round trip was measured."""
        self.rtt_s = rtt_s

    def moved(self, rate_bytes_s: float | None) -> None:
        """A pull has ended; its rate, if it moved enough."""
        self.rate_bytes_s = rate_bytes_s or self.rate_bytes_s

    def may_use_datagrams(self) -> bool:
        """Whether to try datagrams; call it once per pull."""
        if self.udp_misses < MAX_MISSES:
            return True
        self.udp_misses += 1
        return self.udp_misses % RETRY_EVERY == 0

    def datagrams_missed(self) -> None:
        """The peer took the datagrams of a pull, and nothing large came back."""
        self.udp_misses += 1

    def datagrams_carried(self) -> None:
        """Datagrams brought messages."""
        self.udp_misses = 0

    def message_cut(self, topic_key: int) -> None:
        """The link broke in the middle of a message of a topic."""
        self._cut[topic_key] = self._cut.get(topic_key, 0) + 1

    def message_arrived(self, topic_key: int) -> None:
        """A message of a topic came in whole."""
        self._cut.pop(topic_key, None)

    def cuts(self, topic_key: int) -> int:
        """How often messages of a topic were cut in a row: such topics come last."""
        return self._cut.get(topic_key, 0)
