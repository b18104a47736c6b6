"""What every part of a sync speaks of: requests on a connection, and actions at the node's sockets.

A request is ID (6 bytes, any) + CODE (5 letters) + argument; the reply repeats the ID.
"""

from __future__ import annotations

from dataclasses import dataclass

ID_BYTES = 6
CODE_BYTES = 5
GHEAD, GDATA, DENDT = b"GHEAD", b"GDATA", b"DENDT"  # the list of headers, a message, the end
# Between new nodes: open a sync, a later frame of it, more credit. Original nodes refuse them.
SYNC1, SYNCF, SYNCC = b"SYNC1", b"SYNCF", b"SYNCC"
SERRM, ACK = b"SERRM", b"Ack"

# An original client is idle again 12.4 s after its last unanswered request. Until then it may ask
# for what was offered to it, and it would store an error reply as if it were a message.
PATIENCE_S = 13.0
FOLLOW_S = 60.0  # a peer that says nothing for longer does not follow any more
NEAR_S = 0.02  # round trips below this: a connection is set up in no time and carries more
LINGER_S = 2.0  # so long the end of a sync is repeated to a peer that asks again

Frame = bytes | memoryview
Route = tuple[bytes, ...]
"""The frames in front of a request that say on which connection it came."""


def request(request_id: bytes, code: bytes, argument: bytes = b"") -> bytes:
    """A request frame."""
    return request_id + code + argument


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
    """Send a reply on the connection on which the peer asked."""

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
