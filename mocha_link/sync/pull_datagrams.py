"""The datagrams of one pull."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from mocha_link.clock import Instant
from mocha_link.datagram import Flow
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import SendDatagram

NEAR_CONNECT_S = 0.025  # a new peer whose connection is established within this time is near
PATIENCE_S = 0.1  # how long a near peer may reply on the connection before datagrams are tried
MESSAGE_ROOM = 1100  # every frame of ours fits in a datagram, on either path


class PullDatagrams:
    """Opens a flow for a pull after a delay, unless the connection has replied by then.

    Attributes:
        flow: the flow, once a datagram is sent.
        due_s: when to send the first datagram, steady seconds; None: none is scheduled.
        bytes_in: bytes of the frames received by datagrams.
    """

    def __init__(self, peer: Peer) -> None:
        self.flow: Flow | None = None
        self.due_s: float | None = None
        self.bytes_in = 0
        self._peer = peer
        self._outbox: deque[bytes] = deque()  # frames to send

    def begin(self, opening: list[bytes], now: Instant, *, acquainted: bool) -> None:
        """Schedule the frames of the opening.

        `acquainted`: the opening proves our address to the peer.
        """
        path = self._peer.path
        self._outbox.extend(opening)
        size = sum(map(len, opening))
        if not acquainted and size < MESSAGE_ROOM:
            # Before our address is proven the peer may send only a multiple of what it received.
            self._outbox.append(bytes(MESSAGE_ROOM - size))
        known = path.rtt_s is not None
        wait_s = PATIENCE_S if path.is_near else 0.0 if known else NEAR_CONNECT_S
        self.due_s = now.steady_s + wait_s

    def put_off(self, until_s: float) -> None:
        """Send the first datagram no earlier than `until_s`, if it is not sent yet."""
        if self.due_s is not None:
            self.due_s = max(self.due_s, until_s)

    def drop(self) -> None:
        """Send no more datagrams: the peer does not support them."""
        self.flow = self.due_s = None

    def is_due(self, now: Instant) -> bool:
        """Whether to send the first datagram now; True only once."""
        due = self.due_s is not None and self.due_s <= now.steady_s
        if due:
            self.due_s = None
        return due

    def open(self, token: bytes) -> None:
        """Open the flow; the next `transmit` sends its first datagram."""
        self.flow = Flow(token, self._next_frame, rtt_s=self._peer.path.rtt_s)

    def reply(self, size: int, frames: Iterable[bytes]) -> None:
        """Count a frame that was received by a datagram, and queue the replies."""
        self.bytes_in += size
        self._outbox.extend(frames)

    def transmit(self, now: Instant) -> None:
        """Send the datagrams that are due."""
        if self.flow:
            for packet in self.flow.transmit(now.steady_s):
                self._peer.node.actions.append(SendDatagram(self._peer.name, packet))

    @property
    def answered(self) -> bool:
        """Whether the peer has sent a datagram."""
        return self.flow is not None and self.flow.alive_s is not None

    @property
    def wake_s(self) -> float | None:
        """When the next datagram is due, in steady seconds; None: none is."""
        flow_s = self.flow.wake_s if self.flow else None
        return min((each for each in (self.due_s, flow_s) if each is not None), default=None)

    def _next_frame(self, _room: int) -> bytes | None:
        return self._outbox.popleft() if self._outbox else None
