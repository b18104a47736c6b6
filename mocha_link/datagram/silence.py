"""Detects a silent peer: first the last packets count as lost, then the link as down."""

from __future__ import annotations

from mocha_link.datagram.pacing import UNKNOWN_RTT_S, RoundTrip
from mocha_link.datagram.packet import ACK_DELAY_S

GRANULARITY_S = 0.01
DOWN_MARGIN_S = 0.15  # the link is down after two round trips and this time without a packet
PROBE_S = 0.1  # the first interval between probes then; it grows
PROBE_GROWTH = 1.5
MAX_PROBE_S = 1.0


def deviation_s(rtt: RoundTrip) -> float:
    """The margin on a usual round trip."""
    return max(4 * rtt.deviation_s, GRANULARITY_S)


class Silence:
    """Schedules probes to a peer that has packets to acknowledge."""

    def __init__(self) -> None:
        self._since_s = 0.0  # when the last packet was received, or the first pending one sent
        self._sent_s = 0.0  # when the last packet was sent
        self._probes = 0  # sent in this silence
        self._every_s = PROBE_S  # the interval to the next probe, while the link is down

    @property
    def down(self) -> bool:
        """Whether the link is down: the first probe was not answered either."""
        return self._probes > 1

    def end(self, now_s: float) -> None:
        """Note that a packet was received, or a contact begins."""
        self._since_s = now_s
        self._probes = 0

    def sent(self, now_s: float, *, first: bool) -> None:
        """Note that a packet was sent; `first`: no other one is unacknowledged."""
        self._sent_s = now_s
        if first:
            self._since_s = now_s

    def due_s(self, rtt: RoundTrip) -> float:
        """When to send the next probe."""
        if self.down:
            return self._sent_s + self._every_s
        rtt_s = rtt.smoothed_s or UNKNOWN_RTT_S
        down_s = self._since_s + 2 * rtt_s + 4 * rtt.deviation_s + DOWN_MARGIN_S
        if self._probes:
            return down_s
        tail_s = max(self._since_s, self._sent_s) + rtt_s + deviation_s(rtt) + ACK_DELAY_S
        return min(tail_s, down_s)

    def probe(self, now_s: float) -> None:
        """Note that a probe is sent."""
        self._every_s = min(self._every_s * PROBE_GROWTH, MAX_PROBE_S) if self.down else PROBE_S
        self._probes += 1
        self._sent_s = now_s
