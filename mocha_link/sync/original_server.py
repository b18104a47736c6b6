"""The answering side of a sync with an original node. No sockets here.

What such a node asks for stands in `original_client`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mocha_link.clock import Instant
from mocha_link.links.link_events import Direction
from mocha_link.store.record import Kept
from mocha_link.store.wire import Header, HeaderError
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import (
    ACK,
    CODE_BYTES,
    DENDT,
    GDATA,
    GHEAD,
    ID_BYTES,
    PATIENCE_S,
    SERRM,
)

FORGET_S = 60.0  # after so long a silence nothing of a client can be on its way either
# An original client lets go of an answer that takes more than 6 s, and of all that stands behind
# it in the list. Smaller ones take so long on no link that is worth the name.
LATE_BYTES = 32 * 1024


@dataclass(slots=True)
class _Served:
    """What the peer has pulled since its GHEAD."""

    since_s: float  # of its GHEAD, steady clock
    messages: int = 0  # given out
    bytes: int = 0  # of replies
    given_up: bool = False  # it was told as timed out


class ServerSession:
    """Answers one peer that asks as original nodes do, and tells when its pulls start and end.

    Topics whose messages the peer did not stay for come last in the lists, and starve nothing else.
    """

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._database = peer.node.database
        self._pull: _Served | None = None  # None: none since the last DENDT
        self._heard_s = 0.0  # steady clock
        # What was offered stays available, though newer messages replace it, until well after the
        # peer has asked for another list.
        self._offered: Mapping[bytes, Kept] = {}
        self._offered_before: Mapping[bytes, Kept] = {}  # by the list before this
        self._listed_s = 0.0  # when the last list left
        self._late: set[bytes] = set()  # topics that come last: first bytes of their headers
        self._under_way = b""  # topic of the large answer that is not known to have arrived

    def answer(self, parts: Sequence[bytes], now: Instant) -> bytes:
        """The reply to the body parts of a request (a good one has one part)."""
        self._heard_s = now.steady_s
        frame = parts[0] if parts else b""
        request_id, code = frame[:ID_BYTES], frame[ID_BYTES : ID_BYTES + CODE_BYTES]
        argument = frame[ID_BYTES + CODE_BYTES :]
        body: bytes | memoryview = SERRM
        self._note_arrival(code)
        if len(parts) != 1:
            pass
        elif code == GHEAD:
            self._give_up(now, "the peer began anew")
            self._pull = _Served(now.steady_s)
            self._peer.tell_start(Direction.OUT, now)
            body = self._list(now)
        elif code == GDATA:
            body = self._data(argument, now)
        elif code == DENDT:
            body = ACK
            self._end(now)
        if self._pull:
            self._pull.bytes += ID_BYTES + len(body)
        return b"".join((request_id, body))

    def tick(self, now: Instant) -> None:
        """What the peer's silence ends."""
        silence_s = now.steady_s - self._heard_s
        if silence_s <= PATIENCE_S:
            return
        if silence_s > FORGET_S and self._offered:  # a peer that is gone must not keep it all
            self._offered = self._offered_before = {}
        self._give_up(now, f"the peer asked nothing for {PATIENCE_S:g} s")

    @property
    def wake_s(self) -> float | None:
        """When to call `tick` at the latest, in steady seconds; None: the time brings nothing."""
        if self._pull and not self._pull.given_up:
            return self._heard_s + PATIENCE_S
        return self._heard_s + FORGET_S if self._offered else None

    def _note_arrival(self, code: bytes) -> None:
        """Another request: the large answer that was under way has arrived, or was let go of."""
        topic, self._under_way = self._under_way, b""
        if topic and code == GHEAD:
            self._late.add(topic)
        else:
            self._late.discard(topic)

    def _end(self, now: Instant) -> None:
        pull, self._pull = self._pull, None
        if pull:
            self._peer.tell_end(
                Direction.OUT,
                now,
                began_s=pull.since_s,
                messages=pull.messages,
                size=pull.bytes + ID_BYTES + len(ACK),
            )

    def _give_up(self, now: Instant, reason: str) -> None:
        """Count the pull as broken off; on a slow link its DENDT may still come."""
        if self._pull and not self._pull.given_up:
            self._pull.given_up = True
            self._peer.tell_timeout(Direction.OUT, reason, now)

    def _list(self, now: Instant) -> bytes:
        self._offered_before, self._offered = self._offered, self._database.snapshot()
        self._listed_s = now.steady_s
        headers = self._database.header_list()
        if not self._late:
            return headers
        starts = range(0, len(headers), Header.SIZE)
        each = [headers[start : start + Header.SIZE] for start in starts]
        each.sort(key=lambda header: header[:2] in self._late)
        return b"".join(each)

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
        if len(record.body) >= LATE_BYTES:
            self._under_way = argument[:2]
        return record.body
