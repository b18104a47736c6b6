"""The terms under which a database's file was written: what ids meant, what was accepted."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import blake2b
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mocha_link.header import Header
    from mocha_link.team import Team


@dataclass(frozen=True)
class Terms:
    """Ids follow from names by their order, so with another team file they may mean others.

    `names` says what each topic key (see `index`) stands for; `accepted` is whatever else decides
    on what is taken from peers.
    """

    names: Mapping[int, str] = field(default_factory=dict)
    accepted: str = ""

    @classmethod
    def of(cls, team: Team) -> Terms:
        """The terms of a team."""
        names = {
            robot.robot_id << 8 | topic.topic_id: f"{name} {topic.name} {topic.type} {topic.dtype}"
            for name, robot in team.robots.items()
            for topic in team.topics_of(name)
        }
        keys = [f"{name} {robot.key}" for name, robot in sorted(team.robots.items())]
        return cls(names, " ".join((team.trust.value, *keys)))

    @cached_property
    def mark(self) -> bytes:
        """The same for the same terms."""
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
        key = header.robot_id << 8 | header.topic_id
        return key in self.names and self.names[key] == earlier.get(key)
