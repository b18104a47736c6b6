"""The frames of the wire, and the answering side of a sync.

A request is ID (6 bytes, any) + CODE (5 letters) + argument; the reply repeats the ID. A pull is
GHEAD (the list of headers), one GDATA per wanted message, DENDT. Nothing here touches sockets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mocha_link.header import Header, HeaderError
from mocha_link.metrics import Direction, LinkEvent, SyncEnded, SyncStarted, SyncTimedOut

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mocha_link.clock import Instant
    from mocha_link.database import Database, Record

ID_BYTES = 6
CODE_BYTES = 5
GHEAD, GDATA, DENDT = b"GHEAD", b"GDATA", b"DENDT"
SERRM, ACK = b"SERRM", b"Ack"

# An original client is idle again 12.4 s after its last unanswered request. Until then it may ask
# for what was offered to it, and it would store an error reply as if it were a message.
PATIENCE_S = 13.0
# Of what was replaced since it was offered, so much is kept for one peer, the newest first.
KEPT_BYTES = 64 * 1024 * 1024


def request(request_id: bytes, code: bytes, argument: bytes = b"") -> bytes:
    """A request frame."""
    return request_id + code + argument


@dataclass(slots=True)
class _Pull:
    """What the peer has pulled since its GHEAD."""

    since_s: float
    messages: int = 0
    bytes: int = 0
    given_up: bool = False


class ServerSession:
    """Answers one peer, whatever it sends, and tells when its pulls start and end."""

    def __init__(self, peer: str, database: Database) -> None:
        self._peer = peer
        self._database = database
        self._pull: _Pull | None = None
        self._heard_s = 0.0
        self._offered: dict[Header, tuple[Record, float]] = {}

    def answer(self, parts: Sequence[bytes], now: Instant) -> tuple[bytes, list[LinkEvent]]:
        """The reply to the body parts of a request (a good one has one part), and what it began."""
        self._heard_s = now.steady_s
        frame = parts[0] if parts else b""
        request_id, code = frame[:ID_BYTES], frame[ID_BYTES : ID_BYTES + CODE_BYTES]
        argument = frame[ID_BYTES + CODE_BYTES :]
        events: list[LinkEvent] = []
        if len(parts) != 1:
            body = SERRM
        elif code == GHEAD:
            events = self._begin(now)
            body = self._list(now)
        elif code == GDATA:
            body = self._data(argument)
        elif code == DENDT:
            events = self._end(now)
            body = ACK
        else:
            body = SERRM
        if self._pull:
            self._pull.bytes += ID_BYTES + len(body)
        return request_id + body, events

    def tick(self, now: Instant) -> list[LinkEvent]:
        """What the peer's silence ends."""
        if now.steady_s - self._heard_s <= PATIENCE_S:
            return []
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
        # What was offered stays available, though newer messages replace it, until well after the
        # peer has asked for another list.
        records = self._database.records()
        offered = {record.header: (record, now.steady_s) for record in records}
        kept: list[tuple[Record, float]] = []
        room = KEPT_BYTES
        for header, (record, offered_s) in reversed(self._offered.items()):
            if header in offered or now.steady_s - offered_s > PATIENCE_S:
                continue
            room -= len(record.body)
            if room < 0:
                break
            kept.append((record, offered_s))
        self._offered = {record.header: (record, since) for record, since in reversed(kept)}
        self._offered.update(offered)
        return b"".join(record.header.pack() for record in records)

    def _data(self, argument: bytes) -> bytes:
        try:
            header = Header.parse(argument)
        except HeaderError:
            return SERRM
        record = self._database.newest(header.robot_id, header.topic_id)
        if record is None or record.header != header:
            if header not in self._offered:
                return SERRM
            record = self._offered[header][0]
        if self._pull:
            self._pull.messages += 1
        return record.body
