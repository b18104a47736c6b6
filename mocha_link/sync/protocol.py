"""The frames of the wire, and the answering side of a sync.

A request is ID (6 bytes, any) + CODE (5 letters) + argument; the reply repeats the ID. A pull is
GHEAD (the list of headers), one GDATA per wanted message, DENDT. Nothing here touches sockets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mocha_link.clock import Instant
from mocha_link.links.link_events import Direction, LinkEvent, SyncEnded, SyncStarted, SyncTimedOut
from mocha_link.store.database import Database
from mocha_link.store.index import Kept
from mocha_link.store.record import Header, HeaderError

ID_BYTES = 6
CODE_BYTES = 5
GHEAD, GDATA, DENDT = b"GHEAD", b"GDATA", b"DENDT"
# Between new nodes: open a sync, a later frame of it, more credit. Original nodes refuse them.
SYNC1, SYNCF, SYNCC = b"SYNC1", b"SYNCF", b"SYNCC"
SERRM, ACK = b"SERRM", b"Ack"

# An original client is idle again 12.4 s after its last unanswered request. Until then it may ask
# for what was offered to it, and it would store an error reply as if it were a message.
PATIENCE_S = 13.0
FORGET_S = 60.0  # after so long a silence nothing of it can be on its way either
# An original client lets go of an answer that takes more than 6 s, and of all that stands behind
# it in the list. Smaller ones take so long on no link that is worth the name.
LATE_BYTES = 32 * 1024


def request(request_id: bytes, code: bytes, argument: bytes = b"") -> bytes:
    """A request frame."""
    return request_id + code + argument


class _Late:
    """Topics whose messages the peer did not stay for: they come last, and starve nothing else."""

    def __init__(self) -> None:
        self._topics: set[bytes] = set()  # first bytes of their headers
        self._under_way = b""  # topic of the answer that is not known to have arrived

    def asked(self, code: bytes) -> None:
        """Another request: what was under way has arrived, or was let go of."""
        topic, self._under_way = self._under_way, b""
        if topic and code == GHEAD:
            self._topics.add(topic)
        else:
            self._topics.discard(topic)

    def answered(self, header: bytes, size: int) -> None:
        """An answer to GDATA leaves."""
        if size >= LATE_BYTES:
            self._under_way = header[:2]

    def sort(self, headers: bytes) -> bytes:
        """A list of headers with these topics at its end."""
        if not self._topics:
            return headers
        starts = range(0, len(headers), Header.SIZE)
        each = [headers[start : start + Header.SIZE] for start in starts]
        each.sort(key=lambda header: header[:2] in self._topics)
        return b"".join(each)


@dataclass(slots=True)
class _Pull:
    """What the peer has pulled since its GHEAD."""

    since_s: float  # of its GHEAD, steady clock
    messages: int = 0  # given out
    bytes: int = 0  # of replies
    given_up: bool = False  # it was told as timed out


class ServerSession:
    """Answers one peer, whatever it sends, and tells when its pulls start and end."""

    def __init__(self, peer: str, database: Database) -> None:
        self._peer = peer
        self._database = database
        self._pull: _Pull | None = None  # None: none since the last DENDT
        self._heard_s = 0.0  # steady clock
        # What was offered stays available, though newer messages replace it, until well after the
        # peer has asked for another list.
        self._offered: Mapping[bytes, Kept] = {}
        self._offered_before: Mapping[bytes, Kept] = {}  # by the list before this
        self._listed_s = 0.0  # when the last list left
        self._late = _Late()

    def answer(self, parts: Sequence[bytes], now: Instant) -> tuple[bytes, list[LinkEvent]]:
        """The reply to the body parts of a request (a good one has one part), and what it began."""
        self._heard_s = now.steady_s
        frame = parts[0] if parts else b""
        request_id, code = frame[:ID_BYTES], frame[ID_BYTES : ID_BYTES + CODE_BYTES]
        argument = frame[ID_BYTES + CODE_BYTES :]
        events: list[LinkEvent] = []
        body: bytes | memoryview
        self._late.asked(code)
        if len(parts) != 1:
            body = SERRM
        elif code == GHEAD:
            events = self._begin(now)
            body = self._list(now)
        elif code == GDATA:
            body = self._data(argument, now)
        elif code == DENDT:
            events = self._end(now)
            body = ACK
        else:
            body = SERRM
        if self._pull:
            self._pull.bytes += ID_BYTES + len(body)
        return b"".join((request_id, body)), events

    def tick(self, now: Instant) -> list[LinkEvent]:
        """What the peer's silence ends."""
        silence_s = now.steady_s - self._heard_s
        if silence_s <= PATIENCE_S:
            return []
        if silence_s > FORGET_S and self._offered:  # a peer that is gone must not keep it all
            self._offered = self._offered_before = {}
        return self._give_up(now, f"the peer asked nothing for {PATIENCE_S:g} s")

    def _begin(self, now: Instant) -> list[LinkEvent]:
        events = self._give_up(now, "the peer began anew")
        self._pull = _Pull(now.steady_s)
        return [*events, SyncStarted(self._peer, now.unix_s, Direction.OUT)]

    def _end(self, now: Instant) -> list[LinkEvent]:
        pull, self._pull = self._pull, None
        if pull is None:
            return []
        return [
            SyncEnded(
                self._peer,
                now.unix_s,
                Direction.OUT,
                messages=pull.messages,
                bytes=pull.bytes + ID_BYTES + len(ACK),
                duration_s=now.steady_s - pull.since_s,
            )
        ]

    def _give_up(self, now: Instant, reason: str) -> list[LinkEvent]:
        """Count the pull as broken off; on a slow link its DENDT may still come."""
        if self._pull is None or self._pull.given_up:
            return []
        self._pull.given_up = True
        return [SyncTimedOut(self._peer, now.unix_s, Direction.OUT, reason)]

    def _list(self, now: Instant) -> bytes:
        self._offered_before, self._offered = self._offered, self._database.snapshot()
        self._listed_s = now.steady_s
        return self._late.sort(self._database.header_list())

    def _data(self, argument: bytes, now: Instant) -> bytes | memoryview:
        try:
            record = self._database.get(Header.parse(argument))
        except HeaderError:
            return SERRM
        if record is None:
            if now.steady_s - self._listed_s > PATIENCE_S:
                self._offered_before = {}
            kept = self._offered.get(argument) or self._offered_before.get(argument)
            if kept is None:
                return SERRM
            record = kept.record
        if self._pull:
            self._pull.messages += 1
        self._late.answered(argument, len(record.body))
        return record.body
