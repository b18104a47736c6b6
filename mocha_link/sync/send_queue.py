"""What a pull is to be given, the most urgent first, and how it fills frames. No sockets here."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterable

from mocha_link.store import Range, Record, wire
from mocha_link.sync import frames as sync
from mocha_link.sync.frames import header_of, record_id
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import Frame
from mocha_link.sync.sync_messages import FragmentRequest

_MIN_PIECE = 64  # a smaller one is not worth its head
# What would take less than this share of a frame is left for the next one rather than cut in two.
_SMALL_SHARE = 4
_ROOMY = 16_384  # larger frames need not be full, so nothing is cut in two once half is used
_BRIEF, _MUCH = 4_096, 16_384  # so little goes before a rest of so much
MAX_GIVEN = 65_536  # message ids that are remembered; later ones may be sent twice
_FEW = 8  # new ones are put in their place one by one
_BEGUN, _FIRST = 1 << 64, 1 << 65  # in a rank


class SendQueue:
    """Messages in the order: priority, then what was begun, then the newest.

    Where much was begun one small message goes before it, so that a contact too short for the rest
    still brings something.

    Args:
        remembered: ids of messages that were given out; later ones may be sent twice.

    Attributes:
        messages: that were given out to the end.
        frames: that were filled since it was cleared.
    """

    def __init__(self, peer: Peer, *, remembered: int = MAX_GIVEN) -> None:
        self.messages = 0
        self.frames = 0
        self._holdings = peer.holdings
        self._database = peer.node.database
        self._remembered = remembered
        self._ranks: list[int] = []  # the most urgent last
        self._records: dict[int, Record] = {}  # by rank
        # By topic key: the ranks under which messages came in, some of which may be replaced by
        # now.
        self._added: dict[int, list[int]] = {}
        self._missing: dict[int, list[Range]] = {}  # of what was begun, by message id
        self._given: set[int] = set()  # message ids

    def __len__(self) -> int:
        return len(self._ranks)

    def clear(self) -> None:
        """Begin a round, of which nothing was given."""
        self.frames = 0
        self._ranks.clear()
        self._records.clear()
        self._added.clear()
        self._missing.clear()
        self._given.clear()

    def resume(self, requests: Iterable[FragmentRequest]) -> None:
        """Go on with messages of which the peer has a part."""
        begun = []
        for message_id, total, missing in requests:
            record = self._holdings.begun(message_id) or self._database.get(header_of(message_id))
            is_same = record and len(record.body) == total and record_id(record) == message_id
            if record and is_same and message_id not in self._missing:
                begun.append(message_id)
                self._missing[message_id] = missing[::-1]
                self._holdings.begin(message_id, record)
                self._push(_rank(message_id, record.priority, begun=True), record)
        self._holdings.end_begun(begun)

    def skip(self, message_id: int) -> None:
        """The peer has got a message from another node, or a newer one."""
        self._holdings.add(message_id)
        if self._missing.pop(message_id, None):
            rank = next(
                rank for rank in self._ranks if rank & _BEGUN and _message_id(rank) == message_id
            )
            self._ranks.remove(rank)
            del self._records[rank]

    def add(self, records: Iterable[Record]) -> None:
        """Add those of some messages that the peer may lack.

        Of their topics what was replaced meanwhile and not begun goes, so that the queue holds no
        more than the database, however slow the link.
        """
        lacks = self._holdings.lacks
        new: list[int] = []
        for record in records:
            message_id = record_id(record)
            if (
                message_id in self._missing
                or message_id in self._given
                or not lacks(record, message_id)
            ):
                continue
            rank = _rank(message_id, record.priority, begun=False)
            if rank not in self._records:
                self._records[rank] = record
                new.append(rank)
        for key in {rank & 0xFFFF for rank in new} & self._added.keys():
            self._drop_replaced(key)
        for rank in new:
            self._added.setdefault(rank & 0xFFFF, []).append(rank)
        if len(new) > _FEW:
            self._ranks += new
            self._ranks.sort()
        else:
            for rank in new:
                insort(self._ranks, rank)

    def put_one_first(self) -> None:
        """Before much that was begun the smallest new message that is as urgent, if it is small."""
        top = max((rank for rank in self._ranks if rank & _BEGUN), default=None)
        if top is None:
            return
        rest = sum(end - start for start, end in self._missing[_message_id(top)])
        urgent = top // (_FIRST << 1)
        new = [r for r in self._ranks if not r & _BEGUN and r // (_FIRST << 1) == urgent]
        least = min(new, key=lambda rank: (len(self._records[rank].body), -rank), default=None)
        if least is not None and len(self._records[least].body) <= _BRIEF and rest > _MUCH:
            self._ranks.remove(least)
            self._push(least | _FIRST, self._records.pop(least))

    def fill(
        self, room: int, round_: int, prefix: bytes, *, may_be_replaced: bool
    ) -> list[Frame] | None:
        """A frame of chunks with as much as fits, in parts; None if nothing does.

        `may_be_replaced`: something was stored since the queue was filled.
        """
        room -= sync.CHUNKS_BYTES
        most = room
        wholes: list[bytes] = []
        pieces: list[bytes] = []
        data: list[Frame] = []
        tail: list[Frame] = []
        while self._ranks and len(wholes) < sync.MAX_CHUNKS:
            rank = self._ranks[-1]
            record = self._records[rank]
            body = record.body
            message_id = _message_id(rank)
            if not rank & _BEGUN:
                if may_be_replaced and self._database.get(record.header) is None:
                    self._pop()
                    continue
                needed = sync.WHOLE.size + len(body)
                if needed <= room:
                    self._pop()
                    wholes.append(sync.WHOLE.pack(message_id, len(body)))
                    data.append(body)
                    room -= needed
                    self._finish(message_id)
                    continue
                if needed <= most // _SMALL_SHARE or (most > _ROOMY and room < most // 2):
                    break
            if room < sync.PIECE.size + _MIN_PIECE or len(pieces) == sync.MAX_CHUNKS:
                break
            room -= self._piece(message_id, record, room, pieces, tail)
        if not wholes and not pieces:
            return None
        place = (round_, self.frames)
        self.frames += 1
        return sync.chunks_parts(place, wholes, pieces, data + tail, prefix)

    def _push(self, rank: int, record: Record) -> None:
        insort(self._ranks, rank)
        self._records[rank] = record

    def _piece(
        self,
        message_id: int,
        record: Record,
        room: int,
        pieces: list[bytes],
        data: list[Frame],
    ) -> int:
        """Take a piece of the first message in the queue; the room that it uses."""
        total = len(record.body)
        missing = self._missing.get(message_id)
        if missing is None:
            missing = self._missing[message_id] = [(0, total)]
            self._holdings.begin(message_id, record)
            first = self._ranks[-1] & _FIRST
            self._pop()
            self._push(_rank(message_id, record.priority, begun=True) | first, record)
        start, end = missing.pop()
        size = min(end - start, room - sync.PIECE.size)
        pieces.append(sync.PIECE.pack(message_id, total, start, size))
        data.append(memoryview(record.body)[start : start + size])
        if start + size < end:
            missing.append((start + size, end))
        elif not missing:
            del self._missing[message_id]
            self._pop()
            self._finish(message_id)
        return sync.PIECE.size + size

    def _drop_replaced(self, key: int) -> None:
        """Let go what the database does not keep any more of a topic."""
        here = [rank for rank in self._added[key] if rank in self._records]
        kept = [rank for rank in here if self._database.get(self._records[rank].header) is not None]
        for rank in set(here).difference(kept):
            del self._ranks[bisect_left(self._ranks, rank)], self._records[rank]
        self._added[key] = kept

    def _pop(self) -> None:
        del self._records[self._ranks.pop()]

    def _finish(self, message_id: int) -> None:
        if len(self._given) < self._remembered:  # a peer may follow for days
            self._given.add(message_id)
        self.messages += 1


def _rank(message_id: int, priority: int, *, begun: bool) -> int:
    """Sorts by urgency; holds the message id."""
    return (priority << 2 | begun) << 64 | (message_id & wire.STAMP_MASK) << 16 | message_id >> 48


def _message_id(rank: int) -> int:
    return (rank & 0xFFFF) << 48 | rank >> 16 & wire.STAMP_MASK
