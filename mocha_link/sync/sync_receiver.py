"""The asking side of a sync between new nodes: one pull from one peer. No sockets here."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from mocha_link.clock import Instant
from mocha_link.links.metrics import MessageStored
from mocha_link.store import payload
from mocha_link.store.config_hash import difference
from mocha_link.store.database import Database
from mocha_link.store.payload import TAKEN_MS, PayloadError, Trailer
from mocha_link.store.reassembly_buffer import ReassemblyBuffer
from mocha_link.store.record import UNSAFE_MS, WRAP_MS, Header, Knowledge, Record
from mocha_link.sync import frames as sync
from mocha_link.sync import sync_messages
from mocha_link.sync.frames import Step, SyncFrameError
from mocha_link.sync.peer_state import PeerState, record_id
from mocha_link.sync.sync_messages import Digest, FragmentRequest, Have, Reception, Since
from mocha_link.team.team import Robot, Team, Topic

Verify = Callable[[Header, sync.Frame, Trailer | None], None]

ROOM = 65_536
MAX_LISTED = 512  # message ids in an OPEN; beyond that digests are shorter
SPARE_BYTES = 32_768  # what may come twice rather than cost another round trip
_REPAIRS = 2  # rounds that only ask again for what was damaged
_SKIP_BYTES = 4_096  # so much more of what we have already is worth a word
_MAX_AHEAD = 65_536
_MAX_BEGUN = 1_024
_MAX_FAILED = 1_024
_MAX_REFUSALS = 100  # that one frame is told of


class SyncReceiver:
    """Takes in what one peer gives us. Make one per pull; it is `over` when all is said.

    With `follow` a pull that brought everything is not the end: what the peer stores later is
    taken in as it comes, until the next pull.

    Args:
        peer: its name.
        team: whose robots and topics are accepted.
        database: where messages go.
        reassembly: where parts of messages wait for the rest; one for all peers.
        peer_state: what is remembered of this peer.
        verify: raises PayloadError for a message that this peer may not hand us.
        budget: bytes of frames that the peer may send; 0: no limit.
        room: the largest frame that we may send.
        follow: ask for what is stored later.

    Attributes:
        follows: all is said, and more may come.
        complete: everything that the peer had has come in.
        rejection: why the peer and we do not understand each other; nothing more is taken then.
        messages: that were stored.
        bytes: of the frames that came in.
    """

    def __init__(  # noqa: PLR0913 - all it needs to know, once
        self,
        peer: str,
        *,
        team: Team,
        database: Database,
        reassembly: ReassemblyBuffer,
        peer_state: PeerState,
        verify: Verify | None = None,
        budget: int = 0,
        room: int = ROOM,
        follow: bool = False,
    ) -> None:
        self.peer = peer
        self.over = False
        self.follows = False
        self.complete = False
        self.rejection: str | None = None
        self.messages = 0
        self.bytes = 0
        self._team = team
        self._database = database
        self._reassembly = reassembly
        self._peer_state = peer_state
        self._verify = verify
        self._budget = budget
        self._room = room
        self._follow = follow
        self._topics: dict[int, tuple[Robot, Topic] | None] = {}  # by key; None: not in the team
        self._assembler = sync.MessageAssembler(sync.HELLO, sync.GROUPS, sync.DONE)
        self._round = 0  # of our OPENs
        self._repairs = 0  # rounds that only asked again
        self._now_s = 0.0  # Unix time of the frame at hand
        self._next = 0  # frames of chunks of this round: all below it have come, and `_ahead`
        self._ahead: set[int] = set()  # that came ahead of it
        self._damaged = 0  # frames
        self._done: sync_messages.Done | None = None  # of this round
        self._begun: set[int] = set()  # messages of which a part came in this pull
        self._skipped: set[int] = set()  # asked not to be sent on
        self._failed: set[int] = set()  # messages
        self._flawed = False  # this round left something out that may be asked for again
        self._hopeless = False  # it will not come whole in this pull

    def open(self, now: Instant) -> Step:
        """Begin: say what we have."""
        self._now_s = now.unix_s
        return Step(frames=self._opening(self._knowledge()))

    def receive(self, frame: sync.Frame, now: Instant, more: Sequence[sync.Frame] = ()) -> Step:
        """Take in a frame of the peer, `more` if it has further parts; a bad one is refused."""
        step = Step()
        if (self.over and not self.follows) or self.rejection:
            return step
        self.bytes += len(frame) + sum(map(len, more))
        self._now_s = now.unix_s
        try:
            if len(frame) and frame[0] == sync.CHUNKS:
                self._chunks(sync.read_chunks(frame, more), now, step)
            else:
                self._on_message(frame if not more else b"", step)  # messages have one part
        except SyncFrameError as error:
            _refuse(step, str(error))
            self._damaged += 1
            self._flawed = True
        done = self._done
        said = done and self._next + len(self._ahead) + self._damaged >= done.frames
        if done and said and not self.over:
            self._finish(done, step)
        return step

    def _begin_round(self) -> None:
        self._round += 1
        self._next = self._damaged = 0
        self._ahead.clear()
        self._done = None
        self._flawed = False

    def _opening(self, knowledge: Since | Have | Digest) -> list[bytes]:
        known = self._peer_state
        opening = sync_messages.Open(
            known.boot_id,
            self._budget,
            knowledge,
            self._requests(),
            known.config_hash,
            known.address_token,
        )
        return sync.message_frames(sync.OPEN, self._round, opening.encode(), self._room)

    def _knowledge(self) -> Since | Have | Digest:
        known = self._database.knowledge(self.peer)
        if known is None:
            return self._all()
        stored = self._database.since(known.own_sequence)
        if len(stored) > MAX_LISTED:
            stored.sort(key=lambda record: len(record.body), reverse=True)
            if sum(len(record.body) for record in stored[MAX_LISTED:]) > SPARE_BYTES:
                return self._all()
        message_ids = [record_id(record) for record in stored[:MAX_LISTED]]
        return Since(known.epoch, known.sequence, message_ids)

    def _all(self) -> Have | Digest:
        kept = self._database.kept()
        if len(kept) <= MAX_LISTED:
            return Have([record_id(record) for record in kept])
        return Digest(self._database.digests())

    def _requests(self) -> list[FragmentRequest]:
        requests: list[FragmentRequest] = []
        for message_id, fragment in list(self._reassembly):
            if not self._wants(message_id):
                self._reassembly.drop(message_id)
            elif len(requests) < sync_messages.MAX_FRAGMENTS:
                requests.append(FragmentRequest(message_id, fragment.total, fragment.missing()))
        return requests

    def _wants(self, message_id: int) -> bool:
        return self._database.wants_stamp(
            message_id >> 56, message_id >> 48 & 0xFF, message_id & payload.STAMP_MASK, self._now_s
        )

    def _on_message(self, frame: sync.Frame, step: Step) -> None:
        message = self._assembler.take(frame)
        if message is None or message.round != self._round:
            return
        if message.kind == sync.HELLO:
            self._hello(sync_messages.Hello.decode(message.content), step)
        elif message.kind == sync.GROUPS:
            groups = sync_messages.decode_groups(message.content)
            answers = [self._answer(*each) for each in groups.items()]
            content = sync_messages.encode_answers(answers)
            step.frames += sync.message_frames(sync.ANSWER, self._round, content, self._room)
        else:
            self._done = sync_messages.Done.decode(message.content)

    def _hello(self, hello: sync_messages.Hello, step: Step) -> None:
        self._peer_state.address_token = hello.address_token or self._peer_state.address_token
        if hello.version != sync_messages.VERSION:
            self.rejection = (
                f"{self.peer} speaks version {hello.version} of the sync, "
                f"we {sync_messages.VERSION}; install the same release on both"
            )
        elif hello.reception is Reception.UNREADABLE:
            self.rejection = f"{self.peer} could not read how we began; damaged on its way"
        elif not self._peer_state.agrees(hello.config_hash):
            self.rejection = difference(self.peer)
        elif hello.reception is Reception.UNKNOWN and self._round + 1 < sync.ROUNDS:
            self._begin_round()
            step.frames += self._opening(self._all())

    def _answer(self, robot_id: int, digests: tuple[int, ...]) -> sync_messages.Answer:
        groups = 0
        message_ids = []
        for group, ours in enumerate(self._database.group_digests(robot_id)):
            if ours != digests[group]:
                groups |= 1 << group
                message_ids += [record_id(r) for r in self._database.headers_in(robot_id, group)]
        return sync_messages.Answer(robot_id, groups, message_ids)

    def _chunks(self, chunks: sync.Chunks, now: Instant, step: Step) -> None:
        if chunks.round == self._round and not self._count(chunks.number):
            return
        contents = chunks.contents()
        for message_id, _ in chunks.wholes:
            self._message(message_id, sync.own(next(contents)), now, step)
        for piece in chunks.pieces:
            self._piece(piece, next(contents), now, step)

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

    def _piece(
        self, piece: tuple[int, int, int, int], data: memoryview, now: Instant, step: Step
    ) -> None:
        message_id, total, offset, size = piece
        if self._topic(message_id) is None:
            _refuse(step, _unknown(message_id))
            return
        if not self._wants(message_id):  # another peer has brought it, or a newer one
            self._begun.discard(message_id)
            more = total - offset - size > _SKIP_BYTES and len(self._skipped) < _MAX_BEGUN
            if more and message_id not in self._skipped:
                self._skipped.add(message_id)
                content = sync_messages.encode_skip(message_id)
                step.frames += sync.message_frames(sync.SKIP, self._round, content, self._room)
            return
        if message_id not in self._begun and len(self._begun) >= _MAX_BEGUN:
            raise SyncFrameError("parts of too many messages")
        body = self._reassembly.add(message_id, total, offset, data)
        if body is None:
            self._begun.add(message_id)
        else:
            self._begun.discard(message_id)
            self._message(message_id, body, now, step)

    def _message(self, message_id: int, body: sync.Frame, now: Instant, step: Step) -> None:
        self._judge(message_id, body, now, step)
        self._reassembly.drop(message_id)

    def _judge(self, message_id: int, body: sync.Frame, now: Instant, step: Step) -> None:
        known = self._topic(message_id)
        if known is None:
            _refuse(step, _unknown(message_id))
            return
        robot, topic = known
        stamp_ms = message_id & payload.STAMP_MASK
        try:
            trailer = _proven(body, robot, topic, stamp_ms)
        except PayloadError as error:  # damaged on its way, perhaps
            _refuse(step, f"message {message_id:016x}: {error}")
            self._hopeless |= message_id in self._failed or len(self._failed) >= _MAX_FAILED
            self._failed.add(message_id)
            self._flawed = True
            return
        header = Header.at(robot.robot_id, topic.topic_id, stamp_ms)
        self._peer_state.holds(message_id)
        try:
            payload.check_type(body, topic)
            if self._verify:
                self._verify(header, body, trailer)
        except PayloadError as error:  # intact, so it will not be another one next time
            _refuse(step, f"message {message_id:016x}: {error}")
            return
        record = Record(header, topic.priority, body, stamp_ms, now.unix_s, trailer is None)
        if self._database.insert(record, now.unix_s):
            self.messages += 1
            step.events.append(
                MessageStored(self.peer, now.unix_s, robot.name, topic.name, header, len(body))
            )

    def _topic(self, message_id: int) -> tuple[Robot, Topic] | None:
        """Whose message it is and of what; None if it must not be taken."""
        key, stamp_ms = message_id >> 48, message_id & payload.STAMP_MASK
        try:
            known = self._topics[key]
        except KeyError:
            known = self._topics[key] = self._team.by_ids(key >> 8, key & 0xFF)
        if stamp_ms >= TAKEN_MS or stamp_ms % WRAP_MS <= UNSAFE_MS:
            return None
        return known

    def _finish(self, done: sync_messages.Done, step: Step) -> None:
        missing = [message_id for message_id in self._begun if self._wants(message_id)]
        flawed = self._flawed or bool(missing)
        final = self._repairs == _REPAIRS or self._round + 1 == sync.ROUNDS
        if flawed and not (done.cut_short or self._hopeless or final):
            self._repairs += 1
            self._begin_round()
            step.frames += self._opening(self._knowledge())
            return
        self.over = True
        self.complete = not (flawed or done.cut_short)
        if self.complete:
            self._learn(done)
        self.follows = self._follow and self.complete
        last = sync.FOLLOW if self.follows else sync.END
        step.frames += sync.message_frames(last, self._round, b"", self._room)

    def _learn(self, done: sync_messages.Done) -> None:
        knowledge = Knowledge(done.epoch, done.sequence, self._database.sequence)
        if knowledge != self._database.knowledge(self.peer):
            self._database.learn(self.peer, knowledge)


def _refuse(step: Step, reason: str) -> None:
    if len(step.refusals) < _MAX_REFUSALS:
        step.refusals.append(reason)


def _unknown(message_id: int) -> str:
    return f"message {message_id:016x}: no such robot or topic in the team, or an impossible time"


def _proven(body: sync.Frame, robot: Robot, topic: Topic, stamp_ms: int) -> Trailer | None:
    """The trailer of a body that is as its maker made it, as far as can be told."""
    trailer = payload.check(body, payload.Ids(robot.robot_id, topic.topic_id))
    if trailer is None:
        payload.check_type(body, topic)
    elif trailer.stamp_ms != stamp_ms:
        raise PayloadError(f"of time {trailer.stamp_ms} ms, said to be of {stamp_ms} ms")
    return trailer
