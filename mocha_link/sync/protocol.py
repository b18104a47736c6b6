"""Shared by all parts of a sync: the node's context, request codes, and actions for its sockets.

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
# Between new nodes: open a sync, a later frame of it, more credit. Original nodes refuse these.
SYNC1, SYNCF, SYNCC = b"SYNC1", b"SYNCF", b"SYNCC"
SERRM, ACK = b"SERRM", b"Ack"

# An original client gives up 12.4 s after a request without a reply. Until then it may request
# messages that were offered to it, and it would store an error reply as a message.
REQUEST_PATIENCE_S = 13.0
FOLLOW_S = 60.0  # a peer that sends nothing for longer is no longer followed
NEAR_S = 0.02  # with a shorter round trip TCP is as fast as datagrams from the start
TRIAL_BOOT_ID = 0  # of a trial beside the robot's own node, which is no duplicate
LINGER_S = 2.0  # how long the end of a sync is repeated on request

Frame = bytes | memoryview
Route = tuple[bytes, ...]
"""The frames before a request that identify its connection."""

DIALLED: Route = ()
"""The connection that we opened ourselves, as the peer's route for pulls from us."""


def is_request(frame: Frame) -> bool:
    """Whether a frame is a request of a sync; frames on a connection may also be replies."""
    return frame[ID_BYTES : ID_BYTES + CODE_BYTES] in (SYNC1, SYNCF, SYNCC)


@dataclass(frozen=True, slots=True)
class Standing:
    """The kernel's measurements of an open connection (TCP_INFO).

    Attributes:
        loses_much: losses slow TCP down to almost nothing.
        rtt_s: its round-trip time; None: not measured.
        unsent_bytes: bytes that wait until TCP's window admits them; None: not known.
    """

    loses_much: bool = False
    rtt_s: float | None = None
    unsent_bytes: int | None = None


def random_boot_id() -> int:
    """A random number for this process, different from `TRIAL_BOOT_ID`."""
    return int.from_bytes(os.urandom(8), "big") or 1


def random_id() -> bytes:
    """The id of a request, unless a test supplies another source."""
    return os.urandom(ID_BYTES)


@dataclass(frozen=True, slots=True)
class Connect:
    """Open a new connection to a peer."""

    peer: str


@dataclass(frozen=True, slots=True)
class Send:
    """Send a request to a peer on the connection that was opened for it."""

    peer: str
    frame: bytes


@dataclass(frozen=True, slots=True)
class Disconnect:
    """Close the connection to a peer; if it is `void`, without what the kernel has not sent.

    Retransmissions of an aborted pull would otherwise reach the peer during the next one.
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
    """Send a datagram to the source address of the peer's datagrams."""

    peer: str
    packet: bytes


Action = Connect | Send | Disconnect | Reply | SendDatagram | ReplyDatagram


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeContext:
    """The context that the syncs of a node with all its peers share.

    Attributes:
        name: the node's robot.
        team: its robots and topics are accepted.
        database: the node's messages.
        reassembly: incomplete messages of all peers.
        new_id: makes the 6 random bytes that identify a request.
        boot_id: a random u64 of our process. Peers discard their record of our holdings when it
            changes. `TRIAL_BOOT_ID`: a trial beside the robot's own node, which is no duplicate.
        config_hash: the hash of our definitions of all ids (`config_hash_of`).
        definitions: the hash of each definition, by topic key (`definitions_of`).
        timeout_s: seconds without a byte after which a pull is aborted.
        follow: receive the messages that a peer stores between two pulls at once.
        followed: ids of the robots that push their new messages to us.
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
