"""Measurements of the path to a peer by earlier pulls, for the next one."""

from __future__ import annotations

from mocha_link.sync.protocol import NEAR_S

MAX_MISSES = 2  # consecutive pulls on which datagrams delivered no messages
RETRY_EVERY = 8  # after that, datagrams are tried on every eighth pull only


class PathMemory:
    """The round trip and rate of the path to one peer, and the failures on it.

    Attributes:
        rtt_s: the lowest round trip of the last pull; None: not known.
        rate_bytes_s: the rate of the last pull that was large enough; None: not known.
        udp_misses: consecutive pulls on which datagrams delivered no messages.
    """

    def __init__(self) -> None:
        self.rtt_s: float | None = None
        self.rate_bytes_s: float | None = None
        self.udp_misses = 0
        self._cut: dict[int, int] = {}  # by topic key: consecutive messages that were cut

    @property
    def is_near(self) -> bool:
        """Whether round trips are so short that connections are the better path."""
        return self.rtt_s is not None and self.rtt_s < NEAR_S

    def measured(self, rtt_s: float) -> None:
        """Note a measured round trip."""
        self.rtt_s = rtt_s

    def moved(self, rate_bytes_s: float | None) -> None:
        """Note the rate of a pull that has ended; None: it was too small to measure it."""
        self.rate_bytes_s = rate_bytes_s or self.rate_bytes_s

    def may_use_datagrams(self) -> bool:
        """Whether to try datagrams; call it once per pull."""
        if self.udp_misses < MAX_MISSES:
            return True
        self.udp_misses += 1
        return self.udp_misses % RETRY_EVERY == 0

    def datagrams_missed(self) -> None:
        """Note a pull on which the peer replied by datagrams but delivered no messages."""
        self.udp_misses += 1

    def datagrams_carried(self) -> None:
        """Note that datagrams delivered messages."""
        self.udp_misses = 0

    def message_cut(self, topic_key: int) -> None:
        """Note that the link broke in the middle of a message of a topic."""
        self._cut[topic_key] = self._cut.get(topic_key, 0) + 1

    def message_arrived(self, topic_key: int) -> None:
        """Note that a whole message of a topic was received."""
        self._cut.pop(topic_key, None)

    def cuts(self, topic_key: int) -> int:
        """The number of consecutive messages of a topic that were cut."""
        return self._cut.get(topic_key, 0)
