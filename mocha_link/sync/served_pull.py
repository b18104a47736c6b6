"""One pull of a peer as the serving side sees it, and on which way its frames go: TCP or UDP."""

from __future__ import annotations

from collections import deque

from mocha_link.clock import Instant
from mocha_link.datagram import Flow
from mocha_link.sync.flows import Flows
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import FOLLOW_S, ID_BYTES, PATIENCE_S, Frame, Route, Standing
from mocha_link.sync.send_connection import SendConnection
from mocha_link.sync.sync_sender import MIN_ROOM, SyncSender

LATE_ACK_S = 0.1  # so long an acknowledgement may be late


class ServedPull:
    """Carries the frames of one pull to the peer: over its connection, by datagrams, or both.

    The connection carries bulk. Datagrams carry a first window, all where there is no connection,
    and all where the connection loses much. Every choice between the two is made here.

    Args:
        flows: the datagram flows to the peer; the current one is of the newest pull.

    Attributes:
        id: what its frames begin with on a connection, the id of the request.
        began_s: when it began, steady clock.
        received_s: when the newest frame of the peer came, steady clock.
        sender: what goes out.
        connection: the peer's, if it has one.
        by_datagram: frames come, and go, by datagrams.
    """

    def __init__(self, peer: Peer, request_id: bytes, began_s: float, flows: Flows) -> None:
        self.id = request_id
        self.began_s = self.received_s = began_s
        self.sender = SyncSender(peer)
        self.connection = SendConnection()
        self.by_datagram = False
        self._flows = flows
        self._all_cast = False  # everything that was given out went by datagrams
        self._reclaimed = False  # what datagrams may have lost goes over the connection
        self._again: deque[bytes] = deque()  # those frames

    # --- what the peer does

    def received(self, now: Instant) -> None:
        """Something of the pull came in."""
        self.received_s = now.steady_s

    def begin_by_datagrams(self) -> None:
        """It was opened by datagrams, and goes on by them."""
        self.by_datagram = self._all_cast = True

    def connection_stands(self, found: Standing | None) -> bool:
        """Take in how the connection does; False: it is closed, and the peer followed only there.

        A pull that is under way may go on by datagrams, or over another connection.
        """
        if found is None:
            self.connection.lose()
            return self.by_datagram or not self.sender.ended
        if found.loses_much:
            self.use_datagrams()
        return True

    # --- what goes out

    def supply(self) -> tuple[Route, list[Frame]] | None:
        """The next frame for the connection, in parts, if the peer has credit left for one."""
        connection = self.connection
        if connection.route is None or self._datagrams_carry():
            return None
        parts: list[Frame] | None
        if self._again:
            parts = [self.id + self._again.popleft()]
        elif connection.credit <= 0:
            return None
        else:
            room = min(connection.chunk, max(connection.credit, MIN_ROOM + ID_BYTES))
            parts = self.sender.next_parts(room, self.id)
        if not parts:
            return None
        connection.spend(sum(map(len, parts)))
        return connection.route, parts

    def next_for_datagram(self, room: int) -> bytes | None:
        """The next frame for a datagram of that many bytes; None: nothing now, or not this way."""
        return self.sender.next(room) if self.by_datagram and self.sender.fits(room) else None

    # --- which way

    @property
    def _flow(self) -> Flow | None:
        """The flow of this pull; the current one may still be that of the pull before."""
        flow = self._flows.current
        return flow if flow and flow.token == self.id else None

    def _datagrams_carry(self) -> bool:
        """Whether they carry what there is: a first window, and more where TCP loses much.

        A peer that follows gets what is new over its connection, if that stands.
        """
        flow, sender = self._flow, self.sender
        if not self.by_datagram or flow is None:
            return False
        if (
            (sender.given_out and not (sender.ended and self.connection.route is not None))
            or self._flows.loses_much
            or not self._flows.window_used(admitted=sender.admitted, sent=self.connection.sent)
        ):
            return True
        self._all_cast = False
        self.by_datagram = not (sender.admitted or flow.judged) and flow.rtt_s is not None
        return False

    def use_datagrams(self) -> None:
        """Have them carry what the connection began, where TCP loses much and they get there."""
        flow = self._flow
        if flow is None or self.sender.given_out:
            return
        if flow.rtt_s is not None and self._flows.loses_much:
            self.by_datagram = True

    @property
    def _unreachable_s(self) -> float | None:
        """When it is clear that our datagrams do not get back to the peer: the connection serves.

        Its request was more than a round trip behind the peer's datagrams, and an acknowledgement
        takes no longer.
        """
        flow, connection = self._flow, self.connection
        if self._reclaimed or connection.route is None or flow is None or flow.rtt_s is not None:
            return None
        if not self.by_datagram and flow.settled:
            return None
        return connection.since_s + 2 * (connection.since_s - self.began_s) + LATE_ACK_S

    def reclaim(self, now: Instant) -> None:
        """Have the connection alone carry on where datagrams do not reach the peer.

        It sends again what they may have lost.
        """
        flow, due_s = self._flow, self._unreachable_s
        if flow and due_s is not None and now.steady_s > due_s:
            self.by_datagram = False
            self._reclaimed = True
            self._all_cast = self.sender.given_out
            self._again.extend(flow.reclaim())

    # --- how it ends

    @property
    def reaches_peer(self) -> bool:
        """Whether what we send is known to reach the peer."""
        flow = self._flow
        return self.connection.route is not None or bool(flow and flow.proven)

    @property
    def has_arrived(self) -> bool:
        """Whether all was given out and acknowledged, so that only the peer's END is missing."""
        flow = self._flow
        return bool(self.sender.given_out and self._all_cast and flow and flow.settled)

    @property
    def patience_s(self) -> float:
        """How long the peer may send nothing."""
        return FOLLOW_S if self.sender.ended else PATIENCE_S

    def is_silent(self, now: Instant) -> bool:
        """Whether the peer has sent nothing for too long."""
        return now.steady_s - self.received_s > self.patience_s

    @property
    def wake_s(self) -> float:
        """When the time brings something, steady seconds."""
        silent_s, unreachable_s = self.received_s + self.patience_s, self._unreachable_s
        return silent_s if unreachable_s is None else min(silent_s, unreachable_s)
