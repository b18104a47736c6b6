"""Which topics two nodes exchange: those that both team files define alike."""

from __future__ import annotations

from collections.abc import Mapping

from mocha_link.sync.protocol import NodeContext


class TopicAgreement:
    """The topics that we and one peer exchange, by configuration hashes and TOPICS.

    Attributes:
        config_mismatch: the peer assigns ids differently, by its latest configuration hash.
        definitions: what ids mean to the peer, by topic key, as it has sent for `known_hash`.
        known_hash: the configuration hash of those; 0: it has sent none.
    """

    def __init__(self, node: NodeContext) -> None:
        self.config_mismatch = False
        self.definitions: Mapping[int, int] = {}
        self.known_hash = 0
        self._node = node
        self._agreed: frozenset[int] | None = None  # topic keys that are exchanged; None: all

    def receive_topics(self, config_hash: int, definitions: Mapping[int, int]) -> None:
        """The peer sent what ids mean to it."""
        self.known_hash, self.definitions = config_hash, definitions

    def compare(self, config_hash: int) -> bool:
        """Compare the peer's configuration hash with ours; whether it is clear what to exchange."""
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
        """The peer refuses the sync: it may run another node now, so nothing counts as known."""
        self.config_mismatch = False

    def exchanges(self, topic_key: int) -> bool:
        """Whether the messages of a topic are exchanged: it is the same to both nodes."""
        return self._agreed is None or topic_key in self._agreed
