"""One round of a served pull: what the peer is to be given after its OPEN."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import attrgetter

from mocha_link.store import GROUPS, Record
from mocha_link.sync.follower import Follower
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import Frame
from mocha_link.sync.send_queue import SendQueue
from mocha_link.sync.sync_messages import Digest, Done, Have, HeldGroups, Open, Since

SLICE = 2_000  # messages that are put in their order at once: some milliseconds

GroupDigests = list[tuple[int, tuple[int, ...]]]
"""Robot ids, and the digests of the groups of their topics."""


class SendRound:
    """The messages that the peer lacks, by what it has listed, and those that are stored later.

    Attributes:
        number: of the round; -1: the peer has not opened.
    """

    def __init__(self, peer: Peer, queue: SendQueue, number: int = -1) -> None:
        self.number = number
        self._peer = peer
        self._database = peer.node.database
        self._queue = queue
        self._backlog: list[Record] = []  # that goes into it later, the most urgent last
        self._compared: frozenset[int] = frozenset()  # robots whose groups were requested
        self._opened_at = 0  # sequence of the database then
        self._sequence: int | None = None  # what is stored later is new; None: nothing is known

    def open(self, opening: Open) -> GroupDigests | None:
        """Find what the peer lacks; None: the list refers to what we do not know.

        Returns the digests that it has to compare before the rest is known.
        """
        sequence = self._database.sequence  # before the database is read
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
        """The peer lists what it holds of the groups that differ."""
        if not self._compared:
            return
        self._peer.holdings.add(*(message_id for each in held for message_id in each.message_ids))
        differing = dict.fromkeys(self._compared, 0)  # groups, a bit each; none is read twice
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
        """Put what was stored since in its order, and the next of much.

        A peer that follows gets only some of what was stored; the ids of others to announce.
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
        while self._backlog and not self._queue:  # the peer had all of those
            self._feed()
        return announced

    def fill(self, room: int, prefix: bytes) -> list[Frame] | None:
        """The next frame of chunks, in parts; None: nothing waits, or nothing fits."""
        if not self._queue:
            return None
        stored_since = self._sequence != self._opened_at
        return self._queue.fill(room, self.number, prefix, may_be_replaced=stored_since)

    @property
    def awaits_answer(self) -> bool:
        """Whether nothing is left to send before the peer has compared the digests."""
        return not self._queue and bool(self._compared)

    def end(self) -> Done:
        """The message that ends the round."""
        cut_short = bool(self._queue or self._backlog)
        return Done(self._database.epoch, self._sequence or 0, self._queue.frames, cut_short)

    def _compare(self, digests: dict[int, int]) -> tuple[list[Record], GroupDigests]:
        """What the peer certainly lacks, and the group digests of what differs otherwise."""
        ours = self._database.digests()
        absent = ours.keys() - digests.keys()
        differing = [each for each in ours.keys() & digests.keys() if ours[each] != digests[each]]
        new = []
        if absent:
            new = [each for each in self._database.kept() if each.header.robot_id in absent]
        return new, [(each, self._database.group_digests(each)) for each in sorted(differing)]

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
