"""A whole gossip node without sockets, threads and clocks: events and time in, actions out.

The ZeroMQ shell drives it on a robot; a simulation may drive many of them in one process. Not
thread-safe: whoever shares one between threads brings a lock.
"""

from __future__ import annotations

import logging
import os
from collections import Counter, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mocha_link.client import ClientSession, Step
from mocha_link.database import Database, Record
from mocha_link.metrics import LinkBook, LinkEvent, LinkMetrics, MessageStored, RssiChanged
from mocha_link.protocol import ID_BYTES, ServerSession
from mocha_link.publisher import Publisher
from mocha_link.team import UnknownRobotError
from mocha_link.trigger import SyncTrigger

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mocha_link.clock import Instant
    from mocha_link.header import Header
    from mocha_link.reading import Reading
    from mocha_link.team import Team, Topic

TIMEOUT_S = 5.0
STALLED_S = 1.0  # a pull without a byte for so long does not outlive a new contact

LOG = logging.getLogger("mocha_link")


@dataclass(frozen=True, slots=True)
class Dial:
    """Open a fresh connection to a peer, for one pull."""

    peer: str


@dataclass(frozen=True, slots=True)
class Send:
    """Send a request to a peer on the connection that was opened for it."""

    peer: str
    frame: bytes


@dataclass(frozen=True, slots=True)
class HangUp:
    """Close the connection to a peer."""

    peer: str


Action = Dial | Send | HangUp


def _random_id() -> bytes:
    return os.urandom(ID_BYTES)


