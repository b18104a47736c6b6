"""What ids mean: the configuration that a database was written under, and that peers share."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import blake2b

from mocha_link.store.wire import Header
from mocha_link.team.team import Team

MARK_BYTES = 8


def config_hash_of(team: Team) -> int:
    """A u64 that two nodes must have in common before one reads what the other says.

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
    return int.from_bytes(blake2b(text, digest_size=MARK_BYTES).digest(), "big")


def difference(peer: str) -> str:
    """What to say when a peer has another mark."""
    return f"{peer} has another team file (robots or topics differ); give all robots the same"


@dataclass(frozen=True)
class TeamConfig:
    """Ids follow from names by their order, so with another team file they may mean others.

    `names` says what each topic key (see `Header`) stands for; `accepted` is whatever else decides
    on what is taken from peers.
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

    @cached_property
    def mark(self) -> bytes:
        """The same for the same configuration."""
        return blake2b(f"{self.text} {self.accepted}".encode(), digest_size=16).digest()

    @cached_property
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
