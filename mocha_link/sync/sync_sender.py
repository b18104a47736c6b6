"""The serving side of a sync between new nodes: one pull of one peer, and on which way it goes.

No sockets here.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from collections.abc import Set as AbstractSet
from operator import attrgetter

from mocha_link.clock import Instant
from mocha_link.store import GROUPS, Record
from mocha_link.sync import frames as sync
from mocha_link.sync import sync_messages
from mocha_link.sync.credit import GRANT, MAX_CHUNK, MIN_CHUNK
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import ID_BYTES, Frame, Route
from mocha_link.sync.send_queue import SendQueue
from mocha_link.sync.sync_messages import Digest, Have, Hello, Reception, Since, VersionError

MIN_ROOM = 300
_DONE_BYTES = sync.MESSAGE_HEADER_BYTES + sync_messages.DONE_BYTES
SLICE = 2_000  # messages that are put in their order at once: some milliseconds
PUSH_BYTES = 65_536  # a larger message waits for the next pull, which may take its time


class SyncSender:
    """Sends one peer the messages that it lacks, the most urgent first, in frames of any size.

    Reads the database before every frame, so that messages stored meanwhile are sent too.
    `SendQueue` has the order. Make one per pull.

    A peer that follows receives new messages at once: small messages of the robots in
    `Peer.pushed`, best effort. Other messages are announced, unless the peer follows their
    publisher; its next pull brings them.

    Attributes:
        id: what its frames begin with on a connection, the id of the request.
        began_s: when the pull began, steady clock.
        received_s: when the newest frame of the peer came, steady clock.
        route: the peer's connection, if it has one.
        routed_s: when the pull came to that, steady clock.
        sent: bytes on that connection.
        by_datagram: frames come, and go, by datagrams.
        all_cast: everything that was given out went by datagrams.
        reclaimed: what datagrams may have lost goes over the connection.
        over: the peer has sent END.
        follows: all was given out, and the peer waits for more.
        ended: the end of the pull was reported; if the peer follows, new messages are sent at once.
        done: all has been given out, or all that the peer's budget allows.
        cut_short: not all, because the budget was used up.
        rejection: why the peer gets nothing, once it has opened.
        admitted: the peer has shown an address token of ours.
        bytes: of all frames.
    """

    def __init__(self, peer: Peer, request_id: bytes = b"", began_s: float = 0.0) -> None:
        self.id = request_id
        self.began_s = self.received_s = began_s
        self.route: Route | None = None
        self.routed_s = 0.0
        self.sent = 0
        self.by_datagram = False
        self.all_cast = False
        self.reclaimed = False
        self.over = False
        self.follows = False
        self.ended = False
        self.done = False
        self.cut_short = False
        self.rejection: Reception | None = None
        self.admitted = False
        self.bytes = 0
        self._peer = peer
        self._database = peer.node.database
        self._assembler = sync.MessageAssembler(
            sync.OPEN, sync.ANSWER, sync.SKIP, sync.END, sync.FOLLOW, sync.TOPICS
        )
        self._round = -1  # -1: the peer has not opened
        self._outbox: list[tuple[int, bytes, int]] = []  # kind, content, offset of what is left
        self._budget = 0  # bytes of the peer; 0: no limit
        self._free = 0  # bytes of group digests: they must not leave too little for any message
        self._unknown = False  # the sequence that the peer knows is not ours
        self._requested_groups: frozenset[int] = frozenset()  # robots whose groups were requested
        self._followed: frozenset[int] = frozenset()  # robots whose messages it gets from them
        self._queue = SendQueue(peer)  # of this round
        self._backlog: list[Record] = []  # that goes into it later, the most urgent last
        self._sequence = self._opened_at = 0  # what is stored later is new
        self._again: deque[bytes] = deque()  # frames that datagrams may not have brought
        self._allowed = 0  # bytes granted on the connection
        self._chunk = MIN_CHUNK  # bytes of a reply there

    @property
    def messages(self) -> int:
        """How many were given out to the end."""
        return self._queue.messages

    # --- frames of the peer

    def open(self, frame: bytes) -> bool:
        """Take in the first frame; False if it is none that begins a sync."""
        return frame[:1] == bytes((sync.OPEN,)) and self.take(frame)

    def take(self, frame: bytes) -> bool:
        """Take in a frame of the peer; False if it is none of a sync."""
        try:
            self.receive(frame)
        except sync.SyncFrameError:
            return False
        return True

    def grant(self, raw: bytes) -> None:
        """Take in what may be sent on the connection."""
        if len(raw) == GRANT.size:
            allowed, chunk = GRANT.unpack(raw)
            self._allowed = max(self._allowed, allowed)
            self._chunk = min(max(chunk, MIN_CHUNK), MAX_CHUNK)

    def receive(self, frame: Frame) -> None:
        """Take in a frame of the peer. Raises SyncFrameError."""
        message = self._assembler.take(frame)
        if message is None or self.over:
            return
        if message.kind == sync.OPEN:
            self._receive_opening(message)
        elif message.kind == sync.TOPICS:
            topics = sync_messages.decode_topics(message.content)
            self._peer.agreement.receive_topics(*topics)
        elif message.kind == sync.END:
            self.over = True
            self._peer.holdings.end_begun()
        elif message.kind == sync.FOLLOW:
            self.follows = self.done and not self.cut_short
            self.over = not self.follows
            self._followed = frozenset(message.content)
            self._peer.holdings.end_begun()
        elif message.kind == sync.SKIP and message.round == self._round:  # a later one wants it
            self._queue.skip(sync_messages.decode_skip(message.content))
        elif message.round == self._round:
            self._receive_held(sync_messages.decode_answers(message.content))

    # --- the way to it

    def carry_on(self, route: Route, now: Instant) -> None:
        """What is sent from now on goes over this connection, on which nothing was sent."""
        self.route, self.sent, self.routed_s = route, 0, now.steady_s

    def leave_datagrams(self, lost: Iterable[bytes]) -> None:
        """Go on over the connection alone, and send there again what datagrams may have lost."""
        self.by_datagram = False
        self.reclaimed = True
        self.all_cast = self.done
        self._again.extend(lost)

    # --- frames to send

    def supply(self) -> list[Frame] | None:
        """The next frame for the connection, in parts; None: nothing now, or no credit for it."""
        parts: list[Frame] | None
        if self._again:
            parts = [self.id + self._again.popleft()]
        else:
            room = self._allowed - self.sent
            if room <= 0:
                return None
            room = min(self._chunk, max(room, MIN_ROOM + ID_BYTES))
            parts = self._next_parts(room, self.id)
        self.sent += sum(map(len, parts or ()))
        return parts

    def next_for_datagram(self, room: int) -> bytes | None:
        """The next frame for a datagram of that many bytes; None: nothing now, or not this way."""
        head = sync.MESSAGE_HEADER_BYTES
        brief = bool(self._outbox) and head + len(self._outbox[0][1]) <= room
        return self.next(room) if self.by_datagram and (room >= MIN_ROOM or brief) else None

    def request_pull(self) -> None:
        """Request that the following peer pulls, whatever it holds."""
        self._outbox.append((sync.NEWS, sync_messages.encode_news(()), 0))

    def wants_push(self, robot_ids: AbstractSet[int]) -> bool:
        """Whether new messages of these robots concern the peer."""
        theirs = robot_ids <= self._followed and robot_ids.isdisjoint(self._peer.pushed)
        return not (self.follows and theirs)

    def next(self, room: int) -> bytes | None:
        """The next frame, of at most `room` bytes (at least MIN_ROOM); None.

        Nothing to send now.
        """
        parts = self._next_parts(room)
        return None if parts is None else b"".join(parts)

    def _next_parts(self, room: int, prefix: bytes = b"") -> list[Frame] | None:
        """The same with `prefix` before it, and large data as parts of their own."""
        room -= len(prefix)
        if self.over or self._round < 0:
            return None
        idle = self.done and not self.follows
        if not self._outbox and not idle:
            self._refill()
        if self._outbox:
            return [prefix + self._message_part(room)]
        if idle:
            return None
        left = room
        if self._budget:
            left = min(room, self._budget + self._free - self.bytes - _DONE_BYTES)
        stored_since = self._sequence != self._opened_at
        parts = None
        if self._queue:
            parts = self._queue.fill(left, self._round, prefix, may_be_replaced=stored_since)
        if parts is not None:
            self.bytes += sum(map(len, parts)) - len(prefix)
            return parts
        if self.follows or (not self._queue and (self._unknown or self._requested_groups)):
            return None
        self._end()
        return [prefix + self._message_part(room)]

    def _receive_opening(self, message: sync.SyncMessage) -> None:
        try:
            opening = sync_messages.Open.decode(message.content)
        except VersionError:
            self._reject(message.round, Reception.UNREADABLE)
            return
        self.admitted = self._peer.tokens.verify(opening.address_token)
        node = self._peer.node
        agrees = self._peer.agreement.compare(opening.config_hash)
        if agrees and (
            not self._peer.agreement.config_mismatch or opening.known_hash == node.config_hash
        ):
            self._open(message.round, opening)
            return
        self._peer.opened(opening.boot_id)
        self._restart(message.round, opening.budget)
        self._unknown = True
        topics = sync_messages.encode_topics(node.config_hash, node.definitions)
        self._outbox += [
            (sync.HELLO, self._hello(Reception.TOPICS_WANTED), 0),
            (sync.TOPICS, topics, 0),
        ]

    def _reject(self, round_: int, why: Reception) -> None:
        """Send the rejection, and ignore all further frames."""
        self._round = round_
        self.rejection = why
        self._queue.clear()
        self._backlog.clear()
        self._requested_groups = frozenset()
        self._unknown = True
        self._outbox = [(sync.HELLO, self._hello(why), 0)]

    def _restart(self, round_: int, budget: int) -> None:
        """A round begins, of which nothing is known yet."""
        self._round = round_
        self.rejection = None
        self._budget = budget
        self._queue.clear()
        self._backlog.clear()
        self.done = self.cut_short = self._unknown = False
        self._requested_groups = frozenset()
        self._outbox.clear()

    def _open(self, round_: int, opening: sync_messages.Open) -> None:
        self._restart(round_, opening.budget)
        self._peer.opened(opening.boot_id)
        self._sequence = self._opened_at = self._database.sequence  # before the database is read
        groups: list[tuple[int, tuple[int, ...]]] = []
        new: Iterable[Record] = ()
        match opening.knowledge:
            case Since(epoch, sequence, message_ids):
                self._peer.holdings.add(*message_ids)
                if self._database.remembers(epoch, sequence):
                    new = self._database.since(sequence)
                else:
                    self._unknown = True
            case Have(message_ids):
                self._peer.holdings.forget()
                self._peer.holdings.add(*message_ids)
                new = self._database.kept()
            case Digest(digests):
                self._peer.holdings.forget()
                new, groups = self._compare(digests)
        reception = Reception.UNKNOWN if self._unknown else Reception.WELCOME
        self._outbox.append((sync.HELLO, self._hello(reception), 0))
        if groups:
            self._requested_groups = frozenset(robot_id for robot_id, _ in groups)
            self._outbox.append((sync.GROUPS, sync_messages.encode_groups(groups), 0))
        if not self._unknown:
            self._queue.resume(opening.requests)
            self._enqueue(new)
            self._queue.put_one_first()

    def _hello(self, reception: Reception) -> bytes:
        peer = self._peer
        return Hello(
            reception,
            peer.node.config_hash,
            address_token=peer.tokens.next,
            boot_id=peer.node.boot_id,
            duplicate=peer.process.duplicate,
        ).encode()

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

    def _receive_held(self, held: Sequence[sync_messages.HeldGroups]) -> None:
        if not self._requested_groups:
            return
        self._peer.holdings.add(*(message_id for each in held for message_id in each.message_ids))
        differing = dict.fromkeys(
            self._requested_groups, 0
        )  # groups, a bit each; none is read twice
        for robot_id, groups, _ in held:
            if robot_id in differing:
                differing[robot_id] |= groups
        self._enqueue(
            record
            for robot_id, groups in differing.items()
            for group in range(GROUPS)
            if groups >> group & 1
            for record in self._database.headers_in(robot_id, group)
        )
        self._requested_groups = frozenset()
        if not self._queue.frames:
            self._queue.put_one_first()

    def _enqueue(self, records: Iterable[Record]) -> None:
        """Give out messages: the most urgent of many now, the others while frames leave.

        All at once would hold up the node.
        """
        self._backlog += records
        if len(self._backlog) > SLICE:
            self._backlog.sort(key=attrgetter("priority"))
        self._feed()

    def _feed(self) -> None:
        part = self._backlog[-SLICE:]
        del self._backlog[-SLICE:]
        self._queue.add(part)

    def _refill(self) -> None:
        """Put what is new in its order, and the next of much."""
        self._poll()
        if self._backlog:
            self._feed()
        while self._backlog and not self._queue:  # the peer had all of those
            self._feed()

    def _poll(self) -> None:
        sequence = self._database.sequence
        if sequence == self._sequence or self._unknown:
            return
        new = self._database.since(self._sequence)
        if self.follows:
            new = self._pushed(new)
        self._queue.add(new)
        self._sequence = sequence

    def _pushed(self, new: Iterable[Record]) -> list[Record]:
        """Messages to push; others that the peer may lack are announced."""
        peer, pushed = self._peer, []
        announced = []
        for record in new:
            robot_id, message_id = record.header.robot_id, sync.record_id(record)
            if robot_id in peer.pushed and len(record.body) <= PUSH_BYTES:
                pushed.append(record)
            elif (
                robot_id in peer.pushed or robot_id not in self._followed
            ) and peer.holdings.lacks(record, message_id):
                announced.append(message_id)
        if announced:
            self._outbox.append((sync.NEWS, sync_messages.encode_news(announced), 0))
        return pushed

    def _message_part(self, room: int) -> bytes:
        """The next part of the first message that waits."""
        kind, content, offset = self._outbox.pop(0)
        frame = sync.message_frame(kind, self._round, content, offset, room)
        offset += len(frame) - sync.MESSAGE_HEADER_BYTES
        if offset < len(content):
            self._outbox.insert(0, (kind, content, offset))
        self.bytes += len(frame)
        self._free += len(frame) if kind in (sync.GROUPS, sync.TOPICS) else 0
        return frame

    def _end(self) -> None:
        self.cut_short = bool(self._queue or self._backlog)
        done = sync_messages.Done(
            self._database.epoch, self._sequence, self._queue.frames, self.cut_short
        )
        self.done = True
        self._outbox.append((sync.DONE, done.encode(), 0))
