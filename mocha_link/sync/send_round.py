"""One round of a served pull: selects the messages to send after an OPEN of the peer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from collections.abc import Set as AbstractSet
from operator import attrgetter

from mocha_link.store import GROUPS, Record
from mocha_link.sync.frames import record_id
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import Frame
from mocha_link.sync.send_queue import SendQueue
from mocha_link.sync.sync_messages import Digest, Done, Have, HeldGroups, Open, Since

SLICE = 2_000  # messages that are sorted at once: some milliseconds
PUSH_BYTES = 65_536  # larger messages are announced only: they need the flow control of a pull

GroupDigests = list[tuple[int, tuple[int, ...]]]
"""Robot ids, and the digests of the groups of their topics."""


class Follower:
    """Sorts new messages into those that are pushed to the peer and those that are announced.

    Small messages of the robots in `Peer.pushed` are pushed, best effort. Others are announced,
    unless the peer follows their publisher, and are sent in its next pull.
    """

    def __init__(self, peer: Peer) -> None:
        self._pushed = peer.pushed
        self._holdings = peer.holdings
        self._followed: frozenset[int] = frozenset()  # robots that push their messages to the peer

    def follow(self, robot_ids: Iterable[int]) -> None:
        """Note that the peer follows us; `robot_ids`: the other robots that push to it."""
        self._followed = frozenset(robot_ids)

    def wants(self, robot_ids: AbstractSet[int]) -> bool:
        """Whether new messages of these robots concern the peer."""
        return not (robot_ids <= self._followed and robot_ids.isdisjoint(self._pushed))

    def sort(self, records: Iterable[Record]) -> tuple[list[Record], list[int]]:
        """The messages to push, and the ids of others that the peer may lack."""
        pushed, announced = [], []
        for record in records:
            robot_id, message_id = record.header.robot_id, record_id(record)
            if robot_id in self._pushed and len(record.body) <= PUSH_BYTES:
                pushed.append(record)
            elif not self.wants({robot_id}):
                continue
            elif self._holdings.lacks(record, message_id):
                announced.append(message_id)
        return pushed, announced


class SendRound:
    """The messages that the peer lacks by its OPEN, and those that are stored later.

    Attributes:
        number: the number of the round; -1: the peer has not opened.
    """

    def __init__(self, peer: Peer, queue: SendQueue, number: int = -1) -> None:
        self.number = number
        self._peer = peer
        self._database = peer.node.database
        self._queue = queue
        self._backlog: list[Record] = []  # still to be queued, the most urgent last
        self._compared: frozenset[int] = frozenset()  # robots whose groups are being compared
        self._opened_at = 0  # sequence of the database at the OPEN
        self._sequence: int | None = None  # messages stored after it are new; None: no valid OPEN

    def open(self, opening: Open) -> GroupDigests | None:
        """Queue the messages that the peer lacks.

        Returns the digests that the peer must compare before the rest is known; None: the OPEN
        refers to an unknown database or sequence.
        """
        sequence = self._database.sequence  # first: other threads store meanwhile
        groups: GroupDigests = []
        new: Iterable[Record] = ()
        holdings = self._peer.holdings
        match opening.knowledge:
            case Since(epoch, known_sequence, message_ids):
                holdings.add(*message_ids)
                if not self._database.remembers(epoch, known_sequence):
                    return None
                new = self._database.since(known_sequence)
            case Have(message_ids):
                holdings.forget()
                holdings.add(*message_ids)
                new = self._database.kept()
            case Digest(digests):
                holdings.forget()
                new, groups = self._compare(digests)
        self._sequence = self._opened_at = sequence
        self._compared = frozenset(robot_id for robot_id, _ in groups)
        self._queue.resume(opening.requests)
        self._enqueue(new)
        self._queue.put_one_first()
        return groups

    def answer(self, held: Sequence[HeldGroups]) -> None:
        """Process the peer's list of its messages in the groups that differ."""
        if not self._compared:
            return
        self._peer.holdings.add(*(message_id for each in held for message_id in each.message_ids))
        differing = dict.fromkeys(self._compared, 0)  # groups, a bit each, so none is read twice
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
        self._compared = frozenset()
        if not self._queue.frames:
            self._queue.put_one_first()

    def refill(self, follower: Follower | None) -> list[int]:
        """Queue newly stored messages, and the next part of the backlog.

        To a peer that follows only some messages are pushed; returns the ids to announce.
        """
        announced: list[int] = []
        sequence = self._database.sequence
        if self._sequence is not None and self._sequence != sequence:
            new = self._database.since(self._sequence)
            if follower:
                new, announced = follower.sort(new)
            self._queue.add(new)
            self._sequence = sequence
        if self._backlog:
            self._feed()
        while self._backlog and not self._queue:  # the peer holds all of the last part
            self._feed()
        return announced

    def fill(self, room: int, prefix: bytes) -> list[Frame] | None:
        """The next frame of chunks, in parts; None: nothing is queued, or nothing fits."""
        if not self._queue:
            return None
        stored_since = self._sequence != self._opened_at
        return self._queue.fill(room, self.number, prefix, may_be_replaced=stored_since)

    @property
    def awaits_answer(self) -> bool:
        """Whether nothing can be sent until the peer has compared the digests."""
        return not self._queue and bool(self._compared)

    def end(self) -> Done:
        """The message that ends the round."""
        cut_short = bool(self._queue or self._backlog)
        return Done(self._database.epoch, self._sequence or 0, self._queue.frames, cut_short)

    def _compare(self, digests: dict[int, int]) -> tuple[list[Record], GroupDigests]:
        """The messages that the peer certainly lacks, and the group digests of differing robots."""
        ours = self._database.digests()
        absent = ours.keys() - digests.keys()
        differing = [each for each in ours.keys() & digests.keys() if ours[each] != digests[each]]
        new = []
        if absent:
            new = [each for each in self._database.kept() if each.header.robot_id in absent]
        return new, [(each, self._database.group_digests(each)) for each in sorted(differing)]

    def _enqueue(self, records: Iterable[Record]) -> None:
        """Queue messages: of many the most urgent now, the others while frames are sent.

        Sorting all at once would block the node.
        """
        self._backlog += records
        if len(self._backlog) > SLICE:
            self._backlog.sort(key=attrgetter("priority"))
        self._feed()

    def _feed(self) -> None:
        part = self._backlog[-SLICE:]
        del self._backlog[-SLICE:]
        self._queue.add(part)
