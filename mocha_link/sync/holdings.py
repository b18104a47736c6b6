"""The holdings that the pulling node reports in a sync, in the shortest form.

The forms are: a sequence of the peer's database with the ids stored since, all ids, or digests.
"""

from __future__ import annotations

from collections.abc import Container

from mocha_link.clock import Instant
from mocha_link.store import STAMP_MASK
from mocha_link.sync.frames import header_of, record_id
from mocha_link.sync.peer import Peer
from mocha_link.sync.sync_messages import (
    MAX_FRAGMENTS,
    Digest,
    FragmentRequest,
    Have,
    HeldGroups,
    Since,
)

MAX_LISTED = 512  # message ids in an OPEN; for more, digests are shorter
SPARE_BYTES = 32_768  # may be sent twice to avoid another round trip
SHARED_BYTES = 16_384  # larger messages are received from one peer at a time


class Holdings:
    """The messages that the node holds, whole or in part, as reported to one peer.

    Attributes:
        announced_sequence: the sequence of the database at the last report to the peer.
        left: ids of messages that the peer need not send, as another peer is sending them.
    """

    def __init__(self, peer: Peer) -> None:
        self.announced_sequence = 0
        self.left: set[int] = set()
        self._peer = peer
        self._database = peer.node.database
        self._reassembly = peer.node.reassembly

    def knowledge(self, now: Instant) -> Since | Have | Digest:
        """The holdings as changes since the last pull, if possible; otherwise as in `all`."""
        owed = self._share(now)
        self.announced_sequence = self._database.sequence  # first: other threads store meanwhile
        known = self._database.knowledge(self._peer.name)
        if known is None or owed:
            return self.all()
        stored = self._database.since(known.own_sequence)
        if len(stored) > MAX_LISTED:
            stored.sort(key=lambda record: len(record.body), reverse=True)
            if sum(len(record.body) for record in stored[MAX_LISTED:]) > SPARE_BYTES:
                return self.all()
        message_ids = [record_id(record) for record in stored[:MAX_LISTED]]
        return Since(known.epoch, known.sequence, [*message_ids, *self.left])

    def _share(self, now: Instant) -> bool:
        """Divide the missing messages among the peers.

        Returns whether the peer must send a message that earlier OPENs reported to it as present.
        """
        name, offers, reassembly = self._peer.name, self._peer.offers, self._reassembly
        for message_id in offers.announced | offers.left:
            if self.wants(message_id, now.unix_s):
                reassembly.assign(message_id, name, now.steady_s)
        offers.requested()
        self.left = set() if offers.left_full else reassembly.elsewhere(name, now.steady_s)
        owed = any(self.wants(each, now.unix_s) for each in offers.left - self.left)
        offers.leave(self.left)
        return owed

    def all(self) -> Have | Digest:
        """The complete holdings."""
        self.announced_sequence = self._database.sequence
        kept = self._database.kept()
        if len(kept) <= MAX_LISTED:
            return Have([*map(record_id, kept), *self.left])
        return Digest(self._database.digests())

    def unannounced_since(self, received_ids: Container[int]) -> int:
        """The sequence after which the database has messages that were not reported to the peer.

        `received_ids`: of the messages that the peer has sent. Without this a message that we
        stored during a pull would be sent back to us once the peer has it from another node.
        """
        for number, record in self._database.numbered_since(self.announced_sequence):
            if record_id(record) not in received_ids:
                return number - 1
        return self._database.sequence

    def leaves(self, message_id: int, total: int, now: Instant) -> bool:
        """Whether to leave a message, of which the peer sends a part, to another peer."""
        peer = self._peer
        takes = total <= SHARED_BYTES or peer.offers.left_full
        if takes or self._reassembly.assign(message_id, peer.name, now.steady_s):
            return False
        self.left.add(message_id)
        peer.offers.leave({message_id})
        return True

    def differing_groups(self, robot_id: int, digests: tuple[int, ...]) -> HeldGroups:
        """Our messages in those groups of a robot's topics whose digests differ."""
        groups = 0
        message_ids = []
        for group, ours in enumerate(self._database.group_digests(robot_id)):
            if ours != digests[group]:
                groups |= 1 << group
                message_ids += [record_id(r) for r in self._database.headers_in(robot_id, group)]
                here = robot_id, group  # of 16: the lower half of topic ids
                message_ids += [m for m in self.left if (m >> 56, m >> 48 & 15) == here]
        return HeldGroups(robot_id, groups, message_ids)

    def requests(self, now_s: float) -> list[FragmentRequest]:
        """The missing ranges of partly received messages; drops those that are no longer wanted."""
        requests: list[FragmentRequest] = []
        for message_id, fragment in self._reassembly.of(self._peer.name):
            if not self.wants(message_id, now_s):
                self._reassembly.drop(message_id)
            elif len(requests) < MAX_FRAGMENTS and message_id not in self.left:
                requests.append(FragmentRequest(message_id, fragment.total, fragment.missing()))
        return requests

    def wants(self, message_id: int, now_s: float) -> bool:
        """Whether a message would be new at Unix time `now_s`."""
        return self._database.wants(header_of(message_id), now_s, message_id & STAMP_MASK)
