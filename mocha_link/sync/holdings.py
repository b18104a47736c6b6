"""What the asking side of a sync says that it holds, in whichever form is shortest.

What it had of the peer up to some number and has stored since, the ids of everything, or digests.
"""

from __future__ import annotations

from collections.abc import Container

from mocha_link.store import wire
from mocha_link.sync.frames import record_id
from mocha_link.sync.peer import Peer
from mocha_link.sync.sync_messages import (
    MAX_FRAGMENTS,
    Answer,
    Digest,
    FragmentRequest,
    Have,
    Since,
)

MAX_LISTED = 512  # message ids in an OPEN; beyond that digests are shorter
SPARE_BYTES = 32_768  # what may come twice rather than cost another round trip


class Holdings:
    """The messages that the node holds, whole or in part, as one peer is told of them.

    Attributes:
        told_sequence: the database's number when the peer was told last.
    """

    def __init__(self, peer: Peer) -> None:
        self.told_sequence = 0
        self._peer = peer
        self._database = peer.node.database
        self._reassembly = peer.node.reassembly

    def knowledge(self) -> Since | Have | Digest:
        """What the peer need not send, if it remembers what it offered; otherwise see `all`."""
        self.told_sequence = self._database.sequence  # first: others store meanwhile
        known = self._database.knowledge(self._peer.name)
        if known is None:
            return self.all()
        stored = self._database.since(known.own_sequence)
        if len(stored) > MAX_LISTED:
            stored.sort(key=lambda record: len(record.body), reverse=True)
            if sum(len(record.body) for record in stored[MAX_LISTED:]) > SPARE_BYTES:
                return self.all()
        message_ids = [record_id(record) for record in stored[:MAX_LISTED]]
        return Since(known.epoch, known.sequence, message_ids)

    def all(self) -> Have | Digest:
        """What the peer need not send, whatever it remembers."""
        self.told_sequence = self._database.sequence
        kept = self._database.kept()
        if len(kept) <= MAX_LISTED:
            return Have([record_id(record) for record in kept])
        return Digest(self._database.digests())

    def untold_since(self, given: Container[int]) -> int:
        """The database's number after which there is something that the peer was not told of.

        `given` are the ids of the messages that it gave us itself. Without this a message that we
        wrote during a pull would come back, once the peer had it from another node.
        """
        for number, record in self._database.numbered_since(self.told_sequence):
            if record_id(record) not in given:
                return number - 1
        return self._database.sequence

    def answer(self, robot_id: int, digests: tuple[int, ...]) -> Answer:
        """What there is of the groups of a robot's topics of which the peer has other digests."""
        groups = 0
        message_ids = []
        for group, ours in enumerate(self._database.group_digests(robot_id)):
            if ours != digests[group]:
                groups |= 1 << group
                message_ids += [record_id(r) for r in self._database.headers_in(robot_id, group)]
        return Answer(robot_id, groups, message_ids)

    def requests(self, now_s: float) -> list[FragmentRequest]:
        """What is missing of the messages that have come in part; lets go those not wanted now."""
        requests: list[FragmentRequest] = []
        for message_id, fragment in list(self._reassembly):
            if not self.wants(message_id, now_s):
                self._reassembly.drop(message_id)
            elif len(requests) < MAX_FRAGMENTS:
                requests.append(FragmentRequest(message_id, fragment.total, fragment.missing()))
        return requests

    def wants(self, message_id: int, now_s: float) -> bool:
        """Whether a message would be new at Unix time `now_s`."""
        return self._database.wants_stamp(
            message_id >> 56, message_id >> 48 & 0xFF, message_id & wire.STAMP_MASK, now_s
        )
