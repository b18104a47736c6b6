"""The pulls from one peer, one after the other, and the messages that it pushes between them."""

from __future__ import annotations

from collections.abc import Sequence

from mocha_link.clock import Instant
from mocha_link.datagram import Flow
from mocha_link.links import LinkTable
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import (
    DIALLED,
    FOLLOW_S,
    ID_BYTES,
    LINGER_S,
    Frame,
    Route,
    SendDatagram,
    is_request,
)
from mocha_link.sync.pull import Pull

STALLED_S = 1.0  # a new contact ends a pull without a byte for this long


class Puller:
    """Pulls from one peer on request, and stores the messages that it pushes.

    After a complete pull the node *follows* the peer: the peer pushes new messages on the same
    connection. The next pull reuses an open connection, whichever node opened it. If both nodes
    have opened one, the robot whose name sorts last closes its own.

    Attributes:
        pull: the running pull, if any.
        followed: the pull that has ended, on whose connection the peer pushes.
        followed_sent: ids of the robots that we followed at the last FOLLOW to the peer.
    """

    def __init__(self, peer: Peer, link_table: LinkTable) -> None:
        self.pull: Pull | None = None
        self.followed: Pull | None = None
        self.followed_sent: frozenset[int] = frozenset()
        self.peer = peer
        self._link_table = link_table  # receives the measurements of pulls
        self._lingering: tuple[Flow, float] | None = None  # repeats END until that steady time
        self._connection = peer.connection
        self._crossed = False  # the running pull has moved to a connection of the peer

    def sync(self, now: Instant, over: Route | None = None) -> bool:
        """Begin a pull; False if one is in progress, or the contact's budget is used up.

        `over`: an open connection of the peer, over which the peer pulls from us.
        """
        if self.pull or self.peer.budget.is_spent:
            return False
        self._crossed = False
        connection = self._connection
        own = self.followed is not None and connection.stands
        if over and own and self.peer.node.name > self.peer.name and not connection.shared:
            connection.disconnect(void=False)
            own = False
        if own or over is None:
            self._begin(DIALLED, now, standing=own)
        else:
            self._begin(over, now, standing=True)
        return True

    def expects(self, route: Route, parts: Sequence[Frame]) -> bool:
        """Whether input on a connection of the peer belongs to a pull of ours."""
        if route != self._connection.route or not parts:
            return False
        ids = [pull.id for pull in (self.pull, self.followed) if pull]
        return bytes(parts[0][:ID_BYTES]) in ids and not is_request(parts[0])

    @property
    def has_all(self) -> bool:
        """Whether every message that the peer stores is pushed to us, by it or by its publisher."""
        followed, peer = self.followed, self.peer
        lacking = peer.offers.left or not followed or followed.pull_needed
        return not lacking and self.followed_sent <= peer.node.followed

    def reply(self, parts: Sequence[Frame], now: Instant) -> None:
        """Process a reply on the connection."""
        pull, followed = self.pull, self.followed
        if pull is None or (followed and parts and parts[0][:ID_BYTES] == followed.id):
            pull = followed  # pushed before the peer received the request of the current pull
        if pull:
            self._received(sum(map(len, parts)))
            pull.reply(parts, now)
            self._finish(pull, now)

    def packet(self, packet: bytes, now: Instant) -> None:
        """Process a datagram that the peer sent in reply to ours."""
        pull = self.pull or self.followed
        if pull and pull.flow and packet[1 : 1 + ID_BYTES] == pull.flow.token:
            self._received(len(packet))
            pull.packet(packet, now)
            self._finish(pull, now)
        elif self._lingering:
            flow, _ = self._lingering
            flow.receive(packet, now.steady_s)
            self._transmit(flow, now)

    def progress(self, now: Instant, rtt_s: float | None) -> None:
        """Note that the connection was established or received bytes; its round trip, if known."""
        self._connection.opened()
        if self.pull and self._connection.is_ours:
            self.pull.progress(now)
            if rtt_s is not None:
                self.pull.measured(rtt_s)

    def lost(self, reason: str, now: Instant, route: Route = DIALLED) -> None:
        """Note that a connection was lost."""
        pull = self.pull
        self._connection.lost(route)
        if route != self._connection.route:
            return
        if pull and pull.standing:
            self._begin_afresh(pull, now)
            return
        if pull:
            pull.disconnected(reason, now)
            self._finish(pull, now)
        else:
            self.unfollow()

    def on_contact(self, now: Instant) -> None:
        """Note that a contact begins: do not wait for the timers of a stalled pull."""
        pull = self.pull
        if pull is None or now.steady_s - pull.alive_s <= STALLED_S:
            return
        if pull.path == "udp" and pull.flow:
            pull.flow.on_contact(now.steady_s)
            pull.transmit(now)
        else:
            # Its connection waits in TCP's back-off; a new one is established at once.
            pull.fail("stalled, and a new contact began", now)
            self._finish(pull, now)

    def tick(self, now: Instant, over: Route | None = None, received_s: float = 0.0) -> None:
        """Run the timers; `over`: as for `sync`, with its last input at `received_s`."""
        pull, followed = self.pull, self.followed
        if pull and pull.is_in_vain(now):
            self._begin_afresh(pull, now)
        elif pull and over and self._may_cross(pull, now, received_s):
            self._crossed = True  # we may be unable to connect to the peer, but it reaches us
            self._begin_afresh(pull, now, over)
        elif pull:
            pull.tick(now)
            self._finish(pull, now)
        if followed and followed is self.followed:
            if followed.wake_s is not None and followed.wake_s <= now.steady_s:
                followed.tick(now)
            if now.steady_s - followed.alive_s > FOLLOW_S:
                self.unfollow()
        if self._connection.stands and not (self.pull or self.followed):
            self._connection.disconnect(void=False)
        if self._lingering:
            flow, until_s = self._lingering
            self._transmit(flow, now)
            if flow.settled or now.steady_s > until_s:
                self._lingering = None

    def _may_cross(self, pull: Pull, now: Instant, received_s: float) -> bool:
        return not self._crossed and received_s >= pull.began_s and pull.is_unanswered(now)

    def unfollow(self) -> None:
        """Stop following the peer."""
        followed = self.followed
        self._follow(None)
        if followed and not self.pull:
            self._connection.disconnect(void=True)

    @property
    def wake_s(self) -> float | None:
        """When to call `tick` at the latest, in steady seconds; None: no timer runs."""
        times = [pull.wake_s for pull in (self.pull, self.followed) if pull]
        if self.followed:
            times.append(self.followed.alive_s + FOLLOW_S)
        if self._lingering:
            flow, until_s = self._lingering
            times += [flow.wake_s, until_s]
        return min((each for each in times if each is not None), default=None)

    def _begin(
        self, route: Route, now: Instant, *, standing: bool = False, again: bool = False
    ) -> None:
        same = route == self._connection.route
        self._connection.use(route)
        pull = self.pull = Pull(self.peer, standing=standing, budget=self.peer.budget.pull_bytes)
        if standing and same and self.followed:
            self.followed.hush()
        else:
            # Pushes are not received now, but the pull fetches those messages. The peer counts as
            # followed until the pull fails; otherwise the node would pull from all other peers.
            self.followed = None
        if not standing:
            self._connection.dial()
        pull.start(now, again=again)

    def _begin_afresh(self, pull: Pull, now: Instant, over: Route | None = None) -> None:
        """Continue the pull over another connection after the old one was lost."""
        pull.abandon()
        self._follow(None)
        if over:
            self._connection.disconnect(void=True)
        self._begin(over or DIALLED, now, standing=bool(over), again=True)

    def _received(self, size: int) -> None:
        self.peer.budget.spend(size)
        self.peer.log.received(size)

    def _finish(self, pull: Pull, now: Instant) -> None:
        """Release the running pull if it is over."""
        if not pull.over or pull is not self.pull:
            return
        self._link_table.measure(
            self.peer.name,
            rtt_s=None if pull.broken else pull.rtt_s,  # may be that of an earlier pull
            bandwidth_bytes_s=pull.throughput_bytes_s,
            path=pull.carrier,
        )
        by_datagrams = pull.path == "udp"
        self.pull = None
        self._follow(pull if pull.follows else None)
        if pull.broken or pull.path == "original":
            self._connection.unshare()
        if not pull.follows:
            self._connection.disconnect(void=pull.broken or by_datagrams)
        if pull.flow and by_datagrams and not pull.follows:
            self._transmit(pull.flow, now)
            self._lingering = (pull.flow, now.steady_s + LINGER_S)

    def _follow(self, pull: Pull | None) -> None:
        """Follow the peer after a pull; None: stop following."""
        node = self.peer.node
        robot_id = node.team.robot(self.peer.name).robot_id
        node.reassembly.release(self.peer.name)
        self.followed = pull
        if pull:
            node.followed.add(robot_id)
            self.followed_sent = frozenset(node.followed)
        else:
            node.followed.discard(robot_id)

    def _transmit(self, flow: Flow, now: Instant) -> None:
        for packet in flow.transmit(now.steady_s):
            self.peer.node.actions.append(SendDatagram(self.peer.name, packet))
