"""How long a peer has not acknowledged: first the last packets are lost, then the link is down."""

from __future__ import annotations

from mocha_link.datagram.pacing import UNKNOWN_RTT_S, RoundTrip
from mocha_link.datagram.packet import ACK_DELAY_S

GRANULARITY_S = 0.01
QUIET_S = 0.15  # without a packet for two round trips and this the link is down
PROBE_S = 0.1  # then probes leave at this distance, growing
PROBE_GROWTH = 1.5
MAX_PROBE_S = 1.0


def deviation_s(rtt: RoundTrip) -> float:
    """How much longer than usual a round trip may take."""
    return max(4 * rtt.deviation_s, GRANULARITY_S)


class Silence:
    """Says when to probe a peer that has something to acknowledge."""

    def __init__(self) -> None:
        self._since_s = 0.0  # when the last packet came, or the first left that waits
        self._sent_s = 0.0  # when the last packet left
        self._probes = 0  # in this silence
        self._every_s = PROBE_S  # to the next one, while the link is down

    @property
    def down(self) -> bool:
        """Whether the link is down: not even the answer to a probe has come."""
        return self._probes > 1

    def end(self, now_s: float) -> None:
        """A packet came, or a contact begins."""
        self._since_s = now_s
        self._probes = 0

    def sent(self, now_s: float, *, first: bool) -> None:
        """A packet left; the `first`: no other waits for an acknowledgement."""
        self._sent_s = now_s
        if first:
            self._since_s = now_s

    def due_s(self, rtt: RoundTrip) -> float:
        """When the next probe leaves."""
        if self.down:
            return self._sent_s + self._every_s
        rtt_s = rtt.smoothed_s or UNKNOWN_RTT_S
        down_s = self._since_s + 2 * rtt_s + 4 * rtt.deviation_s + QUIET_S
        if self._probes:
            return down_s
        tail_s = max(self._since_s, self._sent_s) + rtt_s + deviation_s(rtt) + ACK_DELAY_S
        return min(tail_s, down_s)

    def probe(self, now_s: float) -> None:
        """A probe leaves."""
        self._every_s = min(self._every_s * PROBE_GROWTH, MAX_PROBE_S) if self.down else PROBE_S
        self._probes += 1
        self._sent_s = now_s
