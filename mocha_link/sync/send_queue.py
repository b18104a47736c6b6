"""The queue of messages for a pull, most urgent first, and their packing into frames."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterable

from mocha_link.store import Range, Record, wire
from mocha_link.sync import frames as sync
from mocha_link.sync.frames import header_of, record_id
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import Frame
from mocha_link.sync.sync_messages import FragmentRequest

_MIN_PIECE = 64  # a smaller piece is not worth its head
# A message that takes less than 1/4 of a frame is left for the next one rather than split.
_SMALL_SHARE = 4
_ROOMY = 16_384  # a larger frame need not be full: nothing is split once half of it is used
_BRIEF, _MUCH = 4_096, 16_384  # the small message that is sent before a large rest
MAX_SENT_IDS = 65_536  # remembered message ids; later messages may be sent twice
_FEW = 8  # up to this many new messages are inserted one by one
_BEGUN, _FIRST = 1 << 64, 1 << 65  # flags in a rank


class SendQueue:
    """Messages by priority, then partly sent ones, then by age, newest first.

    Before a large rest of a partly sent message it sends one small message, so that a contact that
    is too short for the rest still delivers something.

    Args:
        remembered: the number of sent message ids that are remembered; later messages may be sent
            twice.

    Attributes:
        messages: messages that were completely sent.
        frames: frames that were filled since `clear`.
    """

    def __init__(self, peer: Peer, *, remembered: int = MAX_SENT_IDS) -> None:
        self.messages = 0
        self.frames = 0
        self._holdings = peer.holdings
        self._database = peer.node.database
        self._remembered = remembered
        self._ranks: list[int] = []  # the most urgent last
        self._records: dict[int, Record] = {}  # by rank
        # By topic key: ranks of the added messages, some of which may have been replaced.
        self._added: dict[int, list[int]] = {}
        self._missing: dict[int, list[Range]] = {}  # of partly sent messages, by message id
        self._sent_ids: set[int] = set()  # ids of sent messages

    def __len__(self) -> int:
        return len(self._ranks)

    def clear(self) -> None:
        """Clear the queue for a new round."""
        self.frames = 0
        self._ranks.clear()
        self._records.clear()
        self._added.clear()
        self._missing.clear()
        self._sent_ids.clear()

    def resume(self, requests: Iterable[FragmentRequest]) -> None:
        """Continue messages of which the peer has a part."""
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
        """Drop a message that the peer has received from another node, or no longer needs."""
        self._holdings.add(message_id)
        if self._missing.pop(message_id, None):
            rank = next(
                rank for rank in self._ranks if rank & _BEGUN and _message_id(rank) == message_id
            )
            self._ranks.remove(rank)
            del self._records[rank]

    def add(self, records: Iterable[Record]) -> None:
        """Add those of the messages that the peer may lack.

        Queued messages of the same topics are dropped if newer ones have replaced them and they are
        not partly sent. The queue thus holds no more than the database, even on a slow link.
        """
        lacks = self._holdings.lacks
        new: list[int] = []
        for record in records:
            message_id = record_id(record)
            if (
                message_id in self._missing
                or message_id in self._sent_ids
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
        """Move a small message of the same priority before a large rest of a partly sent one."""
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
        """A frame of chunks with as much as fits, in parts; None if nothing fits.

        `may_be_replaced`: the database has changed since the queue was filled.
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
        """Cut a piece from the first message in the queue; returns the room that it uses."""
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
        """Drop messages of a topic that the database no longer keeps."""
        here = [rank for rank in self._added[key] if rank in self._records]
        kept = [rank for rank in here if self._database.get(self._records[rank].header) is not None]
        for rank in set(here).difference(kept):
            del self._ranks[bisect_left(self._ranks, rank)], self._records[rank]
        self._added[key] = kept

    def _pop(self) -> None:
        del self._records[self._ranks.pop()]

    def _finish(self, message_id: int) -> None:
        if len(self._sent_ids) < self._remembered:  # a peer may follow for days
            self._sent_ids.add(message_id)
        self.messages += 1


def _rank(message_id: int, priority: int, *, begun: bool) -> int:
    """A number that sorts by urgency and contains the message id."""
    return (priority << 2 | begun) << 64 | (message_id & wire.STAMP_MASK) << 16 | message_id >> 48


def _message_id(rank: int) -> int:
    return (rank & 0xFFFF) << 48 | rank >> 16 & wire.STAMP_MASK
