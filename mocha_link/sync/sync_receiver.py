"""The pulling side of a sync between new nodes: one pull from one peer. No sockets here."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from itertools import chain
from operator import itemgetter
from typing import NamedTuple

from mocha_link.clock import Instant
from mocha_link.store import (
    UNSAFE_MS,
    WRAP_MS,
    Header,
    Knowledge,
    PayloadError,
    Record,
    impossibility,
    is_alone,
    wire,
)
from mocha_link.sync import frames as sync
from mocha_link.sync import sync_messages
from mocha_link.sync.credit import MAX_CHUNK
from mocha_link.sync.frames import SyncFrameError
from mocha_link.sync.holdings import Holdings
from mocha_link.sync.peer import Peer, check_type
from mocha_link.sync.protocol import Frame
from mocha_link.sync.sync_messages import Digest, Have, Reception, Since

ROOM = 65_536
_REPAIRS = 2  # rounds that only request damaged messages again
_SKIP_BYTES = 4_096  # a SKIP pays off for at least so much that we have already
_MAX_AHEAD = 65_536
_MAX_BEGUN = 1_024
_MAX_FAILED = 1_024
_MAX_GIVEN = 65_536  # messages beyond are reported to the peer in the next pull like ours
_MAX_REFUSALS = 100  # that are reported of one frame


class Chunks(NamedTuple):
    """A frame of chunks, `number` of its round."""

    round: int
    number: int
    wholes: list[tuple[int, memoryview]]  # message id, body
    pieces: list[tuple[int, int, int, memoryview]]  # message id, size of the whole, offset, data


def read_chunks(frame: Frame, more: Sequence[Frame] = ()) -> Chunks:
    """Read a frame of chunks that may be in several parts. Raises SyncFrameError.

    Data are copied only where they go on from one part to the next.
    """
    if len(frame) < sync.CHUNKS_BYTES:
        raise SyncFrameError(f"a frame of {len(frame)} bytes")
    kind, checksum, round_, number, whole_count, piece_count = sync.CHUNKS_HEAD.unpack_from(frame)
    middle = sync.CHUNKS_BYTES + whole_count * sync.WHOLE.size
    end = middle + piece_count * sync.PIECE.size
    view = memoryview(frame)
    covered = view[sync.COVERED : end]
    many = max(whole_count, piece_count) > sync.MAX_CHUNKS
    if many or end > len(frame) or kind != sync.CHUNKS or zlib.crc32(covered, kind) != checksum:
        raise SyncFrameError(f"a frame with {whole_count} messages" if many else "a damaged frame")
    wholes = list(sync.WHOLE.iter_unpack(view[sync.CHUNKS_BYTES : middle]))
    pieces = list(sync.PIECE.iter_unpack(view[middle:end]))
    for message_id, total, offset, length in pieces:
        if offset + length > total or not length or not sync.is_body(message_id, total):
            raise SyncFrameError(f"a piece of {length} bytes at {offset} of {total}")
    sizes = list(map(itemgetter(-1), chain(wholes, pieces)))
    if 0 in sizes:
        raise SyncFrameError("a message of 0 bytes")
    parts: list[memoryview] = [view[end:]]
    parts.extend(map(memoryview, more))
    room = sum(map(len, parts))
    if sum(sizes) != room or room > MAX_CHUNK:  # it might unpack to 255 times as much
        raise SyncFrameError(f"chunks of {sum(sizes)} bytes in a frame with {room}")
    contents: list[memoryview] = []
    index = at = 0
    for size in sizes:
        found: list[memoryview] = []
        missing = size
        while missing:
            piece = parts[index][at : at + missing]
            found.append(piece)
            missing -= len(piece)
            at += len(piece)
            if at == len(parts[index]):
                index, at = index + 1, 0
        contents.append(found[-1] if len(found[-1]) == size else memoryview(b"".join(found)))
    bodies = list(zip(map(itemgetter(0), wholes), contents, strict=False))
    rest = zip(pieces, contents[whole_count:], strict=True)
    cut = [(*piece[:3], data) for piece, data in rest] if pieces else []
    return Chunks(round_, number, bodies, cut)


class SyncReceiver:
    """Stores the messages of one pull from one peer. Make one per pull.

    With `follow` in the node's context a pull that brought everything is not the end: what the peer
    stores later is taken in as it comes, until the next pull.

    Args:
        peer: the peer that sends; records refusals and events.
        budget: bytes of frames that the peer may send; 0: no limit.
        room: the largest frame that we may send.

    Attributes:
        over: the pull has ended.
        follows: the pull has ended, and the peer pushes new messages.
        complete: everything that the peer had has come in.
        pull_needed: what the peer stored later waits for the next pull.
        rejection: why the peer and we do not understand each other; nothing more is taken then.
        messages: that were stored.
        bytes: of the frames that came in.
    """

    def __init__(self, peer: Peer, *, budget: int = 0, room: int = ROOM) -> None:
        self.over = False
        self.follows = False
        self.complete = False
        self.pull_needed = False
        self.rejection: str | None = None
        self.messages = 0
        self.bytes = 0
        self._peer = peer
        self._database = peer.node.database
        self._reassembly = peer.node.reassembly
        self._holdings = Holdings(peer)
        self._topics = peer.node.team.topics_by_key
        self._budget = budget
        self._room = room
        self._assembler = sync.MessageAssembler(
            sync.HELLO, sync.GROUPS, sync.DONE, sync.NEWS, sync.TOPICS
        )
        self._unclear: int | None = None  # configuration hash of the peer whose topics are to come
        self._round = 0  # of our OPENs
        self._repairs = 0  # repair rounds so far
        self._now = Instant(0.0, 0.0)  # of the frame at hand
        self._refusals_end = 0  # no refusals beyond this number are recorded
        self._replies: list[bytes] = []  # frames in reply to the present one
        self._next = 0  # frames of chunks of this round: all below it have come, and `_ahead`
        self._ahead: set[int] = set()  # that came ahead of it
        self._damaged = 0  # frames
        self._done: sync_messages.Done | None = None  # of this round
        self._given: set[int] = set()  # messages that the peer gave us before it was over
        self._begun: set[int] = set()  # messages of which a part came in this pull
        self._skipped: set[int] = set()  # requested not to be sent on
        self._failed: set[int] = set()  # messages
        self._flawed = False  # this round lacks something that may be requested again
        self._hopeless = False  # it will not come whole in this pull

    def open(self, now: Instant) -> list[bytes]:
        """Begin the pull; returns the frames of the opening."""
        self._now = now
        return self._opening(self._holdings.knowledge(now))

    def receive(self, frame: Frame, now: Instant, more: Sequence[Frame] = ()) -> list[bytes]:
        """Process a frame of the peer, `more` if it has further parts; returns the replies.

        A bad one is refused.
        """
        if (self.over and not self.follows) or self.rejection:
            return []
        self.bytes += len(frame) + sum(map(len, more))
        self._now = now
        self._refusals_end = len(self._peer.log.refusals) + _MAX_REFUSALS
        try:
            if len(frame) and frame[0] == sync.CHUNKS:
                self._take_chunks(read_chunks(frame, more))
            else:
                self._on_message(frame if not more else b"")  # messages have one part
        except SyncFrameError as error:
            self._refuse(str(error))
            self._damaged += 1
            self._flawed = True
        done = self._done
        received = done and self._next + len(self._ahead) + self._damaged >= done.frames
        if done and received and not self.over:
            self._finish(done)
        replies, self._replies = self._replies, []
        return replies

    def _begin_round(self, knowledge: Since | Have | Digest) -> None:
        self._round += 1
        self._next = self._damaged = 0
        self._ahead.clear()
        self._skipped.clear()
        self._done, self._flawed = None, False
        self._replies += self._opening(knowledge)

    def _opening(self, knowledge: Since | Have | Digest) -> list[bytes]:
        node = self._peer.node
        opening = sync_messages.Open(
            node.boot_id,
            self._budget,
            knowledge,
            self._holdings.requests(self._now.unix_s),
            node.config_hash,
            self._peer.tokens.received,
            self._peer.agreement.known_hash,
        )
        return self._frames(sync.OPEN, opening.encode())

    def _frames(self, kind: int, content: bytes) -> list[bytes]:
        return sync.message_frames(kind, self._round, content, self._room)

    def _on_message(self, frame: Frame) -> None:
        message = self._assembler.take(frame)
        if message is None or message.round != self._round:
            return
        if message.kind == sync.HELLO:
            self._on_hello(sync_messages.Hello.decode(message.content))
        elif message.kind == sync.TOPICS:
            topics = sync_messages.decode_topics(message.content)
            self._peer.agreement.receive_topics(*topics)
            self._compare_topics()
        elif message.kind == sync.GROUPS:
            groups = sync_messages.decode_groups(message.content)
            held = [self._holdings.differing_groups(*each) for each in groups.items()]
            self._replies += self._frames(sync.ANSWER, sync_messages.encode_answers(held))
        elif message.kind == sync.NEWS:
            announced = sync_messages.decode_news(message.content)
            wanted = [m for m in announced if not self._is_impossible(m) and self._wants(m)]
            self.pull_needed |= not announced or bool(wanted)
            self._peer.offers.announce(wanted)
        else:
            self._done = sync_messages.Done.decode(message.content)

    def _on_hello(self, hello: sync_messages.Hello) -> None:
        peer = self._peer
        peer.tokens.receive(hello.address_token)
        peer.process.report_duplicated(duplicated=hello.duplicate)
        if hello.version != sync_messages.VERSION:
            self.rejection = (
                f"{peer.name} speaks version {hello.version} of the sync, "
                f"we {sync_messages.VERSION}; install the same release on both"
            )
        elif hello.reception is Reception.UNREADABLE:
            self.rejection = f"{peer.name} could not read how we began; damaged on its way"
        elif (
            not peer.agreement.compare(hello.config_hash)
            or hello.reception is Reception.TOPICS_WANTED
        ):
            self._unclear = hello.config_hash
            self._compare_topics()
        elif hello.reception is Reception.UNKNOWN and self._round + 1 < sync.ROUNDS:
            self._begin_round(self._holdings.all())

    def _compare_topics(self) -> None:
        """Say what ids mean to us, and begin again, once it is known what they mean to the peer."""
        peer, node = self._peer, self._peer.node
        if self._unclear is None or not peer.agreement.compare(self._unclear):
            return
        self._unclear = None
        if self._round + 1 < sync.ROUNDS:
            topics = sync_messages.encode_topics(node.config_hash, node.definitions)
            self._replies += self._frames(sync.TOPICS, topics)
            self._begin_round(self._holdings.knowledge(self._now))

    def _take_chunks(self, chunks: Chunks) -> None:
        if chunks.round == self._round and not self._count(chunks.number):
            return
        for message_id, body in chunks.wholes:
            keeps = len(body) >= sync.LARGE_BYTES and is_alone(body)
            self._take_message(message_id, body if keeps else bytes(body))
        for piece in chunks.pieces:
            self._take_piece(*piece)

    def _count(self, number: int) -> bool:
        """Note that a frame of this round has come; whether it is the first time."""
        if number < self._next or number in self._ahead:
            return False
        if number == self._next:
            self._next += 1
            while self._next in self._ahead:
                self._ahead.remove(self._next)
                self._next += 1
        elif len(self._ahead) < _MAX_AHEAD:
            self._ahead.add(number)
        else:
            raise SyncFrameError("a frame far ahead of the others")
        return True

    def _take_piece(self, message_id: int, total: int, offset: int, data: memoryview) -> None:
        if self._is_impossible(message_id):
            return
        # Another peer has brought it, or a newer one, or is at it.
        if not self._wants(message_id) or self._holdings.leaves(message_id, total, self._now):
            self._begun.discard(message_id)
            more = total - offset - len(data) > _SKIP_BYTES and len(self._skipped) < _MAX_BEGUN
            if more and message_id not in self._skipped:
                self._skipped.add(message_id)
                self._replies += self._frames(sync.SKIP, sync_messages.encode_skip(message_id))
            return
        if message_id not in self._begun and len(self._begun) >= _MAX_BEGUN:
            raise SyncFrameError("parts of too many messages")
        body = self._reassembly.add(message_id, total, offset, data, self._peer.name)
        if body is None:
            self._begun.add(message_id)
        else:
            self._begun.discard(message_id)
            self._take_message(message_id, body)

    def _take_message(self, message_id: int, body: Frame) -> None:
        if self._is_impossible(message_id):
            return
        peer, stamp_ms = self._peer, message_id & wire.STAMP_MASK
        robot, topic = known = self._topics[message_id >> 48]
        try:
            trailer = wire.check(body, (robot.robot_id, topic.topic_id), stamp_ms)
            if trailer is None:
                check_type(body, topic)
        except PayloadError as error:  # damaged on its way, perhaps
            self._refuse(f"message {message_id:016x}: {error}")
            if not self._reassembly.fail(message_id):  # of this peer alone
                self._hopeless |= message_id in self._failed or len(self._failed) >= _MAX_FAILED
                self._failed.add(message_id)
            self._flawed = True
        else:
            header = Header.at(robot.robot_id, topic.topic_id, stamp_ms)
            now_s = self._now.unix_s
            record = Record(header, topic.priority, body, stamp_ms, now_s, trailer is None)
            peer.holdings.add(message_id)
            if not self.over and len(self._given) < _MAX_GIVEN:
                self._given.add(message_id)
            try:
                self.messages += peer.store(known, record, trailer)
            except PayloadError as error:  # intact, so it will not be another one next time
                self._refuse(f"message {message_id:016x}: {error}")
                self._reassembly.fail(message_id, but=peer.name)
                return
            if self._reassembly.cost:
                self._reassembly.drop(message_id)

    def _is_impossible(self, message_id: int) -> bool:
        """Whether a message has unknown ids or an impossible time; records the refusal."""
        stamp_ms = message_id & wire.STAMP_MASK
        taken = wire.is_taken(stamp_ms, self._now.unix_s)
        safe = taken and stamp_ms % WRAP_MS > UNSAFE_MS
        key = message_id >> 48
        if safe and key in self._topics and self._peer.agreement.exchanges(key):
            return False
        robot_id, topic_id = divmod(message_id >> 48, 256)
        why = impossibility(self._peer.node.team, robot_id, topic_id, stamp_ms, self._now.unix_s)
        self._refuse(f"message {message_id:016x}: {why}")
        return True

    def _wants(self, message_id: int) -> bool:
        return self._holdings.wants(message_id, self._now.unix_s)

    def _finish(self, done: sync_messages.Done) -> None:
        left = set(filter(self._wants, self._holdings.left))
        elsewhere = self._reassembly.elsewhere(self._peer.name, self._now.steady_s)
        missing = [*filter(self._wants, self._begun), *(left - elsewhere)]
        flawed = self._flawed or bool(missing)
        final = self._repairs == _REPAIRS or self._round + 1 == sync.ROUNDS
        if flawed and not (done.cut_short or self._hopeless or final):
            self._repairs += 1
            self._begin_round(self._holdings.knowledge(self._now))
            return
        self.over = True
        self._peer.offers.still_left(left)
        is_sound = not (flawed or done.cut_short)
        self.complete = is_sound and not left
        if self.complete and not self._peer.agreement.config_mismatch:  # else not all was offered
            own_sequence = self._holdings.unannounced_since(self._given)
            knowledge = Knowledge(done.epoch, done.sequence, own_sequence)
            if knowledge != self._database.knowledge(self._peer.name):
                self._database.learn(self._peer.name, knowledge)
        self.follows = self._peer.node.follow and is_sound
        followed = sorted(self._peer.node.followed)
        kind, robots = (sync.FOLLOW, followed) if self.follows else (sync.END, [])
        self._replies += self._frames(kind, bytes(robots))

    def _refuse(self, reason: str) -> None:
        if len(self._peer.log.refusals) < self._refusals_end:
            self._peer.log.refuse(reason)
