"""A whole gossip node without sockets, threads and clocks: events and time in, actions out.

`Transport` drives it on a robot; a simulation may drive many of them in one process. It is not
thread-safe: a program that shares one between threads must use a lock.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

from mocha_link.clock import Instant
from mocha_link.links import (
    QUIET_CONTACT_S,
    SILENT_INTERVALS,
    ContactEnded,
    Direction,
    LinkEvent,
    LinkMetrics,
    LinkTable,
    MessageStored,
    Reading,
    SyncStarted,
    SyncTrigger,
)
from mocha_link.node.peer_link import PeerLink, PeerLinks
from mocha_link.node.publisher import Publisher, Sign
from mocha_link.store import (
    Database,
    Header,
    Record,
    config_hash_of,
    definitions_of,
    difference,
)
from mocha_link.sync import (
    TRIAL_BOOT_ID,
    Action,
    Connect,
    Disconnect,
    Frame,
    NodeContext,
    Route,
    Standing,
    random_boot_id,
    random_id,
)
from mocha_link.team import Team, Topic, UnknownRobotError

TIMEOUT_S = 5.0
UNGUARDED = nullcontext()


class Gossip:
    """One robot's node: its database, its pulls and their timers, its replies.

    Args:
        by_timer: pull from all peers every interval; otherwise only while the radio receives them.
        timeout_s: seconds without a byte after which a pull is aborted.
        new_id: makes the 6 random bytes that identify a request.
        database: stores the messages; default: in memory.
        sign: makes the signature of a message of a topic; None: messages are not signed.
        datagrams: whether the transport has datagram sockets.
        follow: receive the messages that a peer stores between two pulls at once.
        protected: peers to which the links are encrypted.
        both_ways: peers pull over our connections, and we over theirs.
        trial: it runs beside the robot's own node, and does not count as a duplicate.

    Attributes:
        me: this node's robot.
        database: its messages.
    """

    def __init__(  # noqa: PLR0913 - all optional parts
        self,
        team: Team,
        name: str,
        *,
        by_timer: bool,
        timeout_s: float = TIMEOUT_S,
        new_id: Callable[[], bytes] = random_id,
        database: Database | None = None,
        sign: Sign | None = None,
        datagrams: bool = True,
        follow: bool = True,
        protected: Collection[str] = (),
        both_ways: bool = True,
        trial: bool = False,
    ) -> None:
        self.me = team.robot(name)
        self.database = database or Database(team.histories)
        self._team = team
        self._by_timer = by_timer
        quiet_s = max(QUIET_CONTACT_S, SILENT_INTERVALS * team.trigger.interval_s)
        self._link_table = LinkTable(self.me.peers, name, quiet_s=quiet_s, protected=protected)
        self._trigger = SyncTrigger(self.me.peers, team.trigger, by_timer=by_timer)
        self._publisher = Publisher(self.me, team.topics_of(name), self.database, sign)
        self._context = NodeContext(
            name=name,
            team=team,
            database=self.database,
            new_id=new_id,
            config_hash=config_hash_of(team),
            definitions=definitions_of(team),
            timeout_s=timeout_s,
            follow=follow,
            boot_id=TRIAL_BOOT_ID if trial else random_boot_id(),
        )
        self._links = PeerLinks(
            self._context, self.me, self._link_table, datagrams=datagrams, both_ways=both_ways
        )
        self._events: list[LinkEvent] = []  # for listeners
        self._uncounted: list[LinkEvent] = []  # not passed to the link table yet
        self._sequence = 0  # of the database at the last push to peers

    # --- the robot's own messages

    def publish(
        self,
        topic: Topic,
        data: bytes,
        now: Instant,
        *,
        at_once: bool = False,
        frame: bytes | None = None,
    ) -> Header:
        """Publish a message of our own; `frame`: its compressed data, if any.

        Raises PayloadError.
        """
        header, stored = self._publisher.publish(
            topic, data, now.unix_s, at_once=at_once, frame=frame
        )
        for record in stored:
            self._announce_own(record, now)
        return header

    def flush(self, topic: Topic, now: Instant) -> None:
        """Store the message of a topic that waits for its interval, if there is one."""
        self._announce_own(self._publisher.flush(topic, now.unix_s), now)

    # --- input of the radio and the program

    def signal_received(self, peer: str, reading: Reading | float | None, now: Instant) -> None:
        """Process a signal report of the radio. Raises UnknownRobotError or RadioError."""
        link = self._link(peer)
        begins = self._trigger.signal_received(peer, reading, now.timer_s)
        self._announce_contacts(now)
        if begins:
            link.session.on_contact(now)
            self._announce(link, now)
        self._pull_due(now)

    def sync(self, peer: str, now: Instant, *, both: bool = False) -> bool:
        """Pull from a peer now; `both`: request that the peer also pulls. Raises UnknownRobotError.

        Returns False if a pull is in progress, or the contact's budget is used up.
        """
        link = self._link(peer)
        begun = link.session.sync(now, both=both, renews=self._by_timer)
        self._announce(link, now)
        return begun

    # --- input from the sockets

    def request(self, peer: str, route: Route, parts: Sequence[bytes], now: Instant) -> None:
        """Process a request on a connection to the port of a peer."""
        link = self._link(peer)
        link.session.request(route, parts, now)
        self._announce(link, now)

    def route(
        self, peer: str, standing: Callable[[Route], Standing | None] = lambda _route: Standing()
    ) -> Route | None:
        """The connection on which the peer pulls; None: it does not, or the connection is closed.

        `standing`: the kernel's measurements of a connection; None: it is closed.
        """
        session = self._links.by_peer[peer].session
        route = session.route(standing)
        if session.closed:
            self._links.touched.add(peer)
        return route

    def supply(self, peer: str) -> tuple[Route, list[Frame]] | None:
        """The next frame of a sync for a connection of the peer, in parts; None: nothing now."""
        return self._links.by_peer[peer].session.supply()

    def packet_in(self, peer: str, packet: bytes, now: Instant) -> bool:
        """Process a datagram at the port of a peer; whether to reply to its source address."""
        link = self._link(peer)
        accepted = link.session.packet(packet, now)
        self._announce(link, now)
        return accepted

    def reply(self, peer: str, parts: Sequence[Frame], now: Instant) -> None:
        """Process a reply on the connection to a peer, or a request that the peer sent on it."""
        link = self._link(peer)
        link.session.reply(parts, now)
        self._announce(link, now)

    def packet_back(self, peer: str, packet: bytes, now: Instant) -> None:
        """Process a datagram that a peer sent in reply to ours."""
        link = self._link(peer)
        link.session.packet_back(packet, now)
        self._announce(link, now)

    def progress(self, peer: str, now: Instant, rtt_s: float | None = None) -> None:
        """Note that the connection to a peer was established, or received bytes."""
        self._link(peer).session.progress(now, rtt_s)

    def leaves(self, peer: str) -> bool:
        """Whether the transport still has to close or replace the connection to a peer.

        Its input must be dropped: it belongs to an earlier pull.
        """
        actions = self._context.actions
        return any(a.peer == peer and isinstance(a, Connect | Disconnect) for a in actions)

    def lost(self, peer: str, reason: str, now: Instant) -> None:
        """Note that the connection to a peer was lost."""
        link = self._link(peer)
        link.session.lost(reason, now)
        self._announce(link, now)

    def refused(self, peer: str, reason: str) -> None:
        """Note that the port of a peer refused a connection or an invalid message."""
        self._link_table.refuse(peer, reason)

    def announce(self, event: LinkEvent) -> None:
        """Deliver an event of the program to the listeners."""
        self._events.append(event)
        self._uncounted.append(event)

    # --- timers, actions and events

    def tick(self, now: Instant, guard: AbstractContextManager[object] = UNGUARDED) -> set[str]:
        """Run the timers; call it at `wake_s`, in `due_in_s`, and after input.

        `guard` encloses the work for each peer. Returns the peers for which `supply` may have a
        frame.
        """
        self._trigger.expire_signals(now.timer_s)
        self._announce_contacts(now)
        for record in self._publisher.due(now.unix_s):
            self._announce_own(record, now)
        busy = self._links.busy(now.steady_s)
        for link in busy:
            with guard:
                link.session.tick(now)
                self._announce(link, now)
        if self.database.sequence != self._sequence:
            robots = {each.header.robot_id for each in self.database.since(self._sequence)}
            self._sequence = self.database.sequence
            self._links.stored(robots)
            busy = self._links.busy(now.steady_s)
        for link in busy:
            with guard:
                link.session.serve(now)
                self._announce(link, now)
        self._pull_due(now)
        self._count(now)
        self._links.settle()
        return {link.peer.name for link in busy}

    @property
    def wake_s(self) -> float | None:
        """When to call `tick` at the latest, in steady seconds; None: no timer runs."""
        return self._links.wake_s

    def due_in_s(self, now: Instant) -> float:
        """The seconds until `tick` has to store a message or begin a pull; inf: nothing is due."""
        return min(self._trigger.due_s - now.timer_s, self._publisher.due_s - now.unix_s)

    def take(self) -> tuple[list[Action], list[LinkEvent]]:
        """The actions and events since the last call, in order."""
        actions, events = list(self._context.actions), self._events
        self._context.actions.clear()
        self._events = []
        return actions, events

    def links(
        self, now: Instant, ages_s: Mapping[str, Mapping[str, float]] | None = None
    ) -> dict[str, LinkMetrics]:
        """The state of every link; `ages_s`: the result of `ages_s`, if just computed."""
        self._count(now)
        return self._link_table.links(now.unix_s, self.ages_s(now) if ages_s is None else ages_s)

    def ages_s(self, now: Instant) -> dict[str, dict[str, float]]:
        """The ages of the newest messages by peer and topic; any thread may call it."""
        return self._links.ages_s(now.unix_s)

    def held(self, peer: str) -> dict[int, int]:
        """The messages that a peer is known to hold; see `PeerHoldings.newest`.

        Raises UnknownRobotError.
        """
        return self._link(peer).peer.holdings.newest

    def _count(self, now: Instant) -> None:
        """Update the link table."""
        for name in self._links.touched:
            peer = self._links.by_peer[name].peer
            if bytes_in := peer.log.take_bytes_in():
                self._link_table.count(name, bytes_in=bytes_in)
        events, self._uncounted = self._uncounted, []
        self._link_table.catch_up(events, now)

    def _pull_due(self, now: Instant) -> None:
        if self._links.push_otherwise():
            self._trigger.follow(link.peer.name for link in self._links if link.pushes)
        for peer in self._trigger.due(now.timer_s):
            self.sync(peer, now)

    def _announce(self, link: PeerLink, now: Instant) -> None:
        """Announce the events of a peer's syncs."""
        peer = link.peer
        for reason in peer.log.take_refusals():
            self._link_table.refuse(peer.name, reason)
        known_hash = peer.agreement.known_hash if peer.agreement.config_mismatch else 0
        if known_hash != link.known_hash:
            link.known_hash = known_hash
            link.differs = None
            if known_hash:
                link.differs = difference(self._team, peer.name, peer.agreement.definitions)
            self._link_table.compare_teams(self.me.name, peer.name, now, link.differs)
        elif link.differs:
            self._link_table.compare_teams(self.me.name, peer.name, now, link.differs)
        process = peer.process
        twice = peer.name if process.duplicate else self.me.name if process.duplicated else None
        self._link_table.duplicate(self.me.name, peer.name, now, twice)
        for event in peer.log.take_events():
            self.announce(event)
            if isinstance(event, SyncStarted) and event.direction is Direction.OUT:
                restarted = peer.process.take_restarted()
                self._trigger.peer_pulled(peer.name, now.timer_s, restarted=restarted)
            if isinstance(event, MessageStored) and event.robot == self.me.name:
                topic = self._team.topic(event.robot, event.topic)
                self._announce_own(self._publisher.recovered(topic, now.unix_s), now)

    def _announce_own(self, record: Record | None, now: Instant) -> None:
        known = record and self._team.by_ids(record.header.robot_id, record.header.topic_id)
        if record and known:
            name, topic = self.me.name, known[1].name
            size = len(record.body)
            self.announce(MessageStored(name, now.unix_s, name, topic, record.header, size))

    def _announce_contacts(self, now: Instant) -> None:
        for event in self._trigger.take_events():
            self.announce(replace(event, at_s=now.unix_s))
            if isinstance(event, ContactEnded):
                link = self._link(event.peer)
                link.session.contact_ended()
                self._announce(link, now)

    def _link(self, peer: str) -> PeerLink:
        """The link of a peer that sent something. Raises UnknownRobotError."""
        if peer not in self._links.by_peer:
            raise UnknownRobotError(peer, self.me.peers, f"among the clients of {self.me.name}")
        self._links.touched.add(peer)
        return self._links.by_peer[peer]
