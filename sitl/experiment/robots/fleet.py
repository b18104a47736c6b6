"""The team of a run: its robots, what they may say, and how urgent that is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from air_router.messages import POSE_TOPIC, SEEK_TOPIC
from mocha_link.team.document import Document, as_yaml
from mocha_link.team.team import Team
from sitl.experiment.robots.messages import AERIAL_TOPICS, BASE_TOPICS, GROUND_TOPICS

BASE: Final = "base"
_SEEK: Final = {"name": SEEK_TOPIC, "type": "json/Seek", "priority": "medium"}
_BASE_POSE: Final = {"name": POSE_TOPIC, "type": "json/Pose", "priority": "none"}


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


@lru_cache(maxsize=16)
def fleet_of(uavs: int, ugvs: int, *, base: bool, original: bool) -> Fleet:
    """A team in which every robot may talk to every other one.

    Topics and priorities are those of the authors' simulations; whom a UAV seeks, and where the
    base station stands, are said besides. A robot publishes as often as it likes: how often that
    is, is the robots' business.
    """
    aerial = tuple(f"uav{number:02d}" for number in range(1, uavs + 1))
    ground = tuple(f"ugv{number:02d}" for number in range(1, ugvs + 1))
    station = (BASE,) if base else ()
    kinds = dict.fromkeys(station, "base_station")
    kinds |= dict.fromkeys(aerial, "aerial_robot") | dict.fromkeys(ground, "ground_robot")
    robots = {
        name: {
            "kind": kind,
            "address": f"10.0.{number}.1",
            "base_port": 20_000,
            "clients": [other for other in sorted(kinds) if other != name],
            "original": original,
        }
        for number, (name, kind) in enumerate(sorted(kinds.items()))
    }
    data = {
        "robots": robots,
        "kinds": {
            "aerial_robot": {"topics": _unlimited(*AERIAL_TOPICS, _SEEK)},
            "base_station": {"topics": _unlimited(*BASE_TOPICS, _BASE_POSE)},
            "ground_robot": {"topics": _unlimited(*GROUND_TOPICS)},
        },
    }
    document = Document.from_text(as_yaml(data), Path("fleet.yaml"))
    return Fleet(Team.from_document(document), aerial, ground, BASE if base else None)


def _unlimited(*topics: dict[str, Any]) -> list[dict[str, Any]]:
    return [{**topic, "min_interval_s": 0} for topic in topics]
