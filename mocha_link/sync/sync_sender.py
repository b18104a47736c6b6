"""The serving side of a sync between new nodes: makes the frames for one pull of one peer.

No sockets here; `ServedPull` chooses the path of the frames.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet

from mocha_link.sync import frames as sync
from mocha_link.sync import sync_messages
from mocha_link.sync.frames import GROUPS, MESSAGE_HEADER_BYTES, TOPICS, message_frame
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import Frame
from mocha_link.sync.send_queue import SendQueue
from mocha_link.sync.send_round import Follower, SendRound
from mocha_link.sync.send_states import ALL_SENT, ENDED, SendEvent, SendState, next_state
from mocha_link.sync.sync_messages import DONE_BYTES, Hello, Reception, VersionError

_DONE_BYTES = MESSAGE_HEADER_BYTES + DONE_BYTES
_FREE = (GROUPS, TOPICS)  # not counted, so that they leave room for messages
MIN_ROOM = 300


class SendBudget:
    """The peer's limit on the frames of one pull, and the bytes sent so far.

    Attributes:
        sent_bytes: bytes of all frames.
    """

    def __init__(self) -> None:
        self.sent_bytes = 0
        self._limit_bytes = 0  # from the peer's last OPEN; 0: no limit
        self._free_bytes = 0  # sent bytes that are not counted

    def renew(self, limit_bytes: int) -> None:
        """Set the limit from an OPEN of the peer."""
        self._limit_bytes = limit_bytes

    def spend(self, size: int, kind: int | None = None) -> None:
        """Count a sent frame; `kind`: of its sync message; None: it is a frame of chunks."""
        self.sent_bytes += size
        if kind in _FREE:
            self._free_bytes += size

    def room(self, room: int) -> int:
        """The size that a frame of chunks may have within `room` bytes; DONE must fit after it."""
        if not self._limit_bytes:
            return room
        return min(room, self._limit_bytes + self._free_bytes - self.sent_bytes - _DONE_BYTES)


class MessageOutbox:
    """Queued sync messages, sent in order and in parts that fit the frames."""

    def __init__(self) -> None:
        self._messages: list[tuple[int, bytes]] = []  # kind, content
        self._offset = 0  # of the next part in the first message

    def __bool__(self) -> bool:
        return bool(self._messages)

    def put(self, kind: int, content: bytes) -> None:
        """Queue a message."""
        self._messages.append((kind, content))

    def clear(self) -> None:
        """Drop all messages: another round begins."""
        self._messages.clear()
        self._offset = 0

    def fits(self, room: int) -> bool:
        """Whether a message is queued, and the whole of it fits in `room` bytes."""
        return bool(self) and MESSAGE_HEADER_BYTES + len(self._messages[0][1]) <= room

    def next_frame(self, round_: int, room: int) -> tuple[int, bytes]:
        """The next part of the first message in a frame of at most `room` bytes, with its kind."""
        kind, content = self._messages[0]
        frame = message_frame(kind, round_, content, self._offset, room)
        self._offset += len(frame) - MESSAGE_HEADER_BYTES
        if self._offset >= len(content):
            del self._messages[0]
            self._offset = 0
        return kind, frame


class SyncSender:
    """Sends one peer the messages that it lacks, the most urgent first, in frames of any size.

    It reads the database before every frame, so that messages stored meanwhile are also sent.
    `SendRound` selects the messages that the peer lacks, `SendQueue` orders them. Make one per
    pull.

    Attributes:
        state: the state of the pull; see `STATES` in send_states.py.
        admitted: the peer has returned a valid address token of ours.
    """

    def __init__(self, peer: Peer) -> None:
        self.state = SendState.OPENING
        self.admitted = False
        self._peer = peer
        self._assembler = sync.MessageAssembler(
            sync.OPEN, sync.ANSWER, sync.SKIP, sync.END, sync.FOLLOW, sync.TOPICS
        )
        self._queue = SendQueue(peer)  # of the current round
        self._round = SendRound(peer, self._queue)
        self._outbox = MessageOutbox()
        self._budget = SendBudget()
        self._follower = Follower(peer)

    @property
    def messages(self) -> int:
        """The number of messages that were completely sent."""
        return self._queue.messages

    @property
    def sent_bytes(self) -> int:
        """The bytes of all frames."""
        return self._budget.sent_bytes

    @property
    def ended(self) -> bool:
        """Whether the pull has ended; if the peer follows, new messages are pushed to it."""
        return self.state in ENDED

    @property
    def all_sent(self) -> bool:
        """Whether all messages were sent, or as many as the peer's budget allows."""
        return self.state in ALL_SENT

    # --- frames of the peer

    def open(self, frame: bytes) -> bool:
        """Process the first frame; False if it does not begin a sync."""
        return frame[:1] == bytes((sync.OPEN,)) and self.take(frame)

    def take(self, frame: Frame) -> bool:
        """Process a frame of the peer; False if it is not a frame of a sync."""
        try:
            self.receive(frame)
        except sync.SyncFrameError:
            return False
        return True

    def receive(self, frame: Frame) -> None:
        """Process a frame of the peer. Raises SyncFrameError."""
        message = self._assembler.take(frame)
        if message is None or self.state is SendState.OVER:
            return
        if message.kind == sync.OPEN:
            self._receive_opening(message)
        elif message.kind == sync.TOPICS:
            self._peer.agreement.receive_topics(*sync_messages.decode_topics(message.content))
        elif message.kind == sync.END:
            self._happens(SendEvent.END)
            self._peer.holdings.end_begun()
        elif message.kind == sync.FOLLOW:
            self._happens(SendEvent.FOLLOW)
            self._follower.follow(message.content)
            self._peer.holdings.end_begun()
        elif message.round != self._round.number:
            return  # of an earlier round: the current one may need the message
        elif message.kind == sync.SKIP:
            self._queue.skip(sync_messages.decode_skip(message.content))
        else:
            self._round.answer(sync_messages.decode_answers(message.content))

    def end(self) -> None:
        """Send nothing more: the peer is silent, or has begun a new pull."""
        self._happens(SendEvent.END)

    def _happens(self, event: SendEvent) -> None:
        self.state = next_state(self.state, event)

    # --- frames to send

    def fits(self, room: int) -> bool:
        """Whether `next` may return a frame for that many bytes."""
        return room >= MIN_ROOM or self._outbox.fits(room)

    def request_pull(self) -> None:
        """Request that a peer that follows pulls again."""
        self._outbox.put(sync.ANNOUNCE, sync_messages.encode_announce(()))

    def wants_push(self, robot_ids: AbstractSet[int]) -> bool:
        """Whether new messages of these robots concern the peer."""
        return not self.ended or self._follower.wants(robot_ids)

    def next(self, room: int) -> bytes | None:
        """The next frame of at most `room` bytes (MIN_ROOM or more); None: nothing to send now."""
        parts = self.next_parts(room)
        return None if parts is None else b"".join(parts)

    def next_parts(self, room: int, prefix: bytes = b"") -> list[Frame] | None:
        """The next frame after a `prefix`, with large data as parts of their own."""
        room -= len(prefix)
        if self.state in (SendState.OPENING, SendState.OVER):
            return None
        serves = self.state not in (SendState.DONE, SendState.CUT_SHORT)
        if serves and not self._outbox:
            self._refill()
        if self._outbox:
            return [prefix + self._message_part(room)]
        if not serves:
            return None
        parts = self._round.fill(self._budget.room(room), prefix)
        if parts is not None:
            self._budget.spend(sum(map(len, parts)) - len(prefix))
            return parts
        if self.state is not SendState.SENDING or self._round.awaits_answer:
            return None
        done = self._round.end()
        self._happens(SendEvent.BUDGET_SPENT if done.cut_short else SendEvent.ALL_SENT)
        self._outbox.put(sync.DONE, done.encode())
        return [prefix + self._message_part(room)]

    def _receive_opening(self, message: sync.SyncMessage) -> None:
        peer, node = self._peer, self._peer.node
        try:
            opening = sync_messages.Open.decode(message.content)
        except VersionError:
            self._begin_round(message.round, SendEvent.UNREADABLE)
            self._send_hello(Reception.UNREADABLE)
            return
        self.admitted = peer.tokens.verify(opening.address_token)
        self._budget.renew(opening.budget)
        agrees = peer.agreement.compare(opening.config_hash)
        peer.opened(opening.boot_id)
        if not agrees or (
            peer.agreement.config_mismatch and opening.known_hash != node.config_hash
        ):
            self._begin_round(message.round, SendEvent.UNKNOWN)
            self._send_hello(Reception.TOPICS_WANTED)
            topics = sync_messages.encode_topics(node.config_hash, node.definitions)
            self._outbox.put(sync.TOPICS, topics)
            return
        self._begin_round(message.round, SendEvent.OPEN)
        groups = self._round.open(opening)
        if groups is None:
            self._happens(SendEvent.UNKNOWN)
            self._send_hello(Reception.UNKNOWN)
            return
        self._send_hello(Reception.WELCOME)
        if groups:
            self._outbox.put(sync.GROUPS, sync_messages.encode_groups(groups))

    def _begin_round(self, number: int, event: SendEvent) -> None:
        """Begin a round."""
        self._happens(event)
        self._outbox.clear()
        self._queue.clear()
        self._round = SendRound(self._peer, self._queue, number)

    def _send_hello(self, reception: Reception) -> None:
        peer = self._peer
        hello = Hello(
            reception,
            peer.node.config_hash,
            address_token=peer.tokens.next,
            boot_id=peer.node.boot_id,
            duplicate=peer.process.duplicate,
        )
        self._outbox.put(sync.HELLO, hello.encode())

    def _refill(self) -> None:
        """Add newly stored messages to the round; announce those that are not pushed."""
        follower = self._follower if self.state is SendState.FOLLOWED else None
        announced = self._round.refill(follower)
        if announced:
            self._outbox.put(sync.ANNOUNCE, sync_messages.encode_announce(announced))

    def _message_part(self, room: int) -> bytes:
        """The next part of the first queued sync message."""
        kind, frame = self._outbox.next_frame(self._round.number, room)
        self._budget.spend(len(frame), kind)
        return frame
