"""The configuration that all robots share: who they are, where they listen, what they say.

Ids and ports follow from the file exactly as in the original MOCHA nodes, so every robot must use
the same file: robot_id = index in the sorted names; topic_id = position in the list of the kind;
dtype = index of the first occurrence in the sorted list of the types of all topics of all kinds
(with repetitions); the port that a peer dials = base_port + index of the peer in ``clients``.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Self

from mocha_link.errors import MochaLinkError, NotInTeamError
from mocha_link.team.document import Document, DocumentError, as_yaml
from mocha_link.team.team_file import RobotModel, TeamModel, TriggerModel, problems_of

Ros = Literal[1, 2]
"""How ROS messages are serialized: as ROS 1, or as ROS 2 (CDR)."""


class UnknownRobotError(NotInTeamError):
    """A name that is not a robot of the team, or not a robot that is linked to the asking one."""

    def __init__(self, name: str, known: Mapping[str, Any] | tuple[str, ...], where: str) -> None:
        names = ", ".join(sorted(known)) or "none"
        super().__init__(f"no robot '{name}' {where}; use one of {names}")


class UnknownTopicError(MochaLinkError):
    """A topic that the robot does not have in the team file."""

    def __init__(self, robot: Robot, name: str, known: tuple[Topic, ...]) -> None:
        names = ", ".join(topic.name for topic in known) or "none"
        super().__init__(
            f"{robot.name} ({robot.kind}) has no topic '{name}'; "
            f"use one of {names}, or add it to the team file"
        )


class Priority(enum.IntEnum):
    """How urgent a topic is; more urgent messages of a robot are exchanged first."""

    NONE = 0
    LOW = 1
    MEDIUM = 2
    HIGH = 3


class Trust(enum.Enum):
    """Who may hand on whose messages: any robot of the team, or only what its maker signed."""

    RELAYS = "relays"
    SIGNED = "signed"


@dataclass(frozen=True, slots=True)
class Topic:
    """One kind of message of a robot.

    The newest `history` messages are kept and carried (original nodes carry the newest only).
    With `aggregate` the messages within `min_interval_s` go together; without, the newest of them.
    """

    name: str
    topic_id: int  # index in the list of its kind
    type: str  # package/Type
    dtype: int  # index of its type; see the module
    priority: Priority
    min_interval_s: float
    history: int = 1
    aggregate: bool = False


@dataclass(frozen=True, slots=True)
class Robot:
    """One robot of the team. `address` is what others dial, `listen` what its node binds.

    `clients` are in the order of the ports; None keeps a port unused. `radio_id` is by what the
    radios of others know it (MAC address, serial number). `key` is its public Ed25519 key in Z85.
    `original`: it runs the original MOCHA node. `ros`: how its ROS messages are serialized, 1 (as
    ROS 1) or 2 (CDR). `datum`: where the origin of the local frame of its ROS messages lies:
    latitude and longitude in degrees, and by how much x is turned from east, counterclockwise.
    """

    name: str
    robot_id: int  # index in the sorted names
    kind: str
    address: str
    base_port: int  # the first of its clients' ports
    listen: str
    clients: tuple[str | None, ...]
    radio: str | None = None  # URL of where its readings come from
    radio_id: str | None = None
    key: str | None = None
    original: bool = False
    ros: Ros = 1
    datum: tuple[float, ...] | None = None

    @property
    def peers(self) -> tuple[str, ...]:
        """The robots that it exchanges messages with: its clients without itself."""
        return tuple(name for name in self.clients if name not in (None, self.name))

    def port_for(self, peer: str) -> int:
        """The port on which this robot answers `peer`. Raises UnknownRobotError."""
        if peer not in self.peers:
            raise UnknownRobotError(peer, self.peers, f"among the clients of {self.name}")
        return self.base_port + self.clients.index(peer)


@dataclass(frozen=True, slots=True)
class Trigger:
    """When a node pulls from a peer: in contact (by RSSI) at once, then every `interval_s`.

    A robot without a radio tries every `interval_s`. In contact means a signal at or above the
    threshold for its unit; the contact ends `hysteresis_db` below it. `budget_bytes` is what a node
    takes in from a peer in one contact; None: no limit.
    """

    rssi_threshold_dbm: float = -75.0
    snr_threshold_db: float = 10.0
    device_threshold: float = 20.0  # in the radio's own unit
    hysteresis_db: float = 3.0
    interval_s: float = 2.0
    budget_bytes: int | None = None


@dataclass(frozen=True, slots=True)
class Team:
    """All robots and topics, with the ids that the wire format uses for them.

    `definitions` are the texts of message definitions (``.msg``) that the team brings along.
    """

    robots: Mapping[str, Robot]  # by name, in the order of ids
    kinds: Mapping[str, tuple[Topic, ...]]  # topics of each kind
    trigger: Trigger
    trust: Trust
    definitions: Mapping[str, str]
    path: Path
    _by_id: tuple[Robot, ...] = field(repr=False)  # robots in the order of their ids

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a team file. Raises DocumentError with every problem of the file."""
        return cls.from_document(Document.load(path))

    @classmethod
    def from_document(cls, document: Document) -> Self:
        """Build the team from a loaded document. Raises DocumentError."""
        model = document.parse(TeamModel)
        problems = list(problems_of(document, model))
        if problems:
            raise DocumentError(problems)
        types = sorted(topic.type for kind in model.kinds.values() for topic in kind.topics)
        kinds = {
            name: tuple(
                Topic(
                    name=topic.name,
                    topic_id=topic_id,
                    type=topic.type,
                    dtype=types.index(topic.type),
                    priority=Priority[topic.priority.upper()],
                    min_interval_s=topic.min_interval_s,
                    history=topic.history,
                    aggregate=topic.aggregate,
                )
                for topic_id, topic in enumerate(kind.topics)
            )
            for name, kind in model.kinds.items()
        }
        ids = {name: robot_id for robot_id, name in enumerate(sorted(model.robots))}
        robots = {
            name: Robot(
                name=name,
                robot_id=ids[name],
                kind=robot.kind,
                address=robot.address,
                base_port=robot.base_port,
                listen=robot.listen,
                clients=tuple(robot.clients),
                radio=robot.radio,
                radio_id=robot.radio_id,
                key=robot.key,
                original=robot.original,
                ros=robot.ros,
                datum=None if robot.datum is None else tuple(robot.datum),
            )
            for name, robot in model.robots.items()
        }
        return cls(
            robots=MappingProxyType(robots),
            kinds=MappingProxyType(kinds),
            trigger=Trigger(**model.trigger.model_dump()),
            trust=Trust(model.trust),
            definitions=MappingProxyType(model.definitions),
            path=document.path,
            _by_id=tuple(robots[name] for name in sorted(robots)),
        )

    def robot(self, name: str) -> Robot:
        """The robot of that name. Raises UnknownRobotError, which lists the known ones."""
        if name not in self.robots:
            raise UnknownRobotError(name, self.robots, f"in {self.path}")
        return self.robots[name]

    def topics_of(self, name: str) -> tuple[Topic, ...]:
        """The topics of a robot, in the order of their ids. Raises UnknownRobotError."""
        return self.kinds[self.robot(name).kind]

    def topic(self, robot: str, name: str) -> Topic:
        """One topic of a robot. Raises UnknownRobotError or UnknownTopicError."""
        topics = self.topics_of(robot)
        for topic in topics:
            if topic.name == name:
                return topic
        raise UnknownTopicError(self.robot(robot), name, topics)

    def by_ids(self, robot_id: int, topic_id: int) -> tuple[Robot, Topic] | None:
        """Who and what the ids of a header stand for; None if the team does not know them."""
        if robot_id not in range(len(self._by_id)):
            return None
        robot = self._by_id[robot_id]
        topics = self.kinds[robot.kind]
        return (robot, topics[topic_id]) if topic_id in range(len(topics)) else None

    def history(self, robot_id: int, topic_id: int) -> int:
        """How many versions of a topic the robots keep; 1 of one that the team does not know."""
        known = self.by_ids(robot_id, topic_id)
        return known[1].history if known else 1

    def pushed(self, pusher: Robot, peer: str) -> frozenset[int]:
        """Ids of the robots whose messages `pusher` hands a peer at once.

        Its own, and those of robots that are not linked to the peer: what several could push would
        cross every link of a neighbourhood.
        """
        others = (r for r in self.robots.values() if r.name != peer and peer not in r.peers)
        return frozenset(robot.robot_id for robot in (pusher, *others))

    def with_robots(self, changes: Mapping[str, Mapping[str, Any]]) -> Team:
        """The team with other values for some robots, e.g. ``{"io": {"base_port": 24100}}``.

        Raises:
            UnknownRobotError: a name that is not in the team (a new robot would move the ids).
            DocumentError: the changed team would not be valid.
        """
        data = self._data()
        for name, values in changes.items():
            robot = self.robot(name)
            data["robots"][robot.name].update(
                {key: list(v) if isinstance(v, tuple) else v for key, v in values.items()}
            )
        return Team.from_document(Document.from_text(as_yaml(data), self.path))

    def dump(self) -> str:
        """The team as the text of a team file."""
        return as_yaml(self._data())

    def _data(self) -> dict[str, Any]:
        robot_keys = [key for key in RobotModel.model_fields if key != "clients"]
        return {
            "robots": {
                name: {
                    **{key: getattr(robot, key) for key in robot_keys},
                    "clients": list(robot.clients),
                }
                for name, robot in self.robots.items()
            },
            "kinds": {
                name: {
                    "topics": [
                        {
                            "name": topic.name,
                            "type": topic.type,
                            "priority": topic.priority.name.lower(),
                            "min_interval_s": topic.min_interval_s,
                            "history": topic.history,
                            "aggregate": topic.aggregate,
                        }
                        for topic in topics
                    ]
                }
                for name, topics in self.kinds.items()
            },
            "trigger": {key: getattr(self.trigger, key) for key in TriggerModel.model_fields},
            "trust": self.trust.value,
            "definitions": dict(self.definitions),
        }
