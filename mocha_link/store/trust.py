"""Whose message it is, however many robots handed it on, and what its ids mean.

A signature covers the ids and names of robot and topic, the full time, dtype, priority and the LZ4
frame. What is accepted from whom is the team's `trust` (docs/security.md). The configuration that
peers share, and that a database was written under, identifies the meaning of the ids.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import blake2b

from mocha_link.store import wire
from mocha_link.store.wire import Body, Header, PayloadError, Trailer
from mocha_link.team import Robot, SecretKey, Team, Topic, Trust, public_key

YEAR_S = 365.25 * 86_400

_PURPOSE = b"mocha-link message 1\0"


class SignatureError(PayloadError):
    """A message whose signature is missing or wrong, or that this peer may not hand on."""


def sign(secret: SecretKey, robot: Robot, topic: Topic, statement: bytes) -> bytes:
    """The signature of a message of a topic; `statement` is the bytes that `wire.pack` covers."""
    return secret.sign(_about(robot, topic) + statement)


class Verifier:
    """Decides which messages to accept from which peer, by the team's `trust`.

    Raises:
        KeyMismatchError: a key in the team file is none.
        KeysUnavailableError: the team has keys, and PyNaCl is missing.
    """

    def __init__(self, team: Team) -> None:
        self._team = team
        # by robot; None: it signs nothing
        self._keys = {name: public_key(robot) for name, robot in team.robots.items()}

    def verify(
        self, header: Header, body: Body, trailer: Trailer | None, *, handed_by: str
    ) -> None:
        """Accept a message that a peer handed us; `trailer` is what `wire.check` returned.

        Raises:
            SignatureError: refused; the message has the reason.
        """
        known = self._team.by_ids(header.robot_id, header.topic_id)
        if known is None:
            raise SignatureError(f"{header} is not of this team")
        robot, topic = known
        if trailer and header != Header.at(header.robot_id, header.topic_id, trailer.stamp_ms):
            raise SignatureError(f"{header} carries the time of another message")
        key = self._keys[robot.name]
        if key is None:
            if self._team.trust is Trust.SIGNED and handed_by != robot.name:
                raise SignatureError(
                    f"{robot.name} has no key: its messages are taken from itself only, "
                    f"not from {handed_by}"
                )
        elif trailer is None or trailer.signature is None:
            if self._team.trust is Trust.SIGNED:
                raise SignatureError(f"not signed by {robot.name}, handed on by {handed_by}")
        else:
            view = memoryview(body)
            frame = view[wire.PREFIX : trailer.at]
            statement = wire.statement(view[: wire.PREFIX], trailer.stamp_ms, frame)
            if not key.proves(trailer.signature, _about(robot, topic) + statement):
                raise SignatureError(
                    f"the signature is not of {robot.name}, handed on by {handed_by}"
                )


def impossibility(
    team: Team, robot_id: int, topic_id: int, stamp_ms: int, now_s: float
) -> str | None:
    """Why a message cannot be one of the team's; None: it can.

    Args:
        team: the team.
        robot_id: the id of the robot in its header.
        topic_id: the id of the topic.
        stamp_ms: its time, or what of it the header has.
        now_s: Unix time of this node.
    """
    if (robot_id << 8 | topic_id) not in team.topics_by_key:
        known = team.by_ids(robot_id, 0)
        missing = f"no robot with topics has id {robot_id}"
        if known:
            missing = f"{known[0].name} has no topic with id {topic_id}"
        return f"{missing} in the team file; give all robots the same file"
    if not wire.is_taken(stamp_ms, now_s):
        years = (stamp_ms / 1000 - now_s) / YEAR_S
        return f"its time is {years:.0f} years ahead of this clock; set the clock that is wrong"
    if stamp_ms % wire.WRAP_MS <= wire.UNSAFE_MS:
        return (
            "its time is in the first second of 65536, where original nodes stop for good; the "
            "node that made it should have stamped it a second later"
        )
    return None


def _about(robot: Robot, topic: Topic) -> bytes:
    names = f"{robot.name}\0{topic.name}\0".encode()
    return _PURPOSE + bytes((robot.robot_id, topic.topic_id)) + names


def config_hash_of(team: Team) -> int:
    """A u64 that two nodes must have in common before one accepts messages of the other.

    It covers whatever decides on what the bytes of a message are taken for: the id and name of
    every robot and how its ROS messages are serialized, and of every topic of it the id, name,
    type, type id and whether its messages come in batches. Nothing else: two robots with files
    that differ in addresses, ports, radios, keys, trust, rates, priorities, histories or comments
    understand each other.
    """
    robots = [
        (
            robot.robot_id,
            name,
            robot.ros,
            [
                (topic.topic_id, topic.name, topic.type, topic.dtype, topic.aggregate)
                for topic in team.topics_of(name)
            ],
        )
        for name, robot in team.robots.items()
    ]
    text = json.dumps(sorted(robots)).encode()
    return int.from_bytes(blake2b(text, digest_size=8).digest(), "big")


def definitions_of(team: Team) -> dict[int, int]:
    """By topic key, a u32 for all that decides on what the bytes of its messages are taken for.

    Two nodes exchange the messages of a topic if this number is the same to both.
    """
    definitions: dict[int, int] = {}
    for name, robot in team.robots.items():
        for topic in team.topics_of(name):
            about = (
                (robot.robot_id, name, robot.ros),
                (topic.topic_id, topic.name, topic.type, topic.dtype, topic.aggregate),
            )
            raw = blake2b(json.dumps(about).encode(), digest_size=4).digest()
            definitions[robot.robot_id << 8 | topic.topic_id] = int.from_bytes(raw, "big")
    return definitions


def difference(team: Team, peer: str, theirs: Mapping[int, int]) -> str:
    """What is not exchanged with a peer whose team file has other definitions, for the operator."""
    ours = definitions_of(team)
    parts: list[str] = []
    for name, robot in team.robots.items():
        topics = team.topics_of(name)
        keys = {robot.robot_id << 8 | topic.topic_id: topic.name for topic in topics}
        apart = [topic for key, topic in keys.items() if theirs.get(key) != ours[key]]
        if apart:
            whole = len(apart) == len(topics)
            parts.append(f"robot {name}" if whole else f"{', '.join(apart)} of {name}")
    more = sum(ours.get(key) != definition for key, definition in theirs.items())
    if more:
        parts.append(f"{more} topics as {peer} has them")
    return (
        f"{peer} has another team file; not exchanged: {'; '.join(parts) or 'nothing'} "
        "(mocha-link check shows names and types)"
    )


@dataclass(frozen=True)
class TeamConfig:
    """Ids follow from names by their order, so with another team file they may mean others.

    `names` has the meaning of each topic key (see `Header`); `accepted` is any other setting that
    decides which messages are accepted.
    """

    names: Mapping[int, str] = field(default_factory=dict)
    accepted: str = ""

    @classmethod
    def of(cls, team: Team) -> TeamConfig:
        """The configuration of a team."""
        names = {
            robot.robot_id << 8 | topic.topic_id: f"{name} {topic.name} {topic.type} {topic.dtype}"
            for name, robot in team.robots.items()
            for topic in team.topics_of(name)
        }
        keys = [f"{name} {robot.key}" for name, robot in sorted(team.robots.items())]
        return cls(names, " ".join((team.trust.value, *keys)))

    @property
    def mark(self) -> bytes:
        """The same for the same configuration."""
        return blake2b(f"{self.text} {self.accepted}".encode(), digest_size=16).digest()

    @property
    def text(self) -> str:
        """The names, as `read` takes them."""
        return json.dumps(sorted(self.names.items()))

    @staticmethod
    def read(text: object) -> dict[int, str] | None:
        """Names from their text; None if it is none."""
        try:
            return {int(key): str(name) for key, name in json.loads(str(text))}
        except (ValueError, TypeError):
            return None

    def keeps(self, header: Header, earlier: Mapping[int, str]) -> bool:
        """Whether the ids of a message mean what they meant under earlier names."""
        return header.key in self.names and self.names[header.key] == earlier.get(header.key)
