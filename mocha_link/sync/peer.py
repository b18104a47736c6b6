"""The state of one peer that its syncs share while both nodes run."""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Callable
from collections.abc import Set as AbstractSet

from mocha_link.clock import Instant
from mocha_link.links import (
    Direction,
    LinkEvent,
    MessageStored,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.store import Header, PayloadError, Record, Trailer
from mocha_link.sync.peer_holdings import Offers, PeerHoldings, TopicAgreement
from mocha_link.sync.peer_path import ContactBudget, PathMemory, PullConnection
from mocha_link.sync.protocol import TRIAL_BOOT_ID, Frame, NodeContext
from mocha_link.team import Robot, Topic

_BOOT_IDS = 8  # remembered: a boot id that appears again belongs to a second process
_ALONE = 16  # after this many consecutive openings of one process no second one runs
_VALID = 3  # the newest tokens that we issued are valid
Verify = Callable[[Header, Frame, Trailer | None], None]
"""Raises PayloadError for a message that a peer may not send us."""


class PeerProcess:
    """The process of a peer, by the boot ids in its syncs.

    Attributes:
        duplicate: two processes run as the peer's robot: an earlier boot id has appeared again.
        duplicated: the peer has detected two processes that run as our robot.
    """

    def __init__(self) -> None:
        self.duplicate = False
        self.duplicated = False
        self._restarted = False  # since the last `take_restarted`
        self._boot_id: int | None = None  # of the current process; None: it has not opened yet
        self._past_boot_ids: deque[int] = deque(maxlen=_BOOT_IDS)
        self._in_a_row = 0  # consecutive openings of the current process

    def opened(self, boot_id: int) -> bool:
        """Note the boot id of an opening; returns whether the process differs from the last one."""
        if boot_id == self._boot_id:
            self._in_a_row += 1
            self.duplicate = self.duplicate and self._in_a_row < _ALONE
            return False
        self._in_a_row = 1
        self._restarted = self._boot_id is not None
        if boot_id != TRIAL_BOOT_ID:
            self.duplicate = self.duplicate or boot_id in self._past_boot_ids
            if self._boot_id not in (None, TRIAL_BOOT_ID):
                self._past_boot_ids.append(self._boot_id)
        self._boot_id = boot_id
        return True

    def report_duplicated(self, *, duplicated: bool) -> None:
        """Note from a HELLO whether the peer has detected two processes of our robot."""
        self.duplicated = duplicated

    def take_restarted(self) -> bool:
        """Whether the peer's process was replaced since the last call."""
        restarted, self._restarted = self._restarted, False
        return restarted


class PeerLog:
    """The reports of the syncs with one peer, until the node fetches them.

    Attributes:
        events: for listeners, in order.
        refusals: reasons of refused input.
    """

    def __init__(self, name: str) -> None:
        self.events: list[LinkEvent] = []
        self.refusals: list[str] = []
        self._name = name  # of the peer
        self._bytes_in = 0  # received since the last `take_bytes_in`

    def started(self, direction: Direction, now: Instant) -> None:
        """Report that a sync begins."""
        self.events.append(SyncStarted(self._name, now.unix_s, direction))

    def ended(  # noqa: PLR0913 - the fields of the event
        self,
        direction: Direction,
        now: Instant,
        *,
        began_s: float,
        messages: int,
        size: int,
        complete: bool = True,
    ) -> None:
        """Report that a sync has ended; `began_s`: when it began, steady seconds."""
        taken_s = now.steady_s - began_s
        self.events.append(
            SyncEnded(self._name, now.unix_s, direction, messages, size, taken_s, complete)
        )

    def timed_out(self, direction: Direction, reason: str, now: Instant) -> None:
        """Report that a sync was aborted or rejected."""
        self.events.append(SyncTimedOut(self._name, now.unix_s, direction, reason))

    def stored(self, known: tuple[Robot, Topic], record: Record) -> None:
        """Report that a new message of the peer was stored."""
        robot, topic = known
        at_s, size = record.received_s, len(record.body)
        self.events.append(
            MessageStored(self._name, at_s, robot.name, topic.name, record.header, size)
        )

    def refuse(self, reason: str) -> None:
        """Report that input from the peer was refused."""
        self.refusals.append(reason)

    def received(self, size: int) -> None:
        """Count bytes received from the peer."""
        self._bytes_in += size

    def take_events(self) -> list[LinkEvent]:
        """The events since the last call."""
        events, self.events = self.events, []
        return events

    def take_refusals(self) -> list[str]:
        """The refusals since the last call."""
        refusals, self.refusals = self.refusals, []
        return refusals

    def take_bytes_in(self) -> int:
        """The bytes that were received since the last call."""
        bytes_in, self._bytes_in = self._bytes_in, 0
        return bytes_in


class AddressTokens:
    """The tokens that we issued to one peer, and the one that it issued to us.

    Attributes:
        received: the newest token from the peer, for our next OPEN; 0: none received yet.
    """

    def __init__(self) -> None:
        self.received = 0
        self._issued: deque[int] = deque(maxlen=_VALID)  # to the peer, the newest last

    def receive(self, address_token: int) -> None:
        """Note the token that the peer has issued to us; 0: keep the previous one."""
        self.received = address_token or self.received

    @property
    def next(self) -> int:
        """The token for the next HELLO to the peer."""
        if not self._issued:
            self.renew()
        return self._issued[-1]

    def renew(self) -> None:
        """Issue a new token next time, so that replayed openings become invalid."""
        self._issued.append(secrets.randbits(64) or 1)

    def verify(self, address_token: int) -> bool:
        """Whether we issued this token to the peer recently."""
        return address_token in self._issued


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