class Gossip:
    """One robot's node: what it holds, whom it pulls from and when, what it answers."""

    def __init__(
        self,
        team: Team,
        name: str,
        *,
        by_timer: bool,
        timeout_s: float = TIMEOUT_S,
        new_id: Callable[[], bytes] = _random_id,
    ) -> None:
        self.me = team.robot(name)
        self.database = Database()
        self._team = team
        self._timeout_s = timeout_s
        self._new_id = new_id
        self._book = LinkBook(self.me.peers)
        self._trigger = SyncTrigger(self.me.peers, team.trigger, by_timer=by_timer)
        self._publisher = Publisher(self.me, team.topics_of(name), self.database)
        self._servers = {peer: ServerSession(peer, self.database) for peer in self.me.peers}
        self._pulls: dict[str, ClientSession] = {}
        self._actions: deque[Action] = deque()
        self._events: deque[LinkEvent] = deque()
        self._refusals: Counter[str] = Counter()

    def publish(self, topic: Topic, body: bytes, now: Instant, *, at_once: bool = False) -> Header:
        """Take a message of our own; `body` is made by `payload.pack`."""
        record, stored = self._publisher.publish(topic, body, now.unix_s, at_once=at_once)
        if stored:
            self._tell_own(record, now)
        return record.header

    def flush(self, topic: Topic, now: Instant) -> None:
        """Store the message of a topic that waits for its interval, if there is one."""
        record = self._publisher.flush(topic, now.unix_s)
        if record:
            self._tell_own(record, now)

    def heard(self, peer: str, reading: Reading | float | None, now: Instant) -> None:
        """Take in what the radio says of a peer. Raises UnknownRobotError or RadioError."""
        self._check(peer)
        before = self._trigger.reading(peer)
        begins = self._trigger.heard(peer, reading, now.unix_s)
        if self._trigger.reading(peer) != before:
            self._tell_signal(peer, now)
        self._tell_contacts()
        pull = self._pulls.get(peer)
        if begins and pull and now.steady_s - pull.alive_s > STALLED_S:
            # Its connection sleeps in TCP's back-off; a fresh one gets through at once.
            self._take(pull, pull.fail("stalled, and a new contact began", now), now)
        self._pull_due(now)

    def sync(self, peer: str, now: Instant) -> bool:
        """Pull from a peer now; False if a pull is under way. Raises UnknownRobotError."""
        self._check(peer)
        if peer in self._pulls:
            return False
        pull = self._pulls[peer] = ClientSession(
            peer,
            self.me.name,
            team=self._team,
            database=self.database,
            new_id=self._new_id,
            timeout_s=self._timeout_s,
        )
        self._actions.append(Dial(peer))
        self._take(pull, pull.start(now), now)
        return True

    def request(self, peer: str, parts: Sequence[bytes], now: Instant) -> bytes:
        """The reply to what came in on the port for a peer."""
        reply, events = self._servers[peer].answer(parts, now)
        self._book.count(peer, bytes_out=len(reply))
        for event in events:
            self._tell(event)
        return reply

    def reply(self, peer: str, parts: Sequence[bytes], now: Instant) -> None:
        """Take in what came back on the connection to a peer."""
        pull = self._pulls.get(peer)
        if pull:
            self._book.count(peer, bytes_in=sum(map(len, parts)))
            self._take(pull, pull.reply(parts, now), now)

    def progress(self, peer: str, now: Instant) -> None:
        """The connection to a peer stands, or bytes are arriving on it."""
        pull = self._pulls.get(peer)
        if pull:
            pull.progress(now)

    def lost(self, peer: str, reason: str, now: Instant) -> None:
        """The connection to a peer is gone."""
        pull = self._pulls.get(peer)
        if pull:
            self._take(pull, pull.fail(reason, now), now)

    def tick(self, now: Instant) -> None:
        """Do what is due by the time alone; call it often."""
        for peer in self._trigger.silenced(now.unix_s):
            self._tell_signal(peer, now)
        self._tell_contacts()
        for record in self._publisher.due(now.unix_s):
            self._tell_own(record, now)
        for pull in list(self._pulls.values()):
            self._take(pull, pull.tick(now), now)
        for server in self._servers.values():
            for event in server.tick(now):
                self._tell(event)
        self._pull_due(now)

    def take(self) -> tuple[list[Action], list[LinkEvent]]:
        """What is to be done and told since the last call, in order."""
        actions, events = list(self._actions), list(self._events)
        self._actions.clear()
        self._events.clear()
        return actions, events

    def links(self, now: Instant) -> dict[str, LinkMetrics]:
        """The state of every link."""
        ages_s: dict[str, dict[str, float]] = {}
        for record in self.database.records():
            known = self._team.by_ids(record.header.robot_id, record.header.topic_id)
            if known:
                robot, topic = known
                ages_s.setdefault(robot.name, {})[topic.name] = now.unix_s - record.stamp_s
        return self._book.links(now.unix_s, ages_s)

    def _pull_due(self, now: Instant) -> None:
        for peer in self._trigger.due(now.unix_s):
            self.sync(peer, now)

    def _take(self, pull: ClientSession, step: Step, now: Instant) -> None:
        peer = pull.peer
        for frame in step.frames:
            self._actions.append(Send(peer, frame))
        for reason in step.refusals:
            self._refuse(peer, reason)
        if pull.over:
            self._book.measure(peer, rtt_s=pull.rtt_s, bandwidth_bytes_s=pull.bandwidth_bytes_s)
            if self._pulls.pop(peer, None):
                self._actions.append(HangUp(peer))
        for event in step.events:
            self._tell(event)
            if isinstance(event, MessageStored) and event.robot == self.me.name:
                self._recover(self._team.topic(event.robot, event.topic), now)

    def _recover(self, topic: Topic, now: Instant) -> None:
        record = self._publisher.recovered(topic, now.unix_s)
        if record:
            self._tell_own(record, now)

    def _refuse(self, peer: str, reason: str) -> None:
        self._book.count(peer, refused=1)
        first = not self._refusals[peer]
        self._refusals[peer] += 1
        LOG.log(logging.WARNING if first else logging.DEBUG, "refused from %s: %s", peer, reason)

    def _tell_own(self, record: Record, now: Instant) -> None:
        known = self._team.by_ids(record.header.robot_id, record.header.topic_id)
        if known:
            robot, topic = known
            size = len(record.body)
            self._tell(
                MessageStored(robot.name, now.unix_s, robot.name, topic.name, record.header, size)
            )

    def _tell_signal(self, peer: str, now: Instant) -> None:
        rssi_dbm, reading = self._trigger.rssi_dbm(peer), self._trigger.reading(peer)
        self._tell(RssiChanged(peer, now.unix_s, rssi_dbm, reading))

    def _tell_contacts(self) -> None:
        for event in self._trigger.news():
            self._tell(event)

    def _tell(self, event: LinkEvent) -> None:
        self._book.note(event)
        self._events.append(event)

    def _check(self, peer: str) -> None:
        if peer not in self._servers:
            raise UnknownRobotError(peer, self.me.peers, f"among the clients of {self.me.name}")
