"""The configuration that all robots share: robots, addresses and topics.

Ids and ports follow from the file exactly as in the original MOCHA nodes, so every robot must use
the same file: robot_id = index in the sorted names; topic_id = position in the list of the kind;
dtype = index of the first occurrence in the sorted list of the types of all topics of all kinds
(with repetitions); the port that a peer dials = base_port + index of the peer in ``clients``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from mocha_link.errors import MochaLinkError, NotInTeamError
from mocha_link.team.document import Document, DocumentError, Problem, as_yaml
from mocha_link.team.team_file import (
    IDS,
    PortRange,
    Priority,
    RobotModel,
    Ros,
    TeamModel,
    TopicModel,
    Trigger,
    Trust,
)

__all__ = [
    "Priority",
    "Robot",
    "Ros",
    "Team",
    "Topic",
    "Trigger",
    "Trust",
    "UnknownRobotError",
    "UnknownTopicError",
]


class UnknownRobotError(NotInTeamError):
    """A name that is not a robot of the team, or a robot without a link to this one."""

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


class Topic(TopicModel, frozen=True):
    """One kind of message of a robot, with the ids that follow from the file."""

    topic_id: int  # index in the list of its kind
    dtype: int  # index of its type; see the module


class Robot(RobotModel, frozen=True):
    """One robot of the team, with its name and id."""

    name: str
    robot_id: int  # index in the sorted names

    @property
    def peers(self) -> tuple[str, ...]:
        """The robots with which this robot exchanges messages: its clients without itself."""
        return tuple(name for name in self.clients if name not in (None, self.name))

    @property
    def shown_address(self) -> str:
        """Its address as text for the operator."""
        return self.address or "mDNS"

    def port_for(self, peer: str) -> int:
        """The port on which this robot serves a peer.

        Args:
            peer: the name of a linked robot.

        Returns:
            The TCP and UDP port number.

        Raises:
            UnknownRobotError: the peer is not among the robot's clients.
        """
        if peer not in self.peers:
            raise UnknownRobotError(peer, self.peers, f"among the clients of {self.name}")
        return self.base_port + self.clients.index(peer)


@dataclass(frozen=True, slots=True)
class Team:
    """All robots and topics, with the ids that the wire format uses for them.

    `definitions` are the texts of message definitions (``.msg``) in the team file. The key of a
    topic of a robot is robot id * 256 + topic id, the first two bytes of a header.
    """

    robots: Mapping[str, Robot]  # by name, in the order of ids
    kinds: Mapping[str, tuple[Topic, ...]]  # topics of each kind
    trigger: Trigger
    trust: Trust
    definitions: Mapping[str, str]
    path: Path
    model: TeamModel = field(repr=False)  # as the file has it, with what it leaves out
    topics_by_key: Mapping[int, tuple[Robot, Topic]] = field(init=False, repr=False)
    histories: Mapping[int, int] = field(init=False, repr=False)  # versions kept, by topic key
    _unlinked: Mapping[str, frozenset[int]] = field(init=False, repr=False)  # ids, by name

    def __post_init__(self) -> None:
        topics = {
            robot.robot_id << 8 | topic.topic_id: (robot, topic)
            for robot in self.robots.values()
            for topic in self.kinds[robot.kind]
        }
        histories = {key: topic.history for key, (_, topic) in topics.items()}
        object.__setattr__(self, "topics_by_key", MappingProxyType(topics))
        object.__setattr__(self, "histories", MappingProxyType(histories))
        clients = {robot.robot_id: {robot.name, *robot.clients} for robot in self.robots.values()}
        unlinked = {
            name: frozenset(other for other, linked in clients.items() if name not in linked)
            for name in self.robots
        }
        object.__setattr__(self, "_unlinked", unlinked)

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a team file.

        Args:
            path: the YAML file.

        Raises:
            DocumentError: the file cannot be read or is invalid; lists every problem of the file.
        """
        return cls.from_document(Document.load(path))

    @classmethod
    def from_document(cls, document: Document) -> Self:
        """Build the team from a loaded document.

        Args:
            document: the parsed YAML of a team file.

        Raises:
            DocumentError: the document is not a valid team; lists every problem.
        """
        model = document.parse(TeamModel)
        problems = list(_problems(document, model))
        if problems:
            raise DocumentError(problems)
        types = sorted(topic.type for kind in model.kinds.values() for topic in kind.topics)
        kinds = {
            name: tuple(
                Topic.model_construct(
                    **dict(topic), topic_id=topic_id, dtype=types.index(topic.type)
                )
                for topic_id, topic in enumerate(kind.topics)
            )
            for name, kind in model.kinds.items()
        }
        ids = {name: robot_id for robot_id, name in enumerate(sorted(model.robots))}
        robots = {
            name: Robot.model_construct(**dict(robot), name=name, robot_id=ids[name])
            for name, robot in model.robots.items()
        }
        return cls(
            robots=MappingProxyType(robots),
            kinds=MappingProxyType(kinds),
            trigger=model.trigger,
            trust=model.trust,
            definitions=MappingProxyType(model.definitions),
            path=document.path,
            model=model,
        )

    def robot(self, name: str) -> Robot:
        """The robot of a name.

        Raises:
            UnknownRobotError: the team has no such robot; lists the known names.
        """
        if name not in self.robots:
            raise UnknownRobotError(name, self.robots, f"in {self.path}")
        return self.robots[name]

    def topics_of(self, name: str) -> tuple[Topic, ...]:
        """The topics of a robot, in the order of their ids.

        Raises:
            UnknownRobotError: the team has no such robot.
        """
        return self.kinds[self.robot(name).kind]

    def topic(self, robot: str, name: str) -> Topic:
        """One topic of a robot.

        Args:
            robot: the name of the robot.
            name: the name of the topic.

        Raises:
            UnknownRobotError: the team has no such robot.
            UnknownTopicError: the robot has no such topic.
        """
        topics = self.topics_of(robot)
        for topic in topics:
            if topic.name == name:
                return topic
        raise UnknownTopicError(self.robot(robot), name, topics)

    def by_ids(self, robot_id: int, topic_id: int) -> tuple[Robot, Topic] | None:
        """The robot and the topic that the ids of a header stand for.

        Args:
            robot_id: 0 to 255.
            topic_id: 0 to 255.

        Returns:
            The pair; None if the team does not have these ids.
        """
        return self.topics_by_key.get(robot_id << 8 | topic_id)

    def pushed(self, pusher: Robot, peer: str) -> frozenset[int]:
        """The robots whose new messages one robot pushes to a peer without a request.

        A robot pushes its own messages, and messages of robots that are not linked to the peer. If
        several robots pushed the same message, it would cross every link of a neighborhood.

        Args:
            pusher: the robot that pushes.
            peer: the name of the robot that receives.

        Returns:
            The ids of the robots.
        """
        return self._unlinked[peer] | {pusher.robot_id}

    def with_robots(self, changes: Mapping[str, Mapping[str, Any]]) -> Team:
        """The team with changed values of some robots, e.g. ``{"io": {"base_port": 24100}}``.

        Args:
            changes: by robot name, the changed keys of the team file and their values.

        Raises:
            UnknownRobotError: a name is not in the team (a new robot would shift the ids).
            DocumentError: the changed team would be invalid.
        """
        data = self.model.model_dump(mode="json")
        for name, values in changes.items():
            data["robots"][self.robot(name).name].update(
                {key: list(v) if isinstance(v, tuple) else v for key, v in values.items()}
            )
        return Team.from_document(Document.from_text(as_yaml(data), self.path))

    def dump(self) -> str:
        """The team as the text of a team file, without keys that a robot does not use."""
        data = self.model.model_dump(mode="json")
        robots = {
            name: {key: value for key, value in robot.items() if value is not None}
            for name, robot in data["robots"].items()
        }
        return as_yaml({**data, "robots": robots})


