"""The team of a run, and each robot's gossip node: `mocha_link`'s own, without sockets and threads.

Topics and priorities are those of the authors' simulations: pose and claimed goals are of high
priority, the path of medium, reachability of low, the map of objects of none. Whom a UAV seeks, and
where the base station stands, are published besides.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

from air_router.messages import MAP_TOPIC, PATH_TOPIC, POSE_TOPIC, SEEK_TOPIC, PoseMessage
from mocha_link.clock import Instant
from mocha_link.links import NO_SIGNAL, ContactBegan, ContactEnded, LinkEvent, MessageStored
from mocha_link.node import Gossip
from mocha_link.store import wire
from mocha_link.sync import ID_BYTES, Action
from mocha_link.team import Document, Robot, Team, as_yaml
from sitl.experiment import EventQueue
from sitl.world.explorers import (
    CLAIMS_TOPIC,
    OBJECTS_TOPIC,
    POLICY_TOPIC,
    REACHABILITY_TOPIC,
    degrees,
)
from sitl.world.towns import Town

EPOCH_S: Final = 26_000 * 65_536 + 3_600.0
"""Unix seconds at the beginning of a run: no header's time wraps within 17 hours of it."""

REFRESH_S: Final = 1.0
"""A robot publishes at most so often; and nothing while no peer requests, since only the newest
message of a topic is ever exchanged."""

BASE: Final = "base"

_KINDS: Final = {
    "uav": "aerial_robot",
    "ugv": "ground_robot",
    BASE: "base_station",
}
_TOPICS: Final = {
    "uav": (
        (MAP_TOPIC, "grid/SemanticMap", "high"),
        (POSE_TOPIC, "json/Pose", "none"),
        (SEEK_TOPIC, "json/Seek", "medium"),
    ),
    "ugv": (
        (POSE_TOPIC, "json/Pose", "high"),
        (CLAIMS_TOPIC, "json/ClaimedGoals", "high"),
        (PATH_TOPIC, "json/Path", "medium"),
        (REACHABILITY_TOPIC, "grid/SemanticMap", "low"),
        (OBJECTS_TOPIC, "json/Sightings", "none"),
        (POLICY_TOPIC, "json/Policy", "medium"),
    ),
    BASE: (
        ("/target_goals", "json/TargetGoals", "high"),
        (POSE_TOPIC, "json/Pose", "none"),
    ),
}
"""Name, type and priority of what each kind of robot publishes, as often as it likes.

The paper's base station may give goals; ours knows of none, and never publishes on that topic.
"""


@dataclass(frozen=True, slots=True)
class Fleet:
    """Who takes part.

    Attributes:
        team: As the nodes need it.
        uavs: Names of the UAVs, the explorer first.
        ugvs: Names of the ground robots.
        base: Name of the base station, if there is one.
    """

    team: Team
    uavs: tuple[str, ...]
    ugvs: tuple[str, ...]
    base: str | None

    @property
    def names(self) -> tuple[str, ...]:
        """All robots in the order of their numbers, which is that of their names."""
        return tuple(sorted(self.team.robots))

    @property
    def kinds(self) -> tuple[str, ...]:
        """What each of them is: "uav", "ugv" or "base"."""
        kinds = dict.fromkeys(self.uavs, "uav") | dict.fromkeys(self.ugvs, "ugv")
        return tuple(kinds.get(name, "base") for name in self.names)


_ID_ROBOTS: Final = 256
"""So many robots a header's first byte distinguishes."""

_ID_TOPICS: Final = 8
"""So many topics a robot may have, where the second byte distinguishes robots, too."""


