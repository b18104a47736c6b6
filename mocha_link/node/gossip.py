"""A whole gossip node without sockets, threads and clocks: events and time in, actions out.

The ZeroMQ shell drives it on a robot; a simulation may drive many of them in one process. Not
thread-safe: a program that shares one between threads brings a lock.
"""

from __future__ import annotations

import logging
import os
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial

from mocha_link.clock import Instant
from mocha_link.links.link_events import (
    ContactEnded,
    LinkEvent,
    MessageStored,
    RssiChanged,
    StorageFailed,
    StorageRecovered,
)
from mocha_link.links.metrics import QUIET_S, LinkMetrics, LinkTable
from mocha_link.links.reading import Reading
from mocha_link.links.trigger import SILENT_INTERVALS, SyncTrigger
from mocha_link.node.publisher import Publisher
from mocha_link.store.config_hash import config_hash_of, difference
from mocha_link.store.database import Database
from mocha_link.store.reassembly_buffer import ReassemblyBuffer
from mocha_link.store.record import Header, Record
from mocha_link.store.signature import Signer, Verifier
from mocha_link.sync.actions import (
    Action,
    Connect,
    Disconnect,
    Reply,
    ReplyDatagram,
)
from mocha_link.sync.frames import Frame, Step
from mocha_link.sync.peer_state import PeerState
from mocha_link.sync.protocol import ID_BYTES
from mocha_link.sync.pull import PullContext
from mocha_link.sync.puller import Puller
from mocha_link.sync.server import Route, Server
from mocha_link.team.team import Team, Topic, Trust, UnknownRobotError

TIMEOUT_S = 5.0
BOOT_ID_BYTES = 8
REMIND_S = 600.0  # so often the log repeats that a peer has another team file

LOG = logging.getLogger("mocha_link")


def _random_id() -> bytes:
    return os.urandom(ID_BYTES)


