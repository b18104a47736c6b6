"""The exchange with one peer: our pulls from it, and its pulls from us.

No sockets here: the caller passes received input, and fetches actions and the frames of `supply`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet

from mocha_link.clock import Instant
from mocha_link.links import LinkTable
from mocha_link.sync.frames import is_reply
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import (
    DIALLED,
    Frame,
    Reply,
    ReplyDatagram,
    Route,
    Standing,
    is_request,
)
from mocha_link.sync.puller import Puller
from mocha_link.sync.server import Server


class Session:
    """Passes the input from one peer to our pull from it or to its pull from us.

    Args:
        link_table: counts bytes, refusals and measurements.
        both_ways: the peer may pull over our connection, and we over its connection.

    Attributes:
        peer: the peer.
    """

    def __init__(self, peer: Peer, link_table: LinkTable, *, both_ways: bool = True) -> None:
        self.peer = peer
        self._puller = Puller(peer, link_table)
        self._server = Server(peer)
        self._link_table = link_table
        self._both_ways = both_ways
        self._closed: Route | None = None  # the peer's connection over which we pulled, if closed

    # --- requests of the node

    def sync(self, now: Instant, *, both: bool = False, renews: bool = False) -> bool:
        """Pull from the peer; False if a pull is in progress, or the contact's budget is used up.

        `both`: request that the peer also pulls. `renews`: the pull counts as a new contact.
        """
        if both:
            self._server.request_pull()
        if renews and not self.pulls:
            self.peer.budget.renew()
        return self._puller.sync(now, self._over)

    def on_contact(self, now: Instant) -> None:
        """Note that a contact begins: stalled exchanges continue at once."""
        self.peer.budget.renew()
        self._server.on_contact(now)
        self._transmit(now)
        self._puller.on_contact(now)

    def contact_ended(self) -> None:
        """Note that the peer is out of range: its pushes are not received."""
        self.peer.connection.unshare()
        self._puller.unfollow()

    # --- input from the sockets

    def request(self, route: Route, parts: Sequence[bytes], now: Instant) -> None:
        """Process a frame on a connection that the peer opened."""
        if self._puller.expects(route, parts):
            self._puller.reply(parts, now)
            return
        if is_reply(parts):
            return  # to a pull that has moved to another connection
        reply = self._server.handle(route, parts, now)
        if reply is not None:
            self._link_table.count(self.peer.name, bytes_out=len(reply))
            self.peer.node.actions.append(Reply(self.peer.name, route, reply))
        self._transmit(now)

    def reply(self, parts: Sequence[Frame], now: Instant) -> None:
        """Process a reply on the connection to the peer, or a request that the peer sent on it."""
        if self._both_ways and len(parts) == 1 and is_request(parts[0]):
            self.request(DIALLED, [bytes(parts[0])], now)
        elif self.peer.connection.is_ours:
            self._puller.reply(parts, now)
        # Otherwise it is for a pull that has moved to a connection of the peer.

    def packet(self, packet: bytes, now: Instant) -> bool:
        """Process a datagram at the peer's port; whether to reply to its source address."""
        accepted = self._server.packet(packet, now)
        self._transmit(now)
        return accepted

    def packet_back(self, packet: bytes, now: Instant) -> None:
        """Process a datagram that the peer sent in reply to ours."""
        self._puller.packet(packet, now)

    def progress(self, now: Instant, rtt_s: float | None) -> None:
        """Note that the connection to the peer was established or received bytes."""
        self._puller.progress(now, rtt_s)

    def lost(self, reason: str, now: Instant) -> None:
        """Note that the connection to the peer was lost."""
        self._server.lost(DIALLED)
        self._puller.lost(reason, now)

    def route(self, standing: Callable[[Route], Standing | None]) -> Route | None:
        """The connection on which the peer pulls, if it does and the connection is open.

        `standing`: the kernel's measurements of a connection; None: it is closed.
        """
        way = self.peer.connection.route
        if way != DIALLED:
            found = standing(way)
            if found is None:
                self._closed = way
            elif found.rtt_s is not None:
                self.peer.path.measured(found.rtt_s)
        return self._server.route(standing)

    # --- output

    def supply(self) -> tuple[Route, list[Frame]] | None:
        """The next frame of a sync for a connection of the peer, in parts; None: nothing now."""
        supplied = self._server.supply()
        if supplied:
            self._link_table.count(self.peer.name, bytes_out=sum(map(len, supplied[1])))
        return supplied

    def _transmit(self, now: Instant) -> None:
        for packet in self._server.transmit(now):
            self._link_table.count(self.peer.name, bytes_out=len(packet))
            self.peer.node.actions.append(ReplyDatagram(self.peer.name, packet))

    # --- timers

    def tick(self, now: Instant) -> None:
        """Run the timers of our pull."""
        if self._closed is not None:
            self._puller.lost("the peer closed the connection", now, self._closed)
            self._closed = None
        self._puller.tick(now, self._over, self._server.received_s)

    def serve(self, now: Instant) -> None:
        """Run the timers of the peer's pull, and send its due datagrams and new messages."""
        self._server.tick(now)
        self._transmit(now)

    @property
    def wake_s(self) -> float | None:
        """When the first timer expires, in steady seconds; None: no timer runs."""
        wakes_s = (self._puller.wake_s, self._server.wake_s)
        return min((each for each in wakes_s if each is not None), default=None)

    # --- state

    @property
    def pulls(self) -> bool:
        """Whether a pull of ours is running."""
        return self._puller.pull is not None

    @property
    def closed(self) -> bool:
        """Whether the peer's connection over which we pulled is closed: `tick` is due."""
        return self._closed is not None

    @property
    def has_all(self) -> bool:
        """Whether every message that the peer stores is pushed to us, by it or by its publisher."""
        return self._puller.has_all

    def wants_push(self, robot_ids: AbstractSet[int]) -> bool:
        """Whether new messages of these robots concern the peer."""
        return self._server.wants_push(robot_ids)

    @property
    def _over(self) -> Route | None:
        """The connection of the peer over which we may pull as well."""
        return self._server.over if self._both_ways and not self.peer.original else None
