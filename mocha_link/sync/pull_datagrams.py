"""The datagrams of one pull: when the first leaves, and what they bring."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from mocha_link.clock import Instant
from mocha_link.datagram import Flow
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import SendDatagram

NEAR_CONNECT_S = 0.025  # an unknown peer whose connection opens within this time is near
PATIENCE_S = 0.1  # without a reply on the connection to a near peer, datagrams may get through
MESSAGE_ROOM = 1100  # our frames fit in a datagram, whichever path they take


class PullDatagrams:
    """Opens a flow for a pull after a while, unless the connection has served by then.

    Attributes:
        flow: once a datagram leaves.
        due_s: when the first leaves, steady seconds; None: none waits.
        bytes_in: of frames that came by them.
    """

    def __init__(self, peer: Peer) -> None:
        self.flow: Flow | None = None
        self.due_s: float | None = None
        self.bytes_in = 0
        self._peer = peer
        self._outbox: deque[bytes] = deque()  # frames

    def begin(self, opening: list[bytes], now: Instant, *, acquainted: bool) -> None:
        """Have the frames of the opening sent after a while.

        `acquainted`: the opening shows that packets of the peer reach us.
        """
        path = self._peer.path
        self._outbox.extend(opening)
        size = sum(map(len, opening))
        if not acquainted and size < MESSAGE_ROOM:
            # The peer sends little more than it got before it knows that it is us.
            self._outbox.append(bytes(MESSAGE_ROOM - size))
        known = path.rtt_s is not None
        wait_s = PATIENCE_S if path.is_near else 0.0 if known else NEAR_CONNECT_S
        self.due_s = now.steady_s + wait_s

    def put_off(self, until_s: float) -> None:
        """Have the first leave no earlier, if it has not left."""
        if self.due_s is not None:
            self.due_s = max(self.due_s, until_s)

    def drop(self) -> None:
        """Send nothing more: the peer does not understand them."""
        self.flow = self.due_s = None

    def is_due(self, now: Instant) -> bool:
        """Whether the first is to leave now; it is asked once."""
        due = self.due_s is not None and self.due_s <= now.steady_s
        if due:
            self.due_s = None
        return due

    def open(self, token: bytes) -> None:
        """Have the first leave with the next `transmit`."""
        self.flow = Flow(token, self._next_frame, rtt_s=self._peer.path.rtt_s)

    def reply(self, size: int, frames: Iterable[bytes]) -> None:
        """A frame of that size came by a datagram: have the replies sent."""
        self.bytes_in += size
        self._outbox.extend(frames)

    def transmit(self, now: Instant) -> None:
        """Send the datagrams that are due."""
        if self.flow:
            for packet in self.flow.transmit(now.steady_s):
                self._peer.node.actions.append(SendDatagram(self._peer.name, packet))

    @property
    def answered(self) -> bool:
        """Whether the peer has sent any."""
        return self.flow is not None and self.flow.alive_s is not None

    @property
    def wake_s(self) -> float | None:
        """When the next is due, in steady seconds; None: none is."""
        flow_s = self.flow.wake_s if self.flow else None
        return min((each for each in (self.due_s, flow_s) if each is not None), default=None)

    def _next_frame(self, _room: int) -> bytes | None:
        return self._outbox.popleft() if self._outbox else None
