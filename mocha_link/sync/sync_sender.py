"""The serving side of a sync between new nodes: one pull of one peer. No sockets here."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable

from mocha_link.store import wire
from mocha_link.store.reassembly_buffer import Range
from mocha_link.store.record import Record
from mocha_link.store.wire import Header
from mocha_link.sync import frames as sync
from mocha_link.sync import sync_messages
from mocha_link.sync.frames import record_id
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import Frame
from mocha_link.sync.sync_messages import Digest, Have, Hello, Reception, Since, VersionError

MIN_ROOM = 300
_MIN_PIECE = 64  # a smaller one is not worth its head
_DONE_BYTES = sync.MESSAGE_HEADER_BYTES + sync_messages.DONE_BYTES
# What would take less than this share of a frame is left for the next one rather than cut in two.
_SMALL_SHARE = 4
_ROOMY = 16_384  # larger frames need not be full, so nothing is cut in two once half is used
_BRIEF, _MUCH = 4_096, 16_384  # so little goes before a rest of so much
PUSH_BYTES = 65_536  # a larger message waits for the next pull, which may take its time
_FEW = 8  # new ones are put in their place one by one
_BEGUN, _FIRST = 1 << 64, 1 << 65  # in a rank


class SyncSender:
    """Gives one peer what it lacks, the most urgent first, in frames of any size.

    Looks into the database before every frame, so what is stored meanwhile joins in. Order:
    priority, then what was begun, then the newest. Where much was begun one small message goes
    before it, so that a contact too short for the rest still brings something. Make one per pull.

    A peer that follows gets what is stored after the pull at once: messages of the robots in
    `Peer.pushed`, small ones, of no promise. Its next pull brings whatever else there is.

    Attributes:
        over: the peer has said that it is.
        follows: all was given out, and the peer waits for more.
        done: all has been given out, or all that the peer's budget allows.
        cut_short: not all, because the budget was used up.
        rejection: why the peer gets nothing, once it has opened.
        admitted: the peer has shown an address token of ours.
        messages: that were given out to the end.
        bytes: of all frames.
    """

    def __init__(self, peer: Peer) -> None:
        self.over = False
        self.follows = False
        self.done = False
        self.cut_short = False
        self.rejection: Reception | None = None
        self.admitted = False
        self.messages = 0
        self.bytes = 0
        self._peer = peer
        self._database = peer.node.database
        self._assembler = sync.MessageAssembler(
            sync.OPEN, sync.ANSWER, sync.SKIP, sync.END, sync.FOLLOW
        )
        self._round = -1  # -1: the peer has not opened
        self._outbox: list[tuple[int, bytes, int]] = []  # kind, content, offset of what is left
        self._budget = 0  # bytes of the peer; 0: no limit
        self._free = 0  # bytes of group digests: they must not leave too little for any message
        self._unknown = False  # we cannot say what is new since what the peer knows
        self._asked: frozenset[int] = frozenset()  # robots whose groups the peer is to answer
        self._queue: list[int] = []  # ranks, the most urgent last
        self._records: dict[int, Record] = {}  # by rank
        self._missing: dict[int, list[Range]] = {}  # of what was begun, by message id
        self._given: set[int] = set()  # message ids in this round
        self._sequence = self._opened_at = 0  # what is stored later is new
        self._number = 0  # of the next chunk frame

    def receive(self, frame: Frame) -> None:
        """Take in a frame of the peer. Raises SyncFrameError."""
        message = self._assembler.take(frame)
        if message is None or self.over:
            return
        if message.kind == sync.OPEN:
            self._receive_opening(message)
        elif message.kind == sync.END:
            self.over = True
            self._peer.end()
        elif message.kind == sync.FOLLOW:
            self.follows = self.done and not self.cut_short
            self.over = not self.follows
            self._peer.end()
        elif message.kind == sync.SKIP:
            self._skip(sync_messages.decode_skip(message.content))
        elif message.round == self._round:
            self._answer(sync_messages.decode_answers(message.content))

    def next(self, room: int, prefix: bytes = b"") -> bytes | None:
        """The next frame, of at most `room` bytes (at least MIN_ROOM) with `prefix` before it.

        None: nothing to say now.
        """
        parts = self.next_parts(room, prefix)
        if parts is None:
            return None
        return bytes(parts[0]) if len(parts) == 1 else b"".join(parts)

    def is_brief(self, room: int) -> bool:
        """Whether what comes next is a message of the sync of at most so many bytes."""
        return bool(self._outbox) and sync.MESSAGE_HEADER_BYTES + len(self._outbox[0][1]) <= room

    def next_parts(self, room: int, prefix: bytes = b"") -> list[Frame] | None:
        """The same, with large data as parts of their own."""
        room -= len(prefix)
        if self.over or self._round < 0:
            return None
        if self._outbox:
            return [prefix + self._message_part(room)]
        if self.done and not self.follows:
            return None
        if self._database.sequence != self._sequence and not self._unknown:
            self._poll()
        left = room
        if self._budget:
            left = min(room, self._budget + self._free - self.bytes - _DONE_BYTES)
        parts = self._chunks(left, prefix) if self._queue else None
        if parts is not None:
            self.bytes += sum(map(len, parts)) - len(prefix)
            return parts
        if self.follows or (not self._queue and (self._unknown or self._asked)):
            return None
        self._end()
        return [prefix + self._message_part(room)]

    def _receive_opening(self, message: sync.SyncMessage) -> None:
        try:
            opening = sync_messages.Open.decode(message.content)
        except VersionError:
            self._reject(message.round, Reception.UNREADABLE)
            return
        self.admitted = self._peer.admits(opening.address_token)
        if self._peer.agrees(opening.config_hash):
            self._open(message.round, opening)
        else:
            self._reject(message.round, Reception.CONFIG_MISMATCH)

    def _reject(self, round_: int, why: Reception) -> None:
        """Say so, and nothing else, whatever else comes."""
        self._round = round_
        self.rejection = why
        self._queue.clear()
        self._asked = frozenset()
        self._unknown = True
        self._outbox = [(sync.HELLO, self._hello(why), 0)]

    def _open(self, round_: int, opening: sync_messages.Open) -> None:
        self._round = round_
        self.rejection = None
        self._budget = opening.budget
        self._number = 0
        self._queue.clear()
        self._records.clear()
        self._missing.clear()
        self._given.clear()
        self.done = self.cut_short = self._unknown = False
        self._asked = frozenset()
        self._outbox.clear()
        self._peer.met(opening.boot_id)
        self._sequence = self._opened_at = self._database.sequence  # before looking at what it has
        groups: list[tuple[int, tuple[int, ...]]] = []
        new: Iterable[Record] = ()
        match opening.knowledge:
            case Since(epoch, sequence, message_ids):
                self._note(message_ids)
                if self._database.remembers(epoch, sequence):
                    new = self._database.since(sequence)
                else:
                    self._unknown = True
            case Have(message_ids):
                self._peer.forget()
                self._note(message_ids)
                new = self._database.kept()
            case Digest(digests):
                self._peer.forget()
                new, groups = self._compare(digests)
        reception = Reception.UNKNOWN if self._unknown else Reception.WELCOME
        self._outbox.append((sync.HELLO, self._hello(reception), 0))
        if groups:
            self._asked = frozenset(robot_id for robot_id, _ in groups)
            self._outbox.append((sync.GROUPS, sync_messages.encode_groups(groups), 0))
        if not self._unknown:
            self._resume(opening.requests)
            self._enqueue(new)
            self._put_one_first()

    def _hello(self, reception: Reception) -> bytes:
        peer = self._peer
        return Hello(reception, peer.node.config_hash, address_token=peer.next_token).encode()

    def _note(self, message_ids: Iterable[int]) -> None:
        for message_id in message_ids:
            self._peer.holds(message_id)

    def _compare(
        self, digests: dict[int, int]
    ) -> tuple[list[Record], list[tuple[int, tuple[int, ...]]]]:
        """What the peer certainly lacks, and the group digests of what differs otherwise."""
        ours = self._database.digests()
        absent = ours.keys() - digests.keys()
        differing = [each for each in ours.keys() & digests.keys() if ours[each] != digests[each]]
        new = []
        if absent:
            new = [each for each in self._database.kept() if each.header.robot_id in absent]
        return new, [(each, self._database.group_digests(each)) for each in sorted(differing)]

    def _answer(self, answers: Iterable[sync_messages.Answer]) -> None:
        if not self._asked:
            return
        for _, _, message_ids in answers:
            self._note(message_ids)
        for robot_id, groups, _ in answers:
            if robot_id in self._asked:
                for group in range(sync_messages.GROUP_COUNT):
                    if groups >> group & 1:
                        self._enqueue(self._database.headers_in(robot_id, group))
        self._asked = frozenset()
        if not self._number:
            self._put_one_first()

    def _resume(self, requests: Iterable[sync_messages.FragmentRequest]) -> None:
        begun = []
        for message_id, total, missing in requests:
            record = self._peer.begun(message_id)
            if record is None:
                header = Header.at(
                    message_id >> 56, message_id >> 48 & 0xFF, message_id & wire.STAMP_MASK
                )
                record = self._database.get(header)
            is_same = record and len(record.body) == total and record_id(record) == message_id
            if record and is_same and message_id not in self._missing:
                begun.append(message_id)
                self._missing[message_id] = missing[::-1]
                self._peer.begin(message_id, record)
                self._push(_rank(message_id, record.priority, begun=True), record)
        self._peer.end(begun)

    def _skip(self, message_id: int) -> None:
        """The peer has got a message from another node, or a newer one."""
        self._peer.holds(message_id)
        if self._missing.pop(message_id, None):
            rank = next(
                rank for rank in self._queue if rank & _BEGUN and _message_id(rank) == message_id
            )
            self._queue.remove(rank)
            del self._records[rank]

    def _poll(self) -> None:
        sequence = self._database.sequence
        new = self._database.since(self._sequence)
        if self.follows:
            pushed = self._peer.pushed
            small = (record for record in new if len(record.body) <= PUSH_BYTES)
            new = [record for record in small if record.header.robot_id in pushed]
        self._enqueue(new)
        self._sequence = sequence

    def _enqueue(self, records: Iterable[Record]) -> None:
        lacks = self._peer.lacks
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
        if len(new) > _FEW:
            self._queue += new
            self._queue.sort()
        else:
            for rank in new:
                insort(self._queue, rank)

    def _put_one_first(self) -> None:
        """Before much that was begun the smallest new message that is as urgent, if it is small."""
        top = max((rank for rank in self._queue if rank & _BEGUN), default=None)
        if top is None:
            return
        rest = sum(end - start for start, end in self._missing[_message_id(top)])
        urgent = top // (_FIRST << 1)
        new = [r for r in self._queue if not r & _BEGUN and r // (_FIRST << 1) == urgent]
        least = min(new, key=lambda rank: (len(self._records[rank].body), -rank), default=None)
        if least is not None and len(self._records[least].body) <= _BRIEF and rest > _MUCH:
            self._queue.remove(least)
            self._push(least | _FIRST, self._records.pop(least))

    def _push(self, rank: int, record: Record) -> None:
        insort(self._queue, rank)
        self._records[rank] = record

    def _message_part(self, room: int) -> bytes:
        """The next part of the first message that waits."""
        kind, content, offset = self._outbox.pop(0)
        frame = sync.message_frame(kind, self._round, content, offset, room)
        offset += len(frame) - sync.MESSAGE_HEADER_BYTES
        if offset < len(content):
            self._outbox.insert(0, (kind, content, offset))
        self.bytes += len(frame)
        self._free += len(frame) if kind == sync.GROUPS else 0
        return frame

    def _end(self) -> None:
        self.cut_short = bool(self._queue)
        done = sync_messages.Done(
            self._database.epoch, self._sequence, self._number, self.cut_short
        )
        self.done = True
        self._outbox.append((sync.DONE, done.encode(), 0))

    def _chunks(self, room: int, prefix: bytes) -> list[Frame] | None:
        """As much of the queue as fits; None if nothing does."""
        room -= sync.CHUNKS_BYTES
        most = room
        wholes: list[bytes] = []
        pieces: list[bytes] = []
        data: list[Frame] = []
        tail: list[Frame] = []
        while self._queue and len(wholes) < sync.MAX_CHUNKS:
            rank = self._queue[-1]
            record = self._records[rank]
            body = record.body
            message_id = _message_id(rank)
            if not rank & _BEGUN:
                if self._sequence != self._opened_at and self._replaced(record):
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
        place = (self._round, self._number)
        self._number += 1
        return sync.chunks_parts(place, wholes, pieces, data + tail, prefix)

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
            self._peer.begin(message_id, record)
            first = self._queue[-1] & _FIRST
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

    def _pop(self) -> None:
        del self._records[self._queue.pop()]

    def _finish(self, message_id: int) -> None:
        self._given.add(message_id)
        self.messages += 1

    def _replaced(self, record: Record) -> bool:
        return self._database.get(record.header) is None


def _rank(message_id: int, priority: int, *, begun: bool) -> int:
    """Sorts by urgency; holds the message id."""
    return (priority << 2 | begun) << 64 | (message_id & wire.STAMP_MASK) << 16 | message_id >> 48


def _message_id(rank: int) -> int:
    return (rank & 0xFFFF) << 48 | rank >> 16 & wire.STAMP_MASK
