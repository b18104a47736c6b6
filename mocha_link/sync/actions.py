"""What a node wants done at its sockets."""

from __future__ import annotations

from dataclasses import dataclass

from mocha_link.sync.server import Route


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
