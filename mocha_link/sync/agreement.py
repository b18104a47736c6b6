"""Which topics two nodes exchange: those that both team files define alike."""

from __future__ import annotations

from collections.abc import Mapping

from mocha_link.sync.protocol import NodeContext


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
