"""What every part of a sync shares: the node's context, requests, and actions at its sockets.

A request is ID (6 bytes, any) + CODE (5 letters) + argument; the reply repeats the ID.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from mocha_link.store import Database, ReassemblyBuffer
from mocha_link.team import Team

ID_BYTES = 6
CODE_BYTES = 5
GHEAD, GDATA, DENDT = b"GHEAD", b"GDATA", b"DENDT"  # the list of headers, a message, the end
# Between new nodes: open a sync, a later frame of it, more credit. Original nodes refuse them.
SYNC1, SYNCF, SYNCC = b"SYNC1", b"SYNCF", b"SYNCC"
SERRM, ACK = b"SERRM", b"Ack"

# An original client is idle again 12.4 s after its last request without a reply. Until then it may
# request for what was offered to it, and it would store an error reply as if it were a message.
PATIENCE_S = 13.0
FOLLOW_S = 60.0  # a peer that sends nothing for longer no longer follows
NEAR_S = 0.02  # round trips below this: a connection is set up in no time and carries more
TRIAL_BOOT_ID = 0  # of a trial beside the node of a robot, which is no second robot
LINGER_S = 2.0  # so long the end of a sync is repeated on request

Frame = bytes | memoryview
Route = tuple[bytes, ...]
"""The frames before a request that identify its connection."""

DIALLED: Route = ()
"""The connection that we opened ourselves, when the peer pulls over it."""


def is_request(frame: Frame) -> bool:
    """Whether a frame is a request of a sync: what comes over a connection may also be a reply."""
    return frame[ID_BYTES : ID_BYTES + CODE_BYTES] in (SYNC1, SYNCF, SYNCC)


@dataclass(frozen=True, slots=True)
class Standing:
    """How a connection that stands does, by the kernel (TCP_INFO).

    Attributes:
        loses_much: so much is lost on it that TCP hardly sends.
        rtt_s: its round trip; None: not measured.
    """

    loses_much: bool = False
    rtt_s: float | None = None


def random_boot_id() -> int:
    """A number of this process that no other has, and that is not `TRIAL_BOOT_ID`."""
    return int.from_bytes(os.urandom(8), "big") or 1


def random_id() -> bytes:
    """The id of a request, unless a test supplies another source."""
    return os.urandom(ID_BYTES)


@dataclass(frozen=True, slots=True)
class Connect:
    """Open a fresh connection to a peer, for one pull."""

    peer: str


@dataclass(frozen=True, slots=True)
class Send:
    """Send a request to a peer on the connection that was opened for it."""

    peer: str
    frame: bytes


@dataclass(frozen=True, slots=True)
class Disconnect:
    """Close the connection to a peer: when what was sent on it is out, or at once if it is `void`.

    What the kernel repeated of a pull that broke off would get there in the midst of the next one.
    """

    peer: str
    void: bool = False


@dataclass(frozen=True, slots=True)
class Reply:
    """Send a reply on the connection of the request."""

    peer: str
    route: Route
    frame: bytes


@dataclass(frozen=True, slots=True)
class SendDatagram:
    """Send a datagram of a pull of ours to the peer's port for us."""

    peer: str
    packet: bytes


@dataclass(frozen=True, slots=True)
class ReplyDatagram:
    """Send a datagram to where the peer's datagrams come from."""

    peer: str
    packet: bytes


Action = Connect | Send | Disconnect | Reply | SendDatagram | ReplyDatagram


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeContext:
    """What the syncs of a node have in common, whatever peer they are with.

    Attributes:
        name: the node's robot.
        team: whose robots and topics are accepted.
        database: where messages go, and what there is to give.
        reassembly: where parts of messages wait for the rest; one for all peers.
        new_id: makes the 6 random bytes that name a request.
        boot_id: a random u64 of our process. Peers forget what they know of us when it changes.
            `TRIAL_BOOT_ID`: a trial beside the robot's node, which is no second robot.
        config_hash: what ids mean to us, as one number (`config_hash_of`).
        definitions: the same by topic key (`definitions_of`).
        timeout_s: seconds without a byte after which a pull breaks off.
        follow: take in at once what a peer stores between two pulls.
        followed: ids of the robots that push to us what they store.
        actions: for the transport to execute at the sockets, in order.
    """

    name: str
    team: Team
    database: Database
    reassembly: ReassemblyBuffer = field(default_factory=ReassemblyBuffer)
    new_id: Callable[[], bytes] = random_id
    boot_id: int = field(default_factory=random_boot_id)
    config_hash: int = 0
    definitions: Mapping[int, int] = field(default_factory=dict)
    timeout_s: float = 5.0
    follow: bool = True
    followed: set[int] = field(default_factory=set)
    actions: deque[Action] = field(default_factory=deque)