class Gossip:
    """One robot's node: what it holds, whom it pulls from and when, what it answers.

    Args:
        by_timer: pull from all peers every interval; otherwise when the radio hears them.
        timeout_s: seconds without a byte after which a pull breaks off.
        new_id: makes the 6 random bytes that name a request.
        database: where messages are kept; default: in memory.
        signer: signs what the robot publishes.
        datagrams: whether there are sockets for them.
        follow: take in at once what a peer stores between two pulls.
    """

    def __init__(  # noqa: PLR0913 - what a node may be given
        self,
        team: Team,
        name: str,
        *,
        by_timer: bool,
        timeout_s: float = TIMEOUT_S,
        new_id: Callable[[], bytes] = _random_id,
        database: Database | None = None,
        signer: Signer | None = None,
        datagrams: bool = True,
        follow: bool = True,
        protected: Iterable[str] = (),
    ) -> None:
        self.me = team.robot(name)  # this node's robot
        history = team.history
        self.database = database or Database(history)
        self._team = team
        self._by_timer = by_timer
        verifier = Verifier(team)
        keyless = not any(robot.key for robot in team.robots.values())
        verifies = team.trust is Trust.SIGNED or not keyless
        quiet_s = max(QUIET_S, SILENT_INTERVALS * team.trigger.interval_s)
        self._link_table = LinkTable(self.me.peers, quiet_s=quiet_s)
        for peer in protected:
            self._link_table.measure(peer, protected=True)
        self._trigger = SyncTrigger(self.me.peers, team.trigger, by_timer=by_timer)
        self._publisher = Publisher(
            self.me, team.topics_of(name), self.database, signer.of if signer else None
        )
        self._pull_context = PullContext(
            own=name,
            team=team,
            database=self.database,
            reassembly=ReassemblyBuffer(
                keeper=self.database.keeper, saved=self.database.take_parts()
            ),
            new_id=new_id,
            timeout_s=timeout_s,
            follow=follow,
        )
        boot_id = int.from_bytes(os.urandom(BOOT_ID_BYTES), "big")
        config_hash = config_hash_of(team)
        # state of each peer
        self._known = {peer: PeerState(boot_id, history, config_hash) for peer in self.me.peers}
        self._differs = dict.fromkeys(self.me.peers, False)  # whose team file is another one
        self._warned_s: dict[str, float] = {}  # of that
        self._servers = {  # by peer
            peer: Server(peer, self.database, self._known[peer], pushed=team.pushed(self.me, peer))
            for peer in self.me.peers
        }
        self._actions: deque[Action] = deque()  # for the transport
        self._events: deque[LinkEvent] = deque()  # for listeners
        self._refusals: Counter[str] = Counter()  # by peer; the first is logged
        self._sequence = -1  # of the database, when peers were last pushed what is new
        self._pullers = {  # by peer
            peer: Puller(
                peer,
                self._pull_context,
                self._known[peer],
                verify=partial(verifier.verify, handed_by=peer) if verifies else None,
                original=team.robot(peer).original,
                datagrams=datagrams,
                budget_bytes=team.trigger.budget_bytes or 0,
                link_table=self._link_table,
                act=self._actions.append,
                tell=self._tell_step,
            )
            for peer in self.me.peers
        }

    def publish(
        self,
        topic: Topic,
        data: bytes,
        now: Instant,
        *,
        at_once: bool = False,
        frame: bytes | None = None,
    ) -> Header:
        """Take a message of our own, compressed to `frame` perhaps. Raises PayloadError."""
        header, stored = self._publisher.publish(
            topic, data, now.unix_s, at_once=at_once, frame=frame
        )
        for record in stored:
            self._tell_own(record, now)
        return header

    def flush(self, topic: Topic, now: Instant) -> None:
        """Store the message of a topic that waits for its interval, if there is one."""
        self._tell_own(self._publisher.flush(topic, now.unix_s), now)

    def heard(self, peer: str, reading: Reading | float | None, now: Instant) -> None:
        """Take in what the radio says of a peer. Raises UnknownRobotError or RadioError."""
        self._check(peer)
        before = self._trigger.reading(peer)
        begins = self._trigger.heard(peer, reading, now.unix_s)
        if self._trigger.reading(peer) != before:
            self._tell_signal(peer, now)
        self._tell_contacts()
        if begins:
            self._pullers[peer].renew_budget()
            self._servers[peer].on_contact(now)
            self._after_server(peer, now)
            self._pullers[peer].on_contact(now)
        self._pull_due(now)

    def sync(self, peer: str, now: Instant) -> bool:
        """Pull from a peer now; False if a pull is under way. Raises UnknownRobotError.

        Nothing begins either when the contact's budget is used up.
        """
        self._check(peer)
        if self._by_timer and not self._pullers[peer].pull:
            self._pullers[peer].renew_budget()
        return self._pullers[peer].sync(now)

    def request(self, peer: str, route: Route, parts: Sequence[bytes], now: Instant) -> None:
        """Take in what came in on the port for a peer."""
        server = self._servers[peer]
        reply = server.answer(route, parts, now)
        if reply is not None:
            self._link_table.count(peer, bytes_out=len(reply))
            self._actions.append(Reply(peer, route, reply))
        self._after_server(peer, now)

    def route(self, peer: str) -> Route | None:
        """The connection on which the peer pulls, if it does."""
        return self._servers[peer].route

    def supply(self, peer: str) -> tuple[Route, list[Frame]] | None:
        """The next frame of a sync for a connection of the peer, in parts; None: nothing now."""
        supplied = self._servers[peer].supply()
        if supplied:
            self._link_table.count(peer, bytes_out=sum(map(len, supplied[1])))
        return supplied

    def packet_in(self, peer: str, packet: bytes, now: Instant) -> bool:
        """Take in a datagram that came to the port for a peer; says whether it made sense."""
        known = self._servers[peer].packet(packet, now)
        self._after_server(peer, now)
        return known

    def reply(self, peer: str, parts: Sequence[Frame], now: Instant) -> None:
        """Take in what came back on the connection to a peer."""
        self._pullers[peer].reply(parts, now)

    def packet_back(self, peer: str, packet: bytes, now: Instant) -> None:
        """Take in a datagram that a peer sent in answer to ours."""
        self._pullers[peer].packet(packet, now)

    def progress(self, peer: str, now: Instant, rtt_s: float | None = None) -> None:
        """The connection to a peer stands, or bytes arrive on it; its round trip, if known."""
        self._pullers[peer].progress(now, rtt_s)

    def leaves(self, peer: str) -> bool:
        """Whether the connection to a peer is to be closed or replaced, once the transport does it.

        Nothing more of it must be handed in: the peer's pull may be another one already.
        """
        return any(a.peer == peer and isinstance(a, Connect | Disconnect) for a in self._actions)

    def lost(self, peer: str, reason: str, now: Instant) -> None:
        """The connection to a peer is gone."""
        self._pullers[peer].lost(reason, now)

    def refused(self, peer: str, reason: str) -> None:
        """A connection was not let in at the port for a peer, or sent what is no message."""
        self._refuse(peer, reason)

    def storage(self, reason: str | None, now: Instant) -> None:
        """Messages are not written to disk any more (why), or are again (None)."""
        if reason is None:
            self._emit(StorageRecovered(self.me.name, now.unix_s))
        else:
            self._emit(StorageFailed(self.me.name, now.unix_s, reason))

    def save(self, now: Instant) -> None:
        """Hand to the storage what has come in part; at the end."""
        self._pull_context.reassembly.save(now.steady_s, at_once=True)

    def tick(self, now: Instant) -> None:
        """Do what is due by the time alone; call it often, and at `wake_s`."""
        self._pull_context.reassembly.save(now.steady_s)
        for peer in self._trigger.silenced(now.unix_s):
            self._tell_signal(peer, now)
        self._tell_contacts()
        for record in self._publisher.due(now.unix_s):
            self._tell_own(record, now)
        for puller in self._pullers.values():
            puller.tick(now)
        stored, self._sequence = self.database.sequence != self._sequence, self.database.sequence
        for peer, server in self._servers.items():
            server.tick(now)
            if stored or server.is_due(now):
                self._after_server(peer, now)
        self._pull_due(now)

    @property
    def wake_s(self) -> float | None:
        """When to call `tick` at the latest, in steady seconds; None: no hurry."""
        times = [puller.wake_s for puller in self._pullers.values()]
        times += [server.wake_s for server in self._servers.values()]
        return min((each for each in times if each is not None), default=None)

    @property
    def pulling(self) -> list[str]:
        """The peers from which a pull is under way."""
        return [peer for peer, puller in self._pullers.items() if puller.pull]

    @property
    def due_s(self) -> float:
        """When, in Unix seconds, `tick` has to store or to begin something; inf: nothing waits."""
        return min(self._trigger.due_s(self._followed()), self._publisher.due_s)

    @property
    def is_busy(self) -> bool:
        """Whether a sync is under way: call `tick` often then."""
        pulling = any(puller.is_busy for puller in self._pullers.values())
        return pulling or any(server.is_busy for server in self._servers.values())

    def take(self) -> tuple[list[Action], list[LinkEvent]]:
        """What is to be done and told since the last call, in order."""
        actions, events = list(self._actions), list(self._events)
        self._actions.clear()
        self._events.clear()
        return actions, events

    def links(
        self, now: Instant, ages_s: Mapping[str, Mapping[str, float]] | None = None
    ) -> dict[str, LinkMetrics]:
        """The state of every link; `ages_s` is what `ages_s` has answered just now."""
        return self._link_table.links(now.unix_s, self.ages_s(now) if ages_s is None else ages_s)

    def ages_s(self, now: Instant) -> dict[str, dict[str, float]]:
        """The ages of the newest messages by peer and topic; any thread may ask at any time."""
        return {peer: dict(self._ages_s(peer, now)) for peer in self.me.peers}

    def held(self, peer: str) -> dict[tuple[int, int], int]:
        """What a peer is known to hold; see `PeerState.newest`."""
        self._check(peer)
        return self._known[peer].newest

    def _ages_s(self, peer: str, now: Instant) -> Iterator[tuple[str, float]]:
        robot_id = self._team.robot(peer).robot_id
        for topic in self._team.topics_of(peer):
            record = self.database.newest(robot_id, topic.topic_id)
            if record:
                yield topic.name, now.unix_s - record.stamp_s

    def _pull_due(self, now: Instant) -> None:
        for peer in self._trigger.due(now.unix_s, self._followed()):
            self.sync(peer, now)

    def _followed(self) -> set[str]:
        """The peers that push what they store."""
        return {peer for peer, puller in self._pullers.items() if puller.followed}

    def _tell_step(self, peer: str, step: Step, now: Instant) -> None:
        """Tell what a step of a pull has brought."""
        for reason in step.refusals:
            self._refuse(peer, reason)
        self._compare_config(peer, now)
        for event in step.events:
            self._emit(event)
            if isinstance(event, MessageStored) and event.robot == self.me.name:
                topic = self._team.topic(event.robot, event.topic)
                self._tell_own(self._publisher.recovered(topic, now.unix_s), now)

    def _after_server(self, peer: str, now: Instant) -> None:
        server = self._servers[peer]
        for packet in server.transmit(now):
            self._link_table.count(peer, bytes_out=len(packet))
            self._actions.append(ReplyDatagram(peer, packet))
        for event in server.take():
            self._emit(event)
        self._compare_config(peer, now)

    def _compare_config(self, peer: str, now: Instant) -> None:
        """Say it when a peer turns out to have another team file, and at times once more."""
        differs = self._known[peer].config_mismatch
        if differs != self._differs[peer]:
            self._differs[peer] = differs
            self._link_table.measure(peer, team_differs=differs)
        warned_s = self._warned_s.get(peer)
        if differs and (warned_s is None or now.steady_s - warned_s > REMIND_S):
            self._warned_s[peer] = now.steady_s
            LOG.warning("%s: nothing is exchanged: %s", self.me.name, difference(peer))

    def _refuse(self, peer: str, reason: str) -> None:
        self._link_table.count(peer, refused=1)
        first = not self._refusals[peer]
        self._refusals[peer] += 1
        LOG.log(logging.WARNING if first else logging.DEBUG, "refused from %s: %s", peer, reason)

    def _tell_own(self, record: Record | None, now: Instant) -> None:
        known = record and self._team.by_ids(record.header.robot_id, record.header.topic_id)
        if record and known:
            robot, topic = known
            size = len(record.body)
            self._emit(
                MessageStored(robot.name, now.unix_s, robot.name, topic.name, record.header, size)
            )

    def _tell_signal(self, peer: str, now: Instant) -> None:
        rssi_dbm, reading = self._trigger.rssi_dbm(peer), self._trigger.reading(peer)
        self._emit(RssiChanged(peer, now.unix_s, rssi_dbm, reading))

    def _tell_contacts(self) -> None:
        for event in self._trigger.news():
            self._emit(event)
            if isinstance(event, ContactEnded):
                self._pullers[event.peer].unfollow()

    def _emit(self, event: LinkEvent) -> None:
        self._link_table.update(event)
        self._events.append(event)

    def _check(self, peer: str) -> None:
        if peer not in self._servers:
            raise UnknownRobotError(peer, self.me.peers, f"among the clients of {self.me.name}")
