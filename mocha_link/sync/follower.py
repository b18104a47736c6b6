"""A peer that follows: which of the messages that we store it gets at once."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Set as AbstractSet

from mocha_link.store import Record
from mocha_link.sync.frames import record_id
from mocha_link.sync.peer import Peer

PUSH_BYTES = 65_536  # a larger message waits for the next pull, which may take its time


class Follower:
    """Sorts new messages into those that are pushed to the peer and those that are announced.

    Pushed are small messages of the robots in `Peer.pushed`, best effort. Others are announced,
    unless the peer follows their publisher; its next pull brings them.
    """

    def __init__(self, peer: Peer) -> None:
        self._pushed = peer.pushed
        self._holdings = peer.holdings
        self._followed: frozenset[int] = frozenset()  # robots whose messages it gets from them

    def follow(self, robot_ids: Iterable[int]) -> None:
        """The peer follows us, and gets the messages of these robots from themselves."""
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
