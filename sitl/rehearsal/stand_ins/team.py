"""The robots of a rehearsal, and the UAV's node that meets them: no sockets, simulated time."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from typing import Final

from air_router.messages import POSE_TOPIC, PoseMessage
from air_router.mission.mission import Mission
from geo.frame import LocalFrame, Point
from mocha_link import Message
from mocha_link.links.metrics import (
    Direction,
    LinkEvent,
    LinkMetrics,
    MessageStored,
    SyncEnded,
    SyncStarted,
)
from mocha_link.store.wire import Header
from mocha_link.team.team import Priority, Robot, Team

HEARD_M: Final = 60.0
SYNC_EVERY_S: Final = 2.0
_SIZE: Final = 100


class NodeStandIn:
    """What `air_router.gossip.gossip.Gossip` uses of a `mocha_link.Node`.

    Args:
        team: Who there is.
        name: Whose node it is.
        unix_s: The time.
    """

    def __init__(self, team: Team, name: str, unix_s: Callable[[], float]) -> None:
        self._team = team
        self._name = name
        self._unix_s = unix_s
        self._listener: Callable[[LinkEvent], None] | None = None  # the flight's; None: closed
        self._messages: dict[tuple[str, str], Message] = {}  # by robot and topic

    @property
    def robot(self) -> Robot:
        """The UAV."""
        return self._team.robot(self._name)

    def subscribe(self, callback: Callable[[LinkEvent], None]) -> None:
        """Hand events to `callback`."""
        self._listener = callback

    def start(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """No listener hears of anything after it."""
        self._listener = None

    def publish(self, topic: str, data: bytes, *, now: bool = False) -> None:
        """It is not read here."""

    def sync(self, peer: str, *, both: bool = False) -> bool:
        """Robots are met when the rehearsal says so."""
        del peer, both
        return False

    def links(self) -> Mapping[str, LinkMetrics]:
        """Nothing is measured here."""
        return {}

    def held(self, peer: str) -> dict[tuple[str, str], float]:
        """Nor known of what peers hold."""
        del peer
        return {}

    def latest(self, robot: str, topic: str) -> Message | None:
        """The newest message of a topic of a robot."""
        return self._messages.get((robot, topic))

    def messages(self) -> list[Message]:
        """All of them."""
        return list(self._messages.values())

    def meet(self, peer: str, messages: list[tuple[str, str, bytes]]) -> None:
        """A peer hands over messages (robot, topic, data) in a sync both ways."""
        if self._listener is None:
            return
        now_s = self._unix_s()
        for direction in Direction:
            self._listener(SyncStarted(peer, now_s, direction))
        for robot, topic, data in messages:
            header = Header.at(0, 0, round(now_s * 1e3))
            stored = Message(robot, topic, header, Priority.HIGH, data, now_s, now_s)
            self._messages[(robot, topic)] = stored
            self._listener(MessageStored(peer, now_s, robot, topic, header, _SIZE))
        for direction in Direction:
            self._listener(SyncEnded(peer, now_s, direction, 1, _SIZE, 0.1))


Prank = Callable[[str, Point], list[tuple[str, str, bytes]]]
"""What a mad robot tells (robot, topic, data) of a name and a true place."""


class Robots:
    """Robots that stand about and are heard from near by.

    Args:
        frame: The mission's.
        places: Where they are.
        unix_s: The time.
        met: Told of each that hands its messages over.

    Attributes:
        places: Where they are; one that is taken out has vanished.
        prank: What they tell instead of the truth; None: the truth.
        others: Messages of other robots that they carry.
        carry: They carry each other's newest poses, too.
    """

    def __init__(
        self,
        frame: LocalFrame,
        places: dict[str, Point],
        unix_s: Callable[[], float],
        met: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._frame = frame
        self._met = met
        self._unix_s = unix_s
        self._synced_s = dict.fromkeys(places, -math.inf)  # simulated, by robot
        self.places = places
        self.prank: Prank | None = None
        self.others: list[tuple[str, str, bytes]] = []
        self.carry = False

    def step(self, node: NodeStandIn, vehicle: Point, now_s: float) -> None:
        """Meet whom the vehicle is near to."""
        for name, place in self.places.items():
            near = math.dist(place, vehicle) <= HEARD_M
            if near and now_s - self._synced_s[name] >= SYNC_EVERY_S:
                self._synced_s[name] = now_s
                told = self._told(name, place) if self.prank is None else self.prank(name, place)
                self._met(name)
                node.meet(name, told + self.others)

    def _told(self, name: str, place: Point) -> list[tuple[str, str, bytes]]:
        places = self.places if self.carry else {name: place}
        return [(n, POSE_TOPIC, pose(self._frame, at, self._unix_s())) for n, at in places.items()]


def pose(frame: LocalFrame, place: Point, stamp_s: float) -> bytes:
    """A robot's message of where it is."""
    latitude_deg, longitude_deg = frame.to_geodetic(place)
    message = PoseMessage(
        stamp_s=stamp_s, latitude_deg=latitude_deg, longitude_deg=longitude_deg, heading_deg=0.0
    )
    return message.encode()


def anywhere(dice: random.Random, waypoints: list[Point]) -> Point:
    """A place near one of the mission's waypoints."""
    east_m, north_m = dice.choice(waypoints)
    return Point(east_m + dice.uniform(-30.0, 30.0), north_m + dice.uniform(-30.0, 30.0))


def prank_of(how: str, mission: Mission, dice: random.Random, unix_s: Callable[[], float]) -> Prank:
    """What a mad robot tells instead of where it is."""
    frame = mission.frame

    def told(name: str, place: Point) -> list[tuple[str, str, bytes]]:
        match how:
            case "future":
                data = pose(frame, place, 9.9e10)
            case "stamp":
                data = pose(frame, place, unix_s() + dice.choice((-1e6, -3600.0, 60.0, 1e5, 1e7)))
            case "nan":
                data = b'{"stamp_s": NaN, "latitude_deg": NaN, "longitude_deg": 1e999}'
            case "jump":
                to = Point(dice.uniform(-900.0, 900.0), dice.uniform(-900.0, 900.0))
                data = pose(frame, to, unix_s())
            case "zone":
                inside = dice.choice(mission.zones).polygon.representative_point()
                data = pose(frame, Point(inside.x, inside.y), unix_s())
            case _:
                far = {"latitude_deg": -33.0, "longitude_deg": 151.0, "heading_deg": 1.0}
                data = str({"stamp_s": unix_s(), **far}).replace("'", '"').encode()
        return [(name, POSE_TOPIC, data)]

    return told
