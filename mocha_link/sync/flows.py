"""The datagram flows that serve one peer: one at a time, each with the state of the one before."""

from __future__ import annotations

import os
from collections.abc import Callable

from mocha_link.clock import Instant
from mocha_link.datagram import Flow
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import NEAR_S

FLIGHT_BYTES = 14 * 1024  # ten packets: what TCP sends before it has an acknowledgement
WINDOW_BYTES = 256 * 1024  # that datagrams carry where the link is known; TCP carries the rest
MAX_UNACKNOWLEDGED = 3  # after so many flows in a row without an acknowledgement
DEAF_S = 10.0  # datagrams open nothing for so long; connections do


class Flows:
    """Makes, keeps and closes the flow of a peer's newest sync.

    Attributes:
        current: the flow, if there is one.
        loses_much: the peer's connection does, by the kernel, so that datagrams serve better.
    """

    def __init__(self, peer: Peer) -> None:
        self.current: Flow | None = None
        self.loses_much = False
        self._peer = peer
        self._unacknowledged = 0  # flows in a row of which the peer has acknowledged nothing
        self._deaf_until_s = 0.0  # datagrams open nothing before that steady time
        self._rate_bytes_s: float | None = None  # of the last flow, for the next
        self._rtt_s: float | None = None  # likewise

    def connection_measured(self, *, loses_much: bool) -> None:
        """Take in how the peer's connection does, by the kernel."""
        self.loses_much = loses_much

    def make(self, token: bytes, next_frame: Callable[[int], bytes | None]) -> Flow:
        """A flow for the frames of a sync; it is not the current one before `begin`."""
        return Flow(
            token,
            next_frame,
            rate_bytes_s=self._rate_bytes_s,
            rtt_s=self._rtt_s,
            first_number=int.from_bytes(os.urandom(4), "big") >> 2,
            proven=False,
        )

    def window_used(self, *, admitted: bool, sent: int) -> bool:
        """Whether a connection that stands carries on.

        A first window leaves by datagrams where the peer is `admitted`, as they reach it at once,
        or what the link takes is known: TCP would begin with a tenth of that. Not to a near peer,
        to which TCP is as fast. Before it is known both carry one flight (`sent`: bytes so far).
        """
        flow = self.current
        if flow is None or (flow.rtt_s is not None and flow.rtt_s < NEAR_S):
            return True
        if not (admitted or flow.judged) and flow.rtt_s is not None:
            return sent < FLIGHT_BYTES
        known = admitted or flow.rate_bytes_s or self._rate_bytes_s
        return not known or flow.bytes_out >= WINDOW_BYTES

    def begin(self, flow: Flow, now: Instant) -> None:
        """Put it in the place of the current one."""
        self.close()
        self.current = flow
        if self._unacknowledged >= MAX_UNACKNOWLEDGED:
            # An attacker may be opening in the name of the peer, which drowns in what we send it.
            self._deaf_until_s = now.steady_s + DEAF_S

    def is_deaf(self, now: Instant) -> bool:
        """Whether datagrams open nothing at the moment."""
        return now.steady_s < self._deaf_until_s

    def close(self) -> None:
        """End the current one, and keep what it showed of the way to the peer."""
        flow, self.current = self.current, None
        if flow:
            self._unacknowledged = self._unacknowledged + 1 if flow.rtt_s is None else 0
        if flow and flow.rtt_s is not None:
            self._peer.tokens.renew()
            self._rtt_s = flow.rtt_s
            self._rate_bytes_s = flow.rate_bytes_s or self._rate_bytes_s
