"""A peer that follows us: which new messages are pushed to it, and which are announced."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Set as AbstractSet

from mocha_link.store import Record
from mocha_link.sync.frames import record_id
from mocha_link.sync.peer import Peer

PUSH_BYTES = 65_536  # larger messages are announced only: they need the flow control of a pull


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