def _problems(document: Document, model: TeamModel) -> Iterator[Problem]:
    """What a model of single values cannot see: names that must fit together, ports that clash."""
    count = 0
    original = next((name for name, robot in model.robots.items() if robot.original), None)
    for name, kind in model.kinds.items():
        seen: dict[str, int] = {}
        for index, topic in enumerate(kind.topics):
            keys = ("kinds", name, "topics", index, "name")
            if topic.name in seen:
                message = f"topic '{topic.name}' is listed twice; remove one"
                yield document.problem(keys, message, "named-twice")
            seen[topic.name] = index
            count += 1
            if topic.aggregate and not topic.min_interval_s:
                message = "aggregate needs min_interval_s: the seconds of messages that go together"
                where = ("kinds", name, "topics", index, "aggregate")
                yield document.problem(where, message, "aggregate-without-interval")
            if topic.aggregate and original:
                message = (
                    f"the original node of {original} ends over messages that go together; "
                    "remove aggregate"
                )
                where = ("kinds", name, "topics", index, "aggregate")
                yield document.problem(where, message, "not-for-original-nodes")
    if count > IDS:
        message = f"{count} topics, at most {IDS} fit; remove some"
        yield document.problem(["kinds"], message, "too-many")
    for name, robot in model.robots.items():
        if robot.kind not in model.kinds:
            kinds = ", ".join(model.kinds) or "none"
            message = f"no kind '{robot.kind}' under kinds; use one of {kinds}, or add it"
            yield document.problem(["robots", name, "kind"], message, "unknown-kind")
        if robot.key and robot.original:
            message = "an original node knows no keys; remove key, or original"
            yield document.problem(["robots", name, "key"], message, "not-for-original-nodes")
        yield from _address_problems(document, model, name, robot)
        yield from _client_problems(document, model, name, robot)
    yield from _port_problems(document, model)


