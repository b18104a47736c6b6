"""The state of one peer that its syncs share while both nodes run."""

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
"""Raises PayloadError for a message that a peer may not send us."""


class Peer:
    """The state of a peer that outlives a pull, in one part for each purpose.

    Args:
        verify: refuses messages that the peer may not send us; None: it may send any.
        budget_bytes: may be received during a contact; 0: no limit.

    Attributes:
        name: the peer's robot.
        node: our node's context.
        original: it is known to run the original node: nothing newer is tried.
        datagrams: the node has a datagram socket.
        pushed: ids of the robots whose new messages only we can push to the peer.
        log: events, refusals and bytes, for the node to fetch.
        process: its process, by its boot id.
        agreement: the topics that are exchanged.
        tokens: the address tokens of both sides.
        path: measurements of the path to it.
        budget: bytes that pulls may still receive.
        connection: the connection over which we pull.
        holdings: the messages that it holds.
        offers: the messages that it offers and we lack.
    """

    def __init__(  # noqa: PLR0913 - all properties in which peers differ
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
        """Note an opening of the peer; a new process of it may hold nothing."""
        if self.process.opened(boot_id):
            self.holdings.forget()

    def store(self, known: tuple[Robot, Topic], record: Record, trailer: Trailer | None) -> bool:
        """Store an intact message from the peer; returns whether it was new.

        Raises:
            PayloadError: its type differs from ours, or the peer may not send it.
        """
        check_type(record.body, known[1])
        if self._verify:
            self._verify(record.header, record.body, trailer)
        if not self.node.database.insert(record, record.received_s):
            return False
        self.log.stored(known, record)
        return True


def check_type(body: Frame, topic: Topic) -> None:
    """Raise PayloadError unless an intact body has the type of the topic in our team file."""
    if body[0] != topic.dtype:
        raise PayloadError(
            f"type id {body[0]}, but {topic.name} is {topic.type} ({topic.dtype}) here; "
            "use the same team file everywhere"
        )
