"""One pull of a new node as the answering side knows it: what is to be sent, and on which way."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from mocha_link.clock import Instant
from mocha_link.sync.frames import OPEN, SyncFrameError
from mocha_link.sync.peer import GRANT, MAX_CHUNK, MIN_CHUNK, Peer
from mocha_link.sync.protocol import ID_BYTES, Frame, Route
from mocha_link.sync.sync_sender import MIN_ROOM, SyncSender


class ServedSync:
    """A pull of a new node, with the credit that it has granted on its connection.

    Attributes:
        id: what its frames begin with.
        sender: what is given to the peer, and what the peer has said.
        began_s: when it began, steady clock.
        heard_s: when the newest frame of the peer came, steady clock.
        route: the peer's connection, if it has one.
        routed_s: when the pull came to that, steady clock.
        sent: bytes on that connection.
        by_datagram: frames come, and go, by datagrams.
        all_cast: everything that was given out went by datagrams.
        follows: the pull is over, and what is stored later leaves at once.
    """

    def __init__(self, request_id: bytes, peer: Peer, now: Instant) -> None:
        self.id = request_id
        self.sender = SyncSender(peer)
        self.began_s = self.heard_s = now.steady_s
        self.route: Route | None = None
        self.routed_s = 0.0
        self.sent = 0
        self.by_datagram = False
        self.all_cast = False
        self.follows = False
        self._peer = peer
        self._again: deque[bytes] = deque()  # frames that datagrams may not have brought
        self._allowed = 0  # bytes granted on the connection
        self._chunk = MIN_CHUNK  # bytes of a reply

    # --- what the peer says

    def open(self, frame: bytes) -> bool:
        """Take in the first frame; False if it is none that begins a sync."""
        return frame[:1] == bytes((OPEN,)) and self.take(frame)

    def take(self, frame: bytes) -> bool:
        """Take in a frame of the peer; False if it is none of a sync."""
        try:
            self.sender.receive(frame)
        except SyncFrameError:
            return False
        return True

    def grant(self, raw: bytes) -> None:
        """Take in what may be sent on the connection."""
        if len(raw) == GRANT.size:
            allowed, chunk = GRANT.unpack(raw)
            self._allowed = max(self._allowed, allowed)
            self._chunk = min(max(chunk, MIN_CHUNK), MAX_CHUNK)

    # --- the way to it

    def carry_on(self, route: Route, now: Instant) -> None:
        """What is sent from now on goes over this connection, on which nothing was sent."""
        self.route, self.sent, self.routed_s = route, 0, now.steady_s

    def start_over(self) -> None:
        """Nothing of what was sent has arrived, nor does what was granted count."""
        self.sender = SyncSender(self._peer)
        self._allowed = 0

    def leave_datagrams(self, lost: Iterable[bytes]) -> None:
        """Go on over the connection alone, and send there again what datagrams may have lost."""
        self.by_datagram = False
        self.all_cast = self.sender.done
        self._again.extend(lost)

    # --- what is to be sent

    def supply(self) -> list[Frame] | None:
        """The next frame for the connection, in parts; None: nothing now, or no credit for it."""
        parts: list[Frame] | None
        if self._again:
            parts = [self.id + self._again.popleft()]
        else:
            room = self._allowed - self.sent
            if room <= 0:
                return None
            room = min(self._chunk, max(room, MIN_ROOM + ID_BYTES))
            parts = self.sender.next_parts(room, self.id)
        self.sent += sum(map(len, parts or ()))
        return parts

    def next_for_datagram(self, room: int) -> bytes | None:
        """The next frame for a datagram of that many bytes; None: nothing now, or not this way."""
        fits = room >= MIN_ROOM or self.sender.is_brief(room)
        return self.sender.next(room) if self.by_datagram and fits else None