class _WholeTeam(Team):
    """A team in which every robot is linked to every other one."""

    def pushed(self, pusher: Robot, peer: str) -> frozenset[int]:  # noqa: ARG002 - a team's
        """A robot's own messages: there is none whose messages a peer could not have from it."""
        return frozenset({pusher.robot_id})

    @classmethod
    def of(cls, one: Team, kinds: Mapping[str, str], *, original: bool) -> _WholeTeam:
        """A team of any size.

        What a header has for robot and topic are two bytes. Here robots are numbered by both: robot
        number n has the id n modulo 256, and its topics' ids begin at 8 times n / 256. So headers
        and all that is sent are as long as in a team of 256, and no two topics are taken for each
        other. What counts by a robot's id alone (whose messages are pushed) is for all robots of
        that id together.

        Args:
            one: A team with the kinds' topics.
            kinds: The kind of each robot by its name, sorted by name.
            original: Their nodes are original ones.
        """
        names = tuple(kinds)
        blocks = range((len(names) - 1) // _ID_ROBOTS + 1)
        topics = {
            f"{kind} {block}": tuple(
                topic.model_copy(update={"topic_id": topic.topic_id + _ID_TOPICS * block})
                for topic in one.kinds[kind]
            )
            for kind in one.kinds
            for block in blocks
        }
        robots = {
            name: Robot.model_construct(
                name=name,
                robot_id=number % _ID_ROBOTS,
                kind=f"{_KINDS[kinds[name]]} {number // _ID_ROBOTS}",
                address=f"10.{number // _ID_ROBOTS}.{number % _ID_ROBOTS}.1",
                base_port=20_000,
                clients=names,
                original=original,
            )
            for number, name in enumerate(names)
        }
        own = ("trigger", "trust", "definitions", "path", "model")
        return cls(robots, topics, **{key: getattr(one, key) for key in own})


@lru_cache(maxsize=16)
def fleet_of(uavs: int, ugvs: int, *, base: bool, original: bool) -> Fleet:
    """A team in which every robot may talk to every other one.

    One of more than 256 robots is no team that a file could have: see `_WholeTeam.of`.
    """
    aerial = tuple(f"uav{number:02d}" for number in range(1, uavs + 1))
    ground = tuple(f"ugv{number:02d}" for number in range(1, ugvs + 1))
    kinds = dict.fromkeys((BASE,) if base else (), BASE)
    kinds |= dict.fromkeys(aerial, "uav") | dict.fromkeys(ground, "ugv")
    if len(kinds) > _ID_ROBOTS:
        small = fleet_of(1, 1, base=True, original=original).team
        own = {name: kinds[name] for name in sorted(kinds)}
        team = _WholeTeam.of(small, own, original=original)
        return Fleet(team, aerial, ground, BASE if base else None)
    robots = {
        name: {
            "kind": _KINDS[kinds[name]],
            "address": f"10.0.{number}.1",
            "base_port": 20_000,
            "clients": [other for other in sorted(kinds) if other != name],
            "original": original,
        }
        for number, name in enumerate(sorted(kinds))
    }
    topics = {
        _KINDS[kind]: {
            "topics": [
                {"name": name, "type": what, "priority": priority, "min_interval_s": 0}
                for name, what, priority in own
            ]
        }
        for kind, own in _TOPICS.items()
    }
    document = Document.from_text(as_yaml({"robots": robots, "kinds": topics}), Path("fleet.yaml"))
    return Fleet(Team.from_document(document), aerial, ground, BASE if base else None)


def base_messages(town: Town, queue: EventQueue) -> list[tuple[str, bytes]]:
    """What a base station sends to a peer on request: where it stands, which is at home."""
    pose = PoseMessage(stamp_s=EPOCH_S + queue.now_s, **degrees(town.frame, town.home))
    return [(POSE_TOPIC, pose.encode())]


class Node:
    """A node, and what its robot does with it.

    Args:
        number: Of the robot in the run.
        name: Its name in the team.
        queue: The clock.
        triggered: Its own trigger begins pulls, and pulls that are over follow.
        publish: Returns what the robot publishes: (topic, data), at most one per topic.
        receive: Delivers the link events to the robot.
    """

    def __init__(  # noqa: PLR0913 - what connects a robot with others
        self,
        number: int,
        name: str,
        team: Team,
        queue: EventQueue,
        *,
        triggered: bool = False,
        publish: Callable[[], list[tuple[str, bytes]]] = list,
        receive: Callable[[LinkEvent], None] = lambda _event: None,
    ) -> None:
        self.number = number
        self.name = name
        ids = itertools.count(number << 32)
        self.gossip = Gossip(
            team,
            name,
            by_timer=False,
            new_id=lambda: next(ids).to_bytes(ID_BYTES),
            datagrams=False,
            follow=triggered,
            both_ways=False,  # the channel's model is of pulls, each in one direction
        )
        self.triggered = triggered  # else pulls are begun for it
        self._received_dbm = team.trigger.rssi_threshold_dbm  # what its radio reads in a contact
        self._queue = queue
        self._publish = publish
        self._receive = receive
        self._topics = {topic.name: topic for topic in team.topics_of(name)}  # that it may publish
        self._fresh_s = -REFRESH_S  # simulated time at which its robot published last

    @property
    def now(self) -> Instant:
        """The present, as the node sees it."""
        return Instant(EPOCH_S + self._queue.now_s, self._queue.now_s)

    def refresh(self) -> None:
        """A peer is about to receive what is new: let the robot publish first."""
        if self._queue.now_s - self._fresh_s >= REFRESH_S:
            self._fresh_s = self._queue.now_s
            for topic, data in self._publish():
                self.publish(topic, data)

    def publish(self, topic: str, data: bytes) -> None:
        """Put a message into the database; topics that the team does not have are left out."""
        known = self._topics.get(topic)
        if known is not None:
            self.gossip.publish(known, data, self.now, at_once=True)

    def exchange(self, peer: str | None) -> None:
        """The UAV hovers over a robot: both pull, as with `air_router.gossip.gossip.Gossip`."""
        if self.triggered and peer in self.gossip.me.peers:
            self.gossip.sync(peer, self.now, both=True)

    def contact(self, peer: str, began_s: float, *, up: bool) -> None:
        """The radio receives a peer, or not any more: notify the robot, as with a real radio."""
        at_s = self.now.unix_s
        if self.triggered:
            self.gossip.signal_received(peer, self._received_dbm if up else None, self.now)
        elif up:
            self._receive(ContactBegan(peer, at_s, None))
        else:
            self._receive(ContactEnded(peer, at_s, self._queue.now_s - began_s, NO_SIGNAL))

    def take(self) -> tuple[list[Action], list[LinkEvent]]:
        """What the node wants done, and the events that it delivered to its robot."""
        actions, events = self.gossip.take()
        for event in events:
            self._receive(event)
        return actions, events

    def data_of(self, event: MessageStored) -> bytes:
        """The message that an event is about."""
        record = self.gossip.database.get(event.header)
        return b"" if record is None else wire.unpack(record.body)
