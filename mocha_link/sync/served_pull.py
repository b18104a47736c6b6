"""The serving side of one pull of a peer, and the choice of the path for its frames."""

from __future__ import annotations

from collections import deque

from mocha_link.clock import Instant
from mocha_link.datagram import Flow
from mocha_link.sync.credit import GRANT, MAX_CHUNK, MIN_CHUNK
from mocha_link.sync.flows import FLIGHT_BYTES, Flows
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import FOLLOW_S, ID_BYTES, REQUEST_PATIENCE_S, Frame, Route, Standing
from mocha_link.sync.sync_sender import MIN_ROOM, SyncSender

SHORT_BYTES = 11 * 1024  # less than the first twelve datagrams, which measure no higher rate
LATE_ACK_S = 0.1  # the margin for a late acknowledgement


class SendConnection:
    """The TCP route of a pull, and its credit.

    Attributes:
        route: the peer's connection; None: it has none.
        since_s: when the pull moved to it, steady seconds; 0: it began there.
        sent: bytes sent on it.
        unsent: of these, bytes that wait until TCP's window admits them; None: not known.
        chunk: the largest frame that the peer accepts on it.
    """

    def __init__(self) -> None:
        self.route: Route | None = None
        self.since_s = 0.0
        self.sent = 0
        self.unsent: int | None = None
        self.chunk = MIN_CHUNK
        self._allowed = 0  # total bytes that the peer has granted

    def begin(self, route: Route) -> None:
        """Begin the pull on a connection."""
        self.route = route

    def move(self, route: Route, now: Instant) -> None:
        """Move the pull to another connection, on which nothing was sent yet."""
        self.route, self.sent, self.since_s = route, 0, now.steady_s
        self.unsent = None

    def measured(self, unsent_bytes: int | None) -> None:
        """Note the bytes that wait in the kernel."""
        self.unsent = unsent_bytes

    def lose(self) -> None:
        """Note that the connection was closed."""
        self.route = None

    def grant(self, raw: bytes) -> None:
        """Process a grant of the peer."""
        if len(raw) == GRANT.size:
            allowed, chunk = GRANT.unpack(raw)
            self._allowed = max(self._allowed, allowed)
            self.chunk = min(max(chunk, MIN_CHUNK), MAX_CHUNK)

    @property
    def credit(self) -> int:
        """Bytes that may be sent now."""
        return self._allowed - self.sent

    def spend(self, size: int) -> None:
        """Count sent bytes."""
        self.sent += size
        if self.unsent is not None:
            self.unsent += size


