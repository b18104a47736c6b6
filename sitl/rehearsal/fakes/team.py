"""The robots of a rehearsal, and the UAV's node that meets them: no sockets, simulated time."""

from __future__ import annotations

import math
import random
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from typing import Final

from air_router.messages import GOALS_TOPIC, POSE_TOPIC, GoalsMessage, PoseMessage
from air_router.mission import Mission
from geo.frame import LocalFrame, Point
from mocha_link import Message
from mocha_link.links import (
    NO_SIGNAL,
    ContactBegan,
    ContactEnded,
    Direction,
    LinkEvent,
    LinkMetrics,
    MessageStored,
    Reading,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
    Unit,
)
from mocha_link.store import Header
from mocha_link.team import Priority, Robot, Team
from sitl.rehearsal.judge import SceneEventKind

RADIO_RANGE_M: Final = 60.0
SYNC_EVERY_S: Final = 2.0
HASTY_S: Final = 0.2
"""So often a hostile robot hands its position over."""

_SIZE: Final = 100
_TAKES_S, _BREAKS = (0.5, 9.0), 0.15
"""How long one direction of an exchange over a weak link takes, and the share that never ends."""

_FALSE_S, _FALSE_DBM = 15.0, -45.0
"""So often a weak radio reports a robot, wherever that is, and so strongly."""

_SWAYS_M: Final = 30.0
"""So far to either side of its true position a hostile robot reports itself, in turn."""

_DRIVES_M, _DRIVES_M_S, _CARRIED_S = 25.0, (0.2, 1.2), 30.0
"""How far up and down robots of weak links drive, how fast, and how old what they carry is."""

_AWAY_M, _CHOICES = 60.0, 3
"""How far a robot drives that drives away, and among how many waypoints it chooses."""

CarriedMessage = tuple[str, str, bytes]
"""A message: which robot made it, topic, data."""


