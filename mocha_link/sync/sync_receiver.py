"""The pulling side of a sync between new nodes: one pull from one peer. No sockets here."""

from __future__ import annotations

from collections.abc import Sequence

from mocha_link.clock import Instant
from mocha_link.store import Knowledge
from mocha_link.sync import frames as sync
from mocha_link.sync import sync_messages
from mocha_link.sync.frames import SyncFrameError, read_chunks
from mocha_link.sync.holdings import Holdings
from mocha_link.sync.intake import MAX_RECEIVED_IDS, Intake
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import Frame
from mocha_link.sync.sync_messages import Digest, Done, Have, Reception, Since

_MAX_AHEAD = 65_536
ROOM = 65_536
_REPAIRS = 2  # rounds that only request damaged messages again


class Arrivals:
    """The received frames of one round, in any order, and the DONE with their number.

    Attributes:
        round: the number of the round.
    """

    def __init__(self, round_: int) -> None:
        self.round = round_
        self._next = 0  # all frames below this number were received, and those in `_ahead`
        self._ahead: set[int] = set()  # received numbers above `_next`
        self._damaged = 0  # received frames whose number is not known
        self._done: Done | None = None

    def count(self, number: int) -> bool:
        """Note a received frame; returns whether it is no duplicate. Raises SyncFrameError."""
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

    def count_damaged(self) -> None:
        """Count a damaged frame of chunks, of which no number was counted."""
        self._damaged += 1

    def end(self, done: Done) -> None:
        """Note the peer's DONE."""
        self._done = done

    @property
    def done(self) -> Done | None:
        """The peer's DONE, once all frames of the round were received."""
        done = self._done
        arrived = self._next + len(self._ahead) + self._damaged
        return done if done and arrived >= done.frames else None