def _address_problems(
    document: Document, model: TeamModel, name: str, robot: RobotModel
) -> Iterator[Problem]:
    """Original nodes dial IPv4 addresses and host names, and have such addresses themselves."""
    originals = {each for each, other in model.robots.items() if other.original}
    near = [each for each in (name, *robot.clients) if each in originals]
    if near and (robot.address is None or ":" in robot.address):
        what = "mDNS" if robot.address is None else "IPv6"
        message = (
            f"the original node of {near[0]} knows no {what}; write an IPv4 address or a host name"
        )
        keys = ["robots", name, *(["address"] if robot.address else [])]
        yield document.problem(keys, message, "not-for-original-nodes")


def _client_problems(
    document: Document, model: TeamModel, name: str, robot: RobotModel
) -> Iterator[Problem]:
    for index, client in enumerate(robot.clients):
        keys = ("robots", name, "clients", index)
        if client is None:
            continue  # a port that stays unused
        if client in robot.clients[:index]:
            message = f"'{client}' is listed twice; remove one"
            yield document.problem(keys, message, "named-twice")
        elif client not in model.robots:
            names = ", ".join(sorted(model.robots))
            message = f"no robot '{client}' under robots; use one of {names}"
            yield document.problem(keys, message, "unknown-robot")
        elif name not in model.robots[client].clients:
            message = f"'{client}' does not list '{name}'; add it to the clients of {client}"
            yield document.problem(keys, message, "client-one-sided")


def _port_problems(document: Document, model: TeamModel) -> Iterator[Problem]:
    before: dict[str, PortRange] = {}
    for name, robot in model.robots.items():
        ports = PortRange(robot.address, robot.base_port, len(robot.clients))
        for code, message in ports.faults(before, "base_port"):
            yield document.problem(("robots", name, "base_port"), message, code)
        before[name] = ports