@dataclass(eq=False)
class NodeStandIn:
    """What `air_router.gossip.gossip.Gossip` uses of a `mocha_link.Node`.

    Attributes:
        team: Who there is.
        name: Whose node it is.
        unix_s: The time.
    """

    team: Team
    name: str
    unix_s: Callable[[], float]
    _listener: Callable[[LinkEvent], None] | None = None  # the flight's; None: closed
    _messages: dict[tuple[str, str], Message] = field(default_factory=dict)  # by robot and topic

    @property
    def robot(self) -> Robot:
        """The UAV."""
        return self.team.robot(self.name)

    def subscribe(self, callback: Callable[[LinkEvent], None]) -> None:
        """Hand events to `callback`."""
        self._listener = callback

    def start(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """No listener is called after it."""
        self._listener = None

    def publish(self, topic: str, data: bytes, *, now: bool = False) -> None:
        """It is not read here."""

    def sync(self, peer: str, *, both: bool = False) -> bool:
        """The rehearsal decides when robots are met."""
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

    def notify(self, event: LinkEvent) -> None:
        """Report an event of a link to the flight."""
        if self._listener is not None:
            self._listener(event)

    def take(self, peer: str, messages: Sequence[CarriedMessage]) -> None:
        """A peer hands messages over."""
        now_s = self.unix_s()
        for robot, topic, data in messages:
            header = Header.at(0, 0, round(now_s * 1e3))
            stored = Message(robot, topic, header, Priority.HIGH, data, now_s, now_s)
            self._messages[(robot, topic)] = stored
            self.notify(MessageStored(peer, now_s, robot, topic, header, _SIZE))


Prank = Callable[[str, Point], list[CarriedMessage]]
"""The messages of a mad robot (robot, topic, data), by its name and true place."""


@dataclass(slots=True, eq=False)
class _Sync:
    """One direction of an exchange that is under way, and when it ends (infinite: never)."""

    robot: str
    direction: Direction
    began_s: float
    ends_s: float


@dataclass(eq=False)
class Robots:
    """Robots that stand about and are received from near by.

    Attributes:
        mission: Of the UAV that meets them.
        places: Where they are; one that is taken out has vanished.
        unix_s: The time.
        happened: Called, for the judge, for each that hands its messages over, and for each
            direction of an exchange that is over.
        weak: Random generator of weak links: exchanges take long, or never end, radios far away are
            received; robots drive, and carry others' messages. None: links are good, robots stand.
        prank: False messages that they send; None: the truth.
        others: Messages of other robots that they carry.
        forged: What they hand over of others before their own, made as they do.
        radio_range_m: From no farther they are received.
        carry: They carry each other's poses, too.
        hostile: They hand their positions over all the time, and take nothing.
    """

    mission: Mission
    places: dict[str, Point]
    unix_s: Callable[[], float]
    happened: Callable[[SceneEventKind, object], None]
    weak: random.Random | None = None
    prank: Prank | None = None
    others: list[CarriedMessage] = field(default_factory=list)
    forged: list[Callable[[], CarriedMessage]] = field(default_factory=list)
    radio_range_m: float = RADIO_RANGE_M

    def __post_init__(self) -> None:
        weak = self.weak
        self.carry = weak is not None
        self.hostile = False
        self._synced_s = dict.fromkeys(self.places, -math.inf)  # simulated, by robot
        self._speeds_m_s = {n: weak.uniform(*_DRIVES_M_S) if weak else 0.0 for n in self.places}
        self._under_way: list[_Sync] = []
        self._node: NodeStandIn | None = None  # that took part in these
        self._false_at_s = _FALSE_S  # when a radio that is not there is received next

    def step(self, node: NodeStandIn, vehicle: Point, now_s: float) -> None:
        """Meet whom the vehicle is near to."""
        if node is not self._node:
            self._node, self._under_way = node, []
        if self.weak is not None and now_s >= self._false_at_s:
            self._false_at_s = now_s + _FALSE_S
            name = self.weak.choice(list(self._synced_s))  # it is reported near, for a moment
            reading = Reading(_FALSE_DBM, Unit.DBM, "radio")
            node.notify(ContactBegan(name, self.unix_s(), reading))
            node.notify(ContactEnded(name, self.unix_s(), 1.0, NO_SIGNAL))
        for name in self.places:
            near = math.dist(self._place(name, now_s), vehicle) <= self.radio_range_m
            every_s = HASTY_S if self.hostile else SYNC_EVERY_S
            due = now_s - self._synced_s[name] >= every_s
            if near and due and not any(sync.robot == name for sync in self._under_way):
                self._synced_s[name] = now_s
                for direction in (Direction.IN,) if self.hostile else Direction:
                    self._under_way.append(_Sync(name, direction, now_s, self._ends_s(now_s)))
                    node.notify(SyncStarted(name, self.unix_s(), direction))
            if any(sync.robot == name for sync in self._under_way):
                self._go_on(node, name, now_s, near=near)

    def do_goals(self, which: tuple[bool, float]) -> None:
        """A robot, one that the mission names or another one, sends goals by all that meet it."""
        named, seed = which
        mission, rng = self.mission, random.Random(seed)  # noqa: S311 - rehearsal
        others = tuple(robot for robot in self._synced_s if robot not in mission.goals_from)
        robot = rng.choice((named and mission.goals_from) or others)
        places = [mission.frame.to_geodetic(w.position) for w in mission.waypoints]
        now_s = self.unix_s()
        goals = GoalsMessage(
            stamp_s=now_s,
            id=f"{seed}",
            points=tuple(rng.sample(places, rng.choice((1, 1, 2)))),
            hold_s=2.0,
            to=rng.choice((None, mission.uav, "another")),
            until_s=rng.choice((None, now_s + 1000.0, now_s - 10.0)),
        )
        self.others = [carried for carried in self.others if carried[:2] != (robot, GOALS_TOPIC)]
        self.others.append((robot, GOALS_TOPIC, goals.encode()))

    def do_drive_away(self, what: tuple[int, float]) -> None:
        """The robot whose turn it is drives to another waypoint, the nearest that is far enough."""
        turn, seed = what
        if not self.places:
            return
        rng = random.Random(seed)  # noqa: S311 - rehearsal
        name = list(self.places)[turn % len(self.places)]
        here = self.places[name]
        away = [w.position for w in self.mission.waypoints]
        away.sort(key=lambda place: abs(math.dist(place, here) - _AWAY_M))
        self.places[name] = rng.choice(away[:_CHOICES])

    def _ends_s(self, now_s: float) -> float:
        """When one direction of an exchange that begins now is over."""
        if self.weak is None:
            return now_s
        return math.inf if self.weak.random() < _BREAKS else now_s + self.weak.uniform(*_TAKES_S)

    def _go_on(self, node: NodeStandIn, name: str, now_s: float, *, near: bool) -> None:
        for sync in [sync for sync in self._under_way if sync.robot == name]:
            if near and now_s < sync.ends_s and now_s - sync.began_s < _TAKES_S[1]:
                continue
            self._under_way.remove(sync)
            if not near or now_s < sync.ends_s:
                node.notify(SyncTimedOut(name, self.unix_s(), sync.direction, "out of reach"))
                continue
            carried: list[CarriedMessage] = []
            if sync.direction is Direction.IN:
                of_others = (make() for make in self.forged)
                carried = [message for message in of_others if message[0] != name]
                carried += self._messages_of(name, self._place(name, now_s), now_s) + self.others
                node.take(name, carried)
            value = (name, sync.direction.value, sync.began_s, carried)
            self.happened(SceneEventKind.SYNCED, value)
            node.notify(SyncEnded(name, self.unix_s(), sync.direction, 1, _SIZE, 0.1))

    def _place(self, name: str, now_s: float) -> Point:
        east_m, north_m = self.places[name]
        along_m = (self._speeds_m_s[name] * now_s) % (2 * _DRIVES_M)
        return Point(east_m + min(along_m, 2 * _DRIVES_M - along_m), north_m)

    def _messages_of(self, name: str, place: Point, now_s: float) -> list[CarriedMessage]:
        if self.prank is not None:
            return self.prank(name, place)
        frame, unix_s = self.mission.frame, self.unix_s()
        old_s = _CARRIED_S if self.weak else 0.0
        carried = []
        for robot in self.places if self.carry else (name,):
            age_s = 0.0 if robot == name else old_s
            at = self._place(robot, now_s - age_s)
            carried.append((robot, POSE_TOPIC, pose(frame, at, unix_s - age_s)))
        return carried


def pose(frame: LocalFrame, place: Point, stamp_s: float) -> bytes:
    """A robot's message of where it is."""
    latitude_deg, longitude_deg = frame.to_geodetic(place)
    message = PoseMessage(
        stamp_s=stamp_s, latitude_deg=latitude_deg, longitude_deg=longitude_deg, heading_deg=0.0
    )
    return message.encode()


def anywhere(rng: random.Random, waypoints: list[Point]) -> Point:
    """A place near one of the mission's waypoints."""
    east_m, north_m = rng.choice(waypoints)
    return Point(east_m + rng.uniform(-30.0, 30.0), north_m + rng.uniform(-30.0, 30.0))


def prank_of(how: str, mission: Mission, rng: random.Random, unix_s: Callable[[], float]) -> Prank:
    """The false positions of a mad robot."""
    frame = mission.frame
    sides: defaultdict[str, Iterator[float]] = defaultdict(lambda: cycle((_SWAYS_M, -_SWAYS_M)))

    def carried(name: str, place: Point) -> list[CarriedMessage]:
        match how:
            case "sway":
                to = Point(place.east_m + next(sides[name]), place.north_m)
                data = pose(frame, to, unix_s())
            case "future":
                data = pose(frame, place, 9.9e10)
            case "stamp":
                data = pose(frame, place, unix_s() + rng.choice((-1e6, -3600.0, 60.0, 1e5, 1e7)))
            case "nan":
                data = b'{"stamp_s": NaN, "latitude_deg": NaN, "longitude_deg": 1e999}'
            case "jump":
                to = Point(rng.uniform(-900.0, 900.0), rng.uniform(-900.0, 900.0))
                data = pose(frame, to, unix_s())
            case "zone":
                inside = rng.choice(mission.zones).polygon.representative_point()
                data = pose(frame, Point(inside.x, inside.y), unix_s())
            case _:
                north_deg, east_deg = frame.to_geodetic(place)
                away = rng.choice(((-33.0, 151.0), (north_deg + 0.3, east_deg)))
                far = dict(zip(("latitude_deg", "longitude_deg"), away, strict=True))
                data = str({"stamp_s": unix_s(), **far}).replace("'", '"').encode()
        return [(name, POSE_TOPIC, data)]

    return carried
