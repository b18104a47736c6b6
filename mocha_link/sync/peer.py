"""One peer of a node: what its syncs share and remember while both nodes run."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Set as AbstractSet

from mocha_link.store import Header, PayloadError, Record, Trailer
from mocha_link.sync.address_tokens import AddressTokens
from mocha_link.sync.agreement import TopicAgreement
from mocha_link.sync.contact_budget import ContactBudget
from mocha_link.sync.offers import Offers
from mocha_link.sync.path_memory import PathMemory
from mocha_link.sync.peer_holdings import PeerHoldings
from mocha_link.sync.peer_log import PeerLog
from mocha_link.sync.peer_process import PeerProcess
from mocha_link.sync.protocol import Frame, NodeContext
from mocha_link.sync.pull_connection import PullConnection
from mocha_link.team import Robot, Topic

Verify = Callable[[Header, Frame, Trailer | None], None]
"""Raises PayloadError for a message that a peer may not hand us."""


class Peer:
    """The state of a peer that outlives a pull: one part for each thing that is remembered.

    Args:
        verify: refuses messages that the peer may not hand us; None: it may hand us any.
        budget_bytes: that may come in during a contact; 0: no limit.

    Attributes:
        name: the peer's robot.
        node: our node's context.
        original: it is known to run the original node: nothing newer is tried.
        datagrams: there is a socket for them.
        pushed: ids of the robots whose new messages reach the peer no other way than by us.
        log: events, refusals and bytes, for the node to take out.
        process: its process, by its boot id.
        agreement: the topics that are exchanged.
        tokens: the address tokens of both sides.
        path: what pulls have shown of the way to it.
        budget: bytes that pulls may still bring in.
        connection: over which we pull.
        holdings: what it holds.
        offers: what it offers and we lack.
    """

    def __init__(  # noqa: PLR0913 - all that makes peers differ, once
        self,
        name: str,
        node: NodeContext,
        *,
        verify: Verify | None = None,
        original: bool = False,
        datagrams: bool = True,
        budget_bytes: int = 0,
        pushed: AbstractSet[int] = frozenset(),
    ) -> None:
        self.name = name
        self.node = node
        self.original = original
        self.datagrams = datagrams
        self.pushed = pushed
        self.log = PeerLog(name)
        self.process = PeerProcess()
        self.agreement = TopicAgreement(node)
        self.tokens = AddressTokens()
        self.path = PathMemory()
        self.budget = ContactBudget(budget_bytes)
        self.connection = PullConnection(name, node)
        self.holdings = PeerHoldings(node.team.histories, self.agreement)
        self.offers = Offers()
        self._verify = verify

    def opened(self, boot_id: int) -> None:
        """The peer has opened a sync; a new process of it has forgotten what it held."""
        if self.process.opened(boot_id):
            self.holdings.forget()

    def store(self, known: tuple[Robot, Topic], record: Record, trailer: Trailer | None) -> bool:
        """Store an intact message that the peer handed us; whether it was new.

        Raises:
            PayloadError: it is of another type than ours, or the peer may not hand it on.
        """
        check_type(record.body, known[1])
        if self._verify:
            self._verify(record.header, record.body, trailer)
        if not self.node.database.insert(record, record.received_s):
            return False
        self.log.stored(known, record)
        return True


def check_type(body: Frame, topic: Topic) -> None:
    """Raise PayloadError unless a sound body is of the type of the topic in our team file."""
    if body[0] != topic.dtype:
        raise PayloadError(
            f"type id {body[0]}, but {topic.name} is {topic.type} ({topic.dtype}) here; "
            "use the same team file everywhere"
        )
