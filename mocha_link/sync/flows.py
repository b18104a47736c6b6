"""The datagram flows to one peer: one at a time, each with the estimates of the previous one."""

from __future__ import annotations

import os
from collections.abc import Callable

from mocha_link.clock import Instant
from mocha_link.datagram import Flow
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import NEAR_S

FLIGHT_BYTES = 14 * 1024  # ten packets: the initial window of TCP
WINDOW_BYTES = 256 * 1024  # carried by datagrams if the link's rate is known; TCP carries the rest
MAX_UNACKNOWLEDGED = 3  # consecutive flows without an acknowledgement, after which
DEAF_S = 10.0  # datagrams cannot open a sync for this long; connections can


class Flows:
    """Makes, keeps and closes the flow of a peer's newest sync.

    Attributes:
        current: the flow, if there is one.
        loses_much: by the kernel's statistics, losses slow the peer's connection down so much that
            datagrams are faster.
    """

    def __init__(self, peer: Peer) -> None:
        self.current: Flow | None = None
        self.loses_much = False
        self._peer = peer
        self._unacknowledged = 0  # consecutive flows without an acknowledgement
        self._deaf_until_s = 0.0  # datagrams cannot open a sync before, steady seconds
        self._rate_bytes_s: float | None = None  # of the last flow, for the next
        self._rtt_s: float | None = None  # likewise

    def connection_measured(self, *, loses_much: bool) -> None:
        """Note the kernel's statistics of the peer's connection."""
        self.loses_much = loses_much

    def make(self, token: bytes, next_frame: Callable[[int], bytes | None]) -> Flow:
        """Make a flow for the frames of a sync; `begin` makes it the current one."""
        return Flow(
            token,
            next_frame,
            rate_bytes_s=self._rate_bytes_s,
            rtt_s=self._rtt_s,
            first_number=int.from_bytes(os.urandom(4), "big") >> 2,
            proven=False,
        )

    def window_used(self, *, admitted: bool, sent: int) -> bool:
        """Whether an open connection is to send the rest.

        Datagrams send a first window if the peer is `admitted`, as they reach it at once, or if the
        rate of the link is known: TCP would begin with a tenth of it. They do not to a near peer,
        where TCP is as fast. Until the rate is known both send one flight (`sent`: bytes so far).
        """
        flow = self.current
        if flow is None or (flow.rtt_s is not None and flow.rtt_s < NEAR_S):
            return True
        if not (admitted or flow.rate_estimated) and flow.rtt_s is not None:
            return sent < FLIGHT_BYTES
        return not (admitted or self.rate_bytes_s) or flow.bytes_out >= WINDOW_BYTES

    @property
    def rate_bytes_s(self) -> float | None:
        """The rate of the link by the current flow, or the last one; None: not known."""
        return (self.current and self.current.rate_bytes_s) or self._rate_bytes_s

    def begin(self, flow: Flow, now: Instant) -> None:
        """Replace the current flow."""
        self.close()
        self.current = flow
        if self._unacknowledged >= MAX_UNACKNOWLEDGED:
            # An attacker may be spoofing the peer's address to flood the peer with our packets.
            self._deaf_until_s = now.steady_s + DEAF_S

    def is_deaf(self, now: Instant) -> bool:
        """Whether datagrams cannot open a sync at the moment."""
        return now.steady_s < self._deaf_until_s

    def close(self) -> None:
        """End the current flow, and keep its estimates of the link."""
        flow, self.current = self.current, None
        if flow:
            self._unacknowledged = self._unacknowledged + 1 if flow.rtt_s is None else 0
        if flow and flow.rtt_s is not None:
            self._peer.tokens.renew()
            self._rtt_s = flow.rtt_s
            self._rate_bytes_s = flow.rate_bytes_s or self._rate_bytes_s