class SyncReceiver:
    """Stores the messages of one pull from one peer. Make one per pull.

    With `follow` in the node's context it continues to receive messages after a complete pull: the
    peer pushes what it stores, until the next pull.

    Args:
        peer: the peer that sends; records refusals and events.
        budget: bytes of frames that the peer may send; 0: no limit.
        room: the largest frame that we may send.
        remembered: messages of the peer that are not reported back to it; see `Intake`.

    Attributes:
        over: the pull has ended.
        follows: the pull has ended, and the peer pushes new messages.
        complete: every message that the peer had was received.
        pull_needed: the peer has stored messages since that it does not push.
        rejection: why the versions or data are incompatible; later frames are ignored.
        bytes: bytes of the received frames.
    """

    def __init__(
        self, peer: Peer, *, budget: int = 0, room: int = ROOM, remembered: int = MAX_RECEIVED_IDS
    ) -> None:
        self.over = False
        self.follows = False
        self.complete = False
        self.pull_needed = False
        self.rejection: str | None = None
        self.bytes = 0
        self._peer = peer
        self._holdings = Holdings(peer)
        self._intake = Intake(peer, self._holdings, remembered=remembered)
        self._budget = budget
        self._room = room
        self._assembler = sync.MessageAssembler(
            sync.HELLO, sync.GROUPS, sync.DONE, sync.ANNOUNCE, sync.TOPICS
        )
        self._arrivals = Arrivals(0)  # of the current round; each OPEN of ours begins one
        self._repairs = 0  # repair rounds so far
        self._unclear: int | None = None  # the peer's configuration hash, until TOPICS is received

    @property
    def messages(self) -> int:
        """The number of stored messages."""
        return self._intake.messages

    def open(self, now: Instant) -> list[bytes]:
        """Begin the pull; returns the frames of the opening."""
        return self._opening(self._holdings.knowledge(now), now)

    def receive(self, frame: Frame, now: Instant, more: Sequence[Frame] = ()) -> list[bytes]:
        """Process a frame of the peer; `more`: its further parts. Returns the replies.

        An invalid frame is refused.
        """
        if (self.over and not self.follows) or self.rejection:
            return []
        self.bytes += len(frame) + sum(map(len, more))
        self._intake.begin_frame(now)
        replies: list[bytes] = []
        try:
            if not more and self._assembler.receives(frame):  # has one part only
                replies = self._on_message(frame, now)
            else:
                self._take_chunks(frame, more)
        except SyncFrameError as error:
            self._intake.refuse_frame(error)
        for message_id in self._intake.take_skips():
            replies += self._frames(sync.SKIP, sync_messages.encode_skip(message_id))
        done = self._arrivals.done
        if done and not self.over:
            replies += self._finish(done, now)
        return replies

    def _take_chunks(self, frame: Frame, more: Sequence[Frame]) -> None:
        """Process a frame of chunks, or one whose kind is damaged. Raises SyncFrameError."""
        try:
            chunks = read_chunks(frame, more)
            is_new = chunks.round != self._arrivals.round or self._arrivals.count(chunks.number)
        except SyncFrameError:
            self._arrivals.count_damaged()  # DONE counts it
            raise
        if is_new:
            self._intake.take(chunks)

    # --- rounds

    @property
    def _is_last_round(self) -> bool:
        return self._arrivals.round + 1 == sync.ROUNDS

    def _begin_round(self, knowledge: Since | Have | Digest, now: Instant) -> list[bytes]:
        self._arrivals = Arrivals(self._arrivals.round + 1)
        self._intake.begin_round()
        return self._opening(knowledge, now)

    def _opening(self, knowledge: Since | Have | Digest, now: Instant) -> list[bytes]:
        node = self._peer.node
        opening = sync_messages.Open(
            node.boot_id,
            self._budget,
            knowledge,
            self._holdings.requests(now.unix_s),
            node.config_hash,
            self._peer.tokens.received,
            self._peer.agreement.known_hash,
        )
        return self._frames(sync.OPEN, opening.encode())

    def _frames(self, kind: int, content: bytes) -> list[bytes]:
        return sync.message_frames(kind, self._arrivals.round, content, self._room)

    # --- sync messages

    def _on_message(self, frame: Frame, now: Instant) -> list[bytes]:
        """The replies to a frame of a sync message. Raises SyncFrameError."""
        message = self._assembler.take(frame)
        if message is None or message.round != self._arrivals.round:
            return []
        match message.kind:
            case sync.HELLO:
                return self._on_hello(sync_messages.Hello.decode(message.content), now)
            case sync.TOPICS:
                topics = sync_messages.decode_topics(message.content)
                self._peer.agreement.receive_topics(*topics)
                return self._compare_topics(now)
            case sync.GROUPS:
                groups = sync_messages.decode_groups(message.content)
                held = [self._holdings.differing_groups(*each) for each in groups.items()]
                return self._frames(sync.ANSWER, sync_messages.encode_answers(held))
            case sync.ANNOUNCE:
                announced = sync_messages.decode_announce(message.content)
                wanted = self._intake.wanted(announced)
                self.pull_needed |= not announced or bool(wanted)
                self._peer.offers.announce(wanted)
            case _:
                self._arrivals.end(sync_messages.Done.decode(message.content))
        return []

    def _on_hello(self, hello: sync_messages.Hello, now: Instant) -> list[bytes]:
        peer = self._peer
        peer.tokens.receive(hello.address_token)
        peer.process.report_duplicated(duplicated=hello.duplicate)
        if hello.version != sync_messages.VERSION:
            self.rejection = (
                f"{peer.name} uses version {hello.version} of the sync, "
                f"we {sync_messages.VERSION}; install the same release on both"
            )
        elif hello.reception is Reception.UNREADABLE:
            self.rejection = f"{peer.name} could not decode our OPEN; it was damaged"
        elif (
            not peer.agreement.compare(hello.config_hash)
            or hello.reception is Reception.TOPICS_WANTED
        ):
            self._unclear = hello.config_hash
            return self._compare_topics(now)
        elif hello.reception is Reception.UNKNOWN and not self._is_last_round:
            return self._begin_round(self._holdings.all(), now)
        return []

    def _compare_topics(self, now: Instant) -> list[bytes]:
        """Once the peer's definitions are known, send ours and begin another round."""
        peer, node = self._peer, self._peer.node
        if self._unclear is None or not peer.agreement.compare(self._unclear):
            return []
        self._unclear = None
        if self._is_last_round:
            return []
        topics = sync_messages.encode_topics(node.config_hash, node.definitions)
        replies = self._frames(sync.TOPICS, topics)
        return replies + self._begin_round(self._holdings.knowledge(now), now)

    # --- the end

    def _finish(self, done: sync_messages.Done, now: Instant) -> list[bytes]:
        """After all frames of a round: request missing messages again, or end the pull."""
        peer, node, intake = self._peer, self._peer.node, self._intake
        left = set(intake.still_new(self._holdings.left))
        flawed = intake.flawed or bool(intake.missing(left))
        final = self._repairs == _REPAIRS or self._is_last_round
        if flawed and not (done.cut_short or intake.hopeless or final):
            self._repairs += 1
            return self._begin_round(self._holdings.knowledge(now), now)
        self.over = True
        intake.end()
        peer.offers.still_left(left)
        is_sound = not (flawed or done.cut_short)
        self.complete = is_sound and not left
        if self.complete and not peer.agreement.config_mismatch:  # with one not all was offered
            own_sequence = self._holdings.unannounced_since(intake.received_ids)
            knowledge = Knowledge(done.epoch, done.sequence, own_sequence)
            if knowledge != node.database.knowledge(peer.name):
                node.database.learn(peer.name, knowledge)
        self.follows = node.follow and is_sound
        if self.follows:
            return self._frames(sync.FOLLOW, bytes(sorted(node.followed)))
        return self._frames(sync.END, b"")
