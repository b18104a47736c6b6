"""The messages that one peer holds, offers and can receive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet

from mocha_link.store import WRAP_MS, Record, is_void, wire
from mocha_link.sync.protocol import NodeContext

_MAX_ANNOUNCED = 1_024
_MAX_LEFT = 1_024
BEGUN_BYTES = 64 * 1024 * 1024  # of partly sent messages, kept although newer ones replace them


class TopicAgreement:
    """The topics that we and one peer exchange, by configuration hashes and TOPICS.

    Attributes:
        config_mismatch: the peer's latest configuration hash differs from ours.
        definitions: the peer's definitions of ids from its last TOPICS, by topic key.
        known_hash: the configuration hash of that TOPICS; 0: none was received.
    """

    def __init__(self, node: NodeContext) -> None:
        self.config_mismatch = False
        self.definitions: Mapping[int, int] = {}
        self.known_hash = 0
        self._node = node
        self._agreed: frozenset[int] | None = None  # topic keys that are exchanged; None: all

    def receive_topics(self, config_hash: int, definitions: Mapping[int, int]) -> None:
        """Note the definitions of ids that the peer has sent."""
        self.known_hash, self.definitions = config_hash, definitions

    def compare(self, config_hash: int) -> bool:
        """Compare the peer's configuration hash with ours; returns whether its topics are known."""
        self.config_mismatch = config_hash != self._node.config_hash
        if not self.config_mismatch:
            self._agreed = None
        elif config_hash == self.known_hash:
            ours = self._node.definitions.items()
            self._agreed = frozenset(k for k, each in ours if self.definitions.get(k) == each)
        else:
            self._agreed = frozenset()
            return False
        return True

    def expect_match(self) -> None:
        """Assume no mismatch: the peer refuses the sync, so it may run another node now."""
        self.config_mismatch = False

    def exchanges(self, topic_key: int) -> bool:
        """Whether the messages of a topic are exchanged: both nodes define it alike."""
        return self._agreed is None or topic_key in self._agreed


class Offers:
    """The ids of messages that one peer has and that we still lack.

    Attributes:
        announced: ids that the peer has announced since our last OPEN to it.
        left: ids that another peer is to send instead, until they are received.
    """

    def __init__(self) -> None:
        self.announced: set[int] = set()
        self.left: set[int] = set()

    def announce(self, message_ids: Sequence[int]) -> None:
        """Note that the peer announced messages that we lack."""
        self.announced.update(message_ids[: _MAX_ANNOUNCED - len(self.announced)])

    def requested(self) -> None:
        """Clear the announced ids: an OPEN to the peer covers them."""
        self.announced.clear()

    @property
    def left_full(self) -> bool:
        """Whether no more messages can be left to another peer."""
        return len(self.left) >= _MAX_LEFT

    def leave(self, message_ids: Iterable[int]) -> None:
        """Leave messages to another peer."""
        self.left.update(message_ids)

    def still_left(self, message_ids: AbstractSet[int]) -> None:
        """Replace the ids left to another peer after a pull by those not received yet."""
        self.left = set(message_ids)


class PeerHoldings:
    """The messages that one peer holds, and those that were partly sent to it.

    This is an optimisation. It avoids sending messages that the peer has, and allows a partly sent
    message to be completed although a newer one has replaced it.

    Args:
        histories: the number of versions that are kept, by topic key.
        agreement: the topics that are exchanged.
        begun_bytes: the limit for partly sent messages that are kept.
    """

    def __init__(
        self,
        histories: Mapping[int, int],
        agreement: TopicAgreement,
        *,
        begun_bytes: int = BEGUN_BYTES,
    ) -> None:
        self._histories = histories
        self._agreement = agreement
        self._most_begun_bytes = begun_bytes
        self._held: dict[int, tuple[int, ...]] = {}  # by topic key: stamps, newest first
        self._begun: dict[int, Record] = {}  # partly sent, by message id
        self._begun_bytes = 0  # of their bodies

    # --- messages that it holds

    def forget(self) -> None:
        """Clear the record: the peer reports all its messages next, or its process is new."""
        self._held.clear()

    def add(self, *message_ids: int) -> None:
        """Note that the peer holds these messages."""
        listed: dict[int, set[int]] = {}
        for message_id in message_ids:
            listed.setdefault(message_id >> 48, set()).add(message_id & wire.STAMP_MASK)
        for key, stamps in listed.items():
            stamps.update(self._held.get(key, ()))
            newest = sorted(stamps, reverse=True)[: self._histories.get(key, 1)]
            self._held[key] = tuple(newest)

    def stamps_ms(self, topic_key: int) -> tuple[int, ...]:
        """The stamps of the messages of a topic that the peer is known to hold, newest first."""
        return self._held.get(topic_key, ())

    @property
    def newest(self) -> dict[int, int]:
        """The newest messages that it is known to hold: stamps in milliseconds by topic key."""
        return {key: stamps[0] for key, stamps in self._held.items()}

    def lacks(self, record: Record, message_id: int) -> bool:
        """Whether the peer may want a message, as far as is known."""
        key, stamp_ms = message_id >> 48, record.stamp_ms
        if not self._agreement.exchanges(key):
            return False
        held = self._held.get(key)
        if held is None:
            return True
        if stamp_ms in held:
            return False
        if is_void(held[0], wire.latest_ms(record.received_s)):  # its clock and ours were wrong
            return True
        if record.extrapolated:  # other nodes may have extrapolated another stamp
            return all((other - stamp_ms) % WRAP_MS for other in held)
        return held[-1] < stamp_ms or len(held) < self._histories.get(key, 1)

    # --- partly sent messages

    def begin(self, message_id: int, record: Record) -> None:
        """Note that a part of a message is sent."""
        if message_id in self._begun:
            return
        self._begun[message_id] = record
        self._begun_bytes += len(record.body)
        while self._begun_bytes > self._most_begun_bytes and len(self._begun) > 1:
            self._end(next(iter(self._begun)))

    def begun(self, message_id: int) -> Record | None:
        """A partly sent message; None: no part was sent, or it is no longer kept."""
        return self._begun.get(message_id)

    def end_begun(self, kept: Iterable[int] = ()) -> None:
        """Release partly sent messages, except those in `kept`."""
        for message_id in set(self._begun).difference(kept):
            self._end(message_id)

    def _end(self, message_id: int) -> None:
        self._begun_bytes -= len(self._begun.pop(message_id).body)
