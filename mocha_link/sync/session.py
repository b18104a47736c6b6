"""All that is exchanged with one peer: our pulls from it, and its pulls from us.

Nothing here touches sockets: what came in is handed over, what goes out is an action or `supply`.
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
    """Hands what comes from one peer to our pull from it or to its pull from us.

    Args:
        link_table: where bytes, refusals and measurements are noted.
        both_ways: the peer pulls over our connection, and we over its.

    Attributes:
        peer: it.
    """

    def __init__(self, peer: Peer, link_table: LinkTable, *, both_ways: bool = True) -> None:
        self.peer = peer
        self._puller = Puller(peer, link_table)
        self._server = Server(peer)
        self._link_table = link_table
        self._both_ways = both_ways
        self._closed: Route | None = None  # the peer's connection over which we pulled, if closed

    # --- what the node wants

    def sync(self, now: Instant, *, both: bool = False, renews: bool = False) -> bool:
        """Pull from the peer; False if a pull is under way, or the contact's budget is used up.

        `both`: the peer pulls, too. `renews`: it counts as a contact of its own.
        """
        if both:
            self._server.request_pull()
        if renews and not self.pulls:
            self.peer.budget.renew()
        return self._puller.sync(now, self._over)

    def on_contact(self, now: Instant) -> None:
        """A contact begins: what stalls goes on at once."""
        self.peer.budget.renew()
        self._server.on_contact(now)
        self._transmit(now)
        self._puller.on_contact(now)

    def contact_ended(self) -> None:
        """The peer is out of reach: nothing that it pushes gets here."""
        self.peer.connection.unshare()
        self._puller.unfollow()

    # --- what comes from the sockets

    def request(self, route: Route, parts: Sequence[bytes], now: Instant) -> None:
        """Take in what came in on a connection for the peer."""
        if self._puller.expects(route, parts):
            self._puller.reply(parts, now)
            return
        if is_reply(parts):
            return  # to a pull that has gone over to another connection
        reply = self._server.handle(route, parts, now)
        if reply is not None:
            self._link_table.count(self.peer.name, bytes_out=len(reply))
            self.peer.node.actions.append(Reply(self.peer.name, route, reply))
        self._transmit(now)

    def reply(self, parts: Sequence[Frame], now: Instant) -> None:
        """Take in what came back on the connection to the peer, or a request of the peer there."""
        if self._both_ways and len(parts) == 1 and is_request(parts[0]):
            self.request(DIALLED, [bytes(parts[0])], now)
        elif self.peer.connection.is_ours:
            self._puller.reply(parts, now)
        # Else it is of a pull that has gone over to a connection of the peer.

    def packet(self, packet: bytes, now: Instant) -> bool:
        """Process a datagram at the peer's port; whether to reply to its source address."""
        is_there = self._server.packet(packet, now)
        self._transmit(now)
        return is_there

    def packet_back(self, packet: bytes, now: Instant) -> None:
        """Process a datagram that the peer sent in reply to ours."""
        self._puller.packet(packet, now)

    def progress(self, now: Instant, rtt_s: float | None) -> None:
        """The connection to the peer stands, or bytes arrive on it; its round trip, if known."""
        self._puller.progress(now, rtt_s)

    def lost(self, reason: str, now: Instant) -> None:
        """The connection to the peer was lost."""
        self._server.lost(DIALLED)
        self._puller.lost(reason, now)

    def route(self, standing: Callable[[Route], Standing | None]) -> Route | None:
        """The connection on which the peer pulls, if it does, and if that is still `standing`."""
        way = self.peer.connection.route
        if way != DIALLED:
            found = standing(way)
            if found is None:
                self._closed = way
            elif found.rtt_s is not None:
                self.peer.path.measured(found.rtt_s)
        return self._server.route(standing)

    # --- what goes out

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
        """Run the timers of the peer's pull, and send it what is due and what is new."""
        self._server.tick(now)
        self._transmit(now)

    @property
    def wake_s(self) -> float | None:
        """When the time brings something, in steady seconds; None: it does not."""
        wakes_s = (self._puller.wake_s, self._server.wake_s)
        return min((each for each in wakes_s if each is not None), default=None)

    # --- how it stands

    @property
    def pulls(self) -> bool:
        """Whether a pull of ours is under way."""
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