class ServedPull:
    """Sends the frames of one pull to the peer: over its connection, by datagrams, or both.

    The connection carries bulk data. Datagrams carry a first window, and everything if there is no
    connection or the connection loses much. This class makes every choice between the two.

    Args:
        flows: the datagram flows to the peer; the current one is of the newest pull.

    Attributes:
        id: the id of the request, with which its frames on a connection begin.
        began_s: when it began, steady seconds.
        received_s: when the peer's last frame was received, steady seconds.
        sender: makes the frames.
        connection: the peer's connection, if there is one.
        by_datagram: frames are sent by datagrams.
    """

    def __init__(self, peer: Peer, request_id: bytes, began_s: float, flows: Flows) -> None:
        self.id = request_id
        self.began_s = self.received_s = began_s
        self.sender = SyncSender(peer)
        self.connection = SendConnection()
        self.by_datagram = False
        self._flows = flows
        self._datagrams_only = False  # no frame but resent ones was sent on the connection
        self._fell_back = False  # unacknowledged datagrams are sent again over the connection
        self._again: deque[bytes] = deque()  # their frames

    # --- input from the peer

    def received(self, now: Instant) -> None:
        """Note that input for the pull was received."""
        self.received_s = now.steady_s

    def begin_by_datagrams(self) -> None:
        """Note that the peer opened it by datagrams, which it continues to use."""
        self.by_datagram = self._datagrams_only = True

    def connection_stands(self, found: Standing | None) -> bool:
        """Note the state of the connection; False: it is closed, and the peer followed only on it.

        A running pull may continue by datagrams, or over another connection.
        """
        if found is None:
            self.connection.lose()
            return self.by_datagram or not self.sender.ended
        self.connection.measured(found.unsent_bytes)
        if found.loses_much:
            self.use_datagrams()
        return True

    # --- output

    def supply(self) -> tuple[Route, list[Frame]] | None:
        """The next frame for the connection, in parts, if the peer has credit left for one."""
        connection = self.connection
        if connection.route is None or (self._datagrams_carry() and not self._joins):
            return None
        parts: list[Frame] | None
        if self._again:
            parts = [self.id + self._again.popleft()]
        elif connection.credit <= 0:
            return None
        else:
            room = min(connection.chunk, max(connection.credit, MIN_ROOM + ID_BYTES))
            parts = self.sender.next_parts(room, self.id)
            self._datagrams_only = self._datagrams_only and not parts
        if not parts:
            return None
        connection.spend(sum(map(len, parts)))
        return connection.route, parts

    def next_for_datagram(self, room: int) -> bytes | None:
        """The next frame of at most `room` bytes for a datagram; None: no frame now, or by TCP."""
        return self.sender.next(room) if self.by_datagram and self.sender.fits(room) else None

    # --- the path

    @property
    def _flow(self) -> Flow | None:
        """The flow of this pull; the current flow may still be the previous pull's."""
        flow = self._flows.current
        return flow if flow and flow.token == self.id else None

    def _datagrams_carry(self) -> bool:
        """Whether datagrams carry the next frames: a first window, and more if TCP loses much.

        New messages to a peer that follows are sent over its connection, if it is open.
        """
        flow, sender = self._flow, self.sender
        if not self.by_datagram or flow is None:
            return False
        if (
            (sender.all_sent and not (sender.ended and self.connection.route is not None))
            or self._flows.loses_much
            or not self._flows.window_used(admitted=sender.admitted, sent=self.connection.sent)
        ):
            return True
        self.by_datagram = not (sender.admitted or flow.rate_estimated) and flow.rtt_s is not None
        return False

    @property
    def _joins(self) -> bool:
        """Whether the connection sends beside the first window, as much as TCP's own admits.

        TCP starts slowly, so it begins at once, unless the link holds less than its first flight.
        """
        flow, sender, unsent = self._flow, self.sender, self.connection.unsent
        if flow is None or flow.rtt_s is None or unsent is None or unsent >= FLIGHT_BYTES:
            return False
        rate_bytes_s = self._flows.rate_bytes_s
        if rate_bytes_s is not None and rate_bytes_s * flow.rtt_s < SHORT_BYTES:
            return False
        opens = sender.admitted or flow.rate_estimated
        return opens and not sender.all_sent and not self._flows.loses_much

    def use_datagrams(self) -> None:
        """Continue by datagrams if TCP loses much and datagrams reach the peer."""
        flow = self._flow
        if flow is None or self.sender.all_sent:
            return
        if flow.rtt_s is not None and self._flows.loses_much:
            self.by_datagram = True

    @property
    def _unreachable_s(self) -> float | None:
        """When our datagrams count as not reaching the peer, so that the connection takes over.

        The request on the connection was received more than a round trip after the peer's
        datagrams. An acknowledgement takes no longer than that.
        """
        flow, connection = self._flow, self.connection
        if self._fell_back or connection.route is None or flow is None or flow.rtt_s is not None:
            return None
        if not self.by_datagram and flow.settled:
            return None
        return connection.since_s + 2 * (connection.since_s - self.began_s) + LATE_ACK_S

    def fall_back_to_tcp(self, now: Instant) -> None:
        """Continue over the connection alone if datagrams do not reach the peer.

        Unacknowledged frames are sent again.
        """
        flow, due_s = self._flow, self._unreachable_s
        if flow and due_s is not None and now.steady_s > due_s:
            self.by_datagram = False
            self._fell_back = True
            self._datagrams_only = self.sender.all_sent
            self._again.extend(flow.unacknowledged())

    # --- the end

    @property
    def reaches_peer(self) -> bool:
        """Whether our frames are known to reach the peer."""
        flow = self._flow
        return self.connection.route is not None or bool(flow and flow.proven)

    @property
    def has_arrived(self) -> bool:
        """Whether all frames were sent and acknowledged, so that only the peer's END is missing."""
        flow = self._flow
        return bool(self.sender.all_sent and self._datagrams_only and flow and flow.settled)

    @property
    def patience_s(self) -> float:
        """The time-out for input from the peer."""
        return FOLLOW_S if self.sender.ended else REQUEST_PATIENCE_S

    def is_silent(self, now: Instant) -> bool:
        """Whether the peer has sent nothing for too long."""
        return now.steady_s - self.received_s > self.patience_s

    @property
    def wake_s(self) -> float:
        """When the first timer expires, steady seconds."""
        silent_s, unreachable_s = self.received_s + self.patience_s, self._unreachable_s
        return silent_s if unreachable_s is None else min(silent_s, unreachable_s)
