"""The mission file of a rehearsal: hurried, drawn into by an operator, and the space it leaves.

That space is worked out with the judge's reader of mission files, not with the code that flies.
"""

from __future__ import annotations

import copy
import functools
import math
import random
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

import shapely
import yaml

from air_router.mission import load_mission
from geo.frame import Point
from sitl.rehearsal.judge import Frame, Pair, RawMission, open_space, read_mission
from sitl.rehearsal.zone_terms import OVER_RALLY, WIDER_M, over_a_rally_point

_HOME_CLEAR_M: Final = 8.0
"""Nearer to home than this a zone would be refused."""

_WALL_M, _THICK_M = 22.0, 6.0
"""How far from where the vehicle was first walls are drawn, and how thick."""

_SIDES: Final = ((0, 1), (0, -1), (1, 0), (-1, 0))
SIDES: Final = range(len(_SIDES))
"""Numbers of the four walls around a vehicle."""

_CORNERS: Final = ((-1, -1), (1, -1), (1, 1), (-1, 1))
_TIMERS: Final = {"init_s": 40, "explore_s": 25, "search_s": 10, "communicate_s": 10}
_FILES: Final = ("team", "world")
_POINTS: Final = 44
"""So many points of a fence leave room for more zones: PX4 stores 64."""

_BRAKING_M_S2, _BRAKES_LATER_S = 3.0, 0.3
"""What a PX4 brakes with, and how much later: it builds that up with limited jerk."""

_MARGIN_M, _LEAVING_M = 1.85, 1.8
"""On top of the clearance: nearer places are refused; first legs nearer than the other are, too."""

_SHORT_M: Final = 1.3
"""So much less than the clearance a way keeps that the judge calls bad."""

_TRIES: Final = 120
ANOTHER: Final = "zephyr"
"""The second of two UAVs."""

_ADDRESS: Final = {"address": "127.0.1.99", "base_port": 30_000, "clients": []}
_APART_M, _AROUND_M, _HOMES_M = 12.0, 18.0, 25.0
"""How far the layers of two UAVs are apart; waypoints, and the other home, at least from a home."""


class RehearsalFileError(Exception):
    """A mission that cannot be rehearsed."""


@functools.cache
def hurried(path: Path) -> dict[str, Any]:
    """A mission in a hurry: the paper's times divided, a few minutes in all.

    Raises:
        RehearsalFileError: it is no mission in YAML.
    """
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    if not isinstance(document, dict) or "home" not in document:
        raise RehearsalFileError(f"{path}: only missions in YAML are rehearsed")
    folder = path.absolute().parent
    document |= {key: str(folder / document[key]) for key in _FILES if key in document}
    if "no_fly_files" in document:
        document["no_fly_files"] = [str(folder / name) for name in document["no_fly_files"]]
    return {**document, "timers": _TIMERS, "speed_m_s": 5, "duration_s": 170}


def changed(document: dict[str, Any], keys: Mapping[str, Any], waypoints: int) -> dict[str, Any]:
    """A mission with other keys, and only its first waypoints; 0: all."""
    return {**document, **keys, "waypoints": document["waypoints"][: waypoints or None]}


def with_room(document: dict[str, Any]) -> dict[str, Any]:
    """A mission with so few zones that more can be drawn."""
    zones = list(document["no_fly_zones"])
    corners = len(document["fence"] or ()) if isinstance(document["fence"], list) else 1
    while zones and corners + sum(len(zone.get("polygon", "1")) for zone in zones) > _POINTS:
        zones.pop()
    return {**document, "no_fly_zones": zones}


def with_another_uav(document: dict[str, Any], folder: Path, rng: random.Random) -> dict[str, Any]:
    """A mission that a second UAV flies as well: mostly above the first, from a home in the middle.

    Waypoints beside that home are taken out, and the team gets the UAV.
    """
    if "uavs" in document:
        return document
    uav, layer_m = document["uav"], float(document["altitude_m"])
    own = Frame(tuple(document["home"]["position"]))
    far = [p for p in document["waypoints"] if math.hypot(*own.metres(*p)) > _HOMES_M]
    home = rng.choice(far)
    above_m = rng.choice((_APART_M, _APART_M, _APART_M, -_APART_M))
    around = (own, Frame(tuple(home)))
    kept = [
        place
        for place in document["waypoints"]
        if min(math.hypot(*frame.metres(*place)) for frame in around) > _AROUND_M
    ]
    team = yaml.safe_load(Path(document["team"]).read_text(encoding="utf-8"))
    team["robots"][ANOTHER] = {"kind": team["robots"][uav]["kind"], **_ADDRESS}
    path = folder / "team.yaml"
    path.write_text(yaml.safe_dump(team), encoding="utf-8")
    uavs = {uav: {}, ANOTHER: {"altitude_m": layer_m + above_m, "home": home}}
    rest = {key: value for key, value in document.items() if key not in {"uav", "rally_points"}}
    return {**rest, "waypoints": kept, "uavs": uavs, "team": str(path)}


class MissionFile:
    """A mission file that an operator draws zones into.

    Args:
        path: Where it is written.
        document: What is in it.
        uav: Which of several UAVs is rehearsed; None: the first.
        start: When it is to take off, for zones with hours; None: now.
        masts: The first zone that is drawn brings one over a rally point.

    Attributes:
        path: The same.
        text: What is in it now.
        space: Where one may fly by that.
        mission: As it was at the start; what is drawn is given in its local frame.
    """

    def __init__(
        self,
        path: Path,
        document: dict[str, Any],
        *,
        uav: str | None = None,
        start: datetime | None = None,
        masts: bool = True,
    ) -> None:
        self.path = path
        self._uav = uav
        self._masts = masts
        self._document = document
        self._before = document
        self._middle: Point | None = None  # of the four walls; None: none was drawn yet
        self._walls: list[str] = []  # names of those that stand, the last one opens first
        self.text = ""
        self._write(document)
        self.mission = load_mission(path, uav=uav, start=start)

    @property
    def map_files(self) -> list[str]:
        """Map files with zones that it names."""
        entries = self._document.get("no_fly_files") or []
        return [entry["file"] if isinstance(entry, dict) else entry for entry in entries]

    @property
    def space(self) -> FlyableSpace:
        """Where one may fly by the file as it is now."""
        return _space(self.path, self.text, self._uav)

    def circle(self, place: Point, radius_m: float, **limits_m: float) -> bool:
        """Draw a circle, perhaps with limits of its altitude above home; whether it is drawn.

        It would be refused too near to home.
        """
        if math.dist(place, self.mission.home) - radius_m < _HOME_CLEAR_M:
            return False
        shape: dict[str, Any] = {}
        shape["circle"] = {"centre": self._degrees(place), "radius_m": radius_m}
        shape |= {"altitude": limits_m} if limits_m else {}
        self._draw({f"added {len(self._document['no_fly_zones'])}": shape})
        return True

    def wall(self, vehicle: Point, sides: Iterable[int], **limits_m: float) -> bool:
        """Draw some of four walls around where the vehicle was at the first of them.

        They may have limits of their altitude above home.

        Returns whether they are drawn: not where one of them would be refused, nor all at once
        around home.
        """
        self._middle = vehicle if self._middle is None else self._middle
        shapes = {f"wall {side}": self._wall(self._middle, side) for side in sides}
        offs_m = zip(self.mission.home, self._middle, strict=True)
        inside = max(abs(home_m - middle_m) for home_m, middle_m in offs_m) <= _WALL_M
        if None in shapes.values() or (inside and len(shapes) == len(SIDES)):
            return False
        self._walls += shapes
        limits = {"altitude": limits_m} if limits_m else {}
        self._draw({name: {**shape, **limits} for name, shape in shapes.items() if shape})
        return True

    def _wall(self, around: Point, side: int) -> dict[str, Any] | None:
        """One wall around a place; None where it would be refused."""
        home = self.mission.home
        east, north = _SIDES[side]
        out_m, along_m = _WALL_M + _THICK_M / 2, _WALL_M + _THICK_M
        middle = around[0] + east * out_m, around[1] + north * out_m
        half = (_THICK_M / 2, along_m) if east else (along_m, _THICK_M / 2)
        away = [max(abs(home[axis] - middle[axis]) - half[axis], 0.0) for axis in (0, 1)]
        if math.hypot(*away) < _HOME_CLEAR_M:
            return None
        ring = [Point(middle[0] + e * half[0], middle[1] + n * half[1]) for e, n in _CORNERS]
        return {"polygon": [self._degrees(corner) for corner in ring]}

    def open(self) -> bool:
        """Take away the wall that was drawn last; whether there was one."""
        if not self._walls:
            return False
        name = self._walls.pop()
        changed = copy.deepcopy(self._document)
        changed["no_fly_zones"] = [z for z in changed["no_fly_zones"] if z.get("name") != name]
        self._write(changed)
        return True

    def rewrite(self, change: Callable[[dict[str, Any]], None]) -> None:
        """Change anything in it: `change` gets a copy of what is in it."""
        changed = copy.deepcopy(self._document)
        change(changed)
        self._write(changed)

    def undo(self) -> None:
        """The last change was not taken: the file is again as it is flown."""
        self._write(self._before)

    def _draw(self, shapes: dict[str, Any]) -> None:
        changed, clearance_m = copy.deepcopy(self._document), self.space.mission.clearance_m
        terms = {"crosses_fence": True, "clearance_m": clearance_m - WIDER_M}
        changed["no_fly_zones"] += [{"name": n, **terms, **shape} for n, shape in shapes.items()]
        names = [zone.get("name") for zone in changed["no_fly_zones"]]
        if self._masts and OVER_RALLY not in names:
            changed["no_fly_zones"] += over_a_rally_point(self.space.mission)
        self._write(changed)

    def _write(self, document: dict[str, Any]) -> None:
        self._before, self._document = self._document, document
        self.text = yaml.safe_dump(document, sort_keys=False)
        self.path.write_text(self.text, encoding="utf-8")

    def _degrees(self, place: Point) -> list[float]:
        return [round(degrees, 8) for degrees in self.mission.frame.to_geodetic(place)]


class Turn(NamedTuple):
    """A way to somewhere, a place on it, and where it is sent from there."""

    towards: Pair
    at: Pair
    off_to: Pair


class FlyableSpace:
    """Where ways may be flown where it cruises, and where they are much too near.

    Args:
        mission: As the judge reads it.

    Attributes:
        mission: The same.
    """

    def __init__(self, mission: RawMission) -> None:
        self.mission = mission
        self._clear = open_space(mission.cruised, _MARGIN_M)  # of goals
        self._leaving = open_space(mission.cruised, _LEAVING_M)  # of ways
        self._legal = open_space(mission.cruised, -_SHORT_M)  # outside the judge calls a way bad
        shapely.prepare([self._clear, self._leaving, self._legal])

    def nearest(self, here: Pair) -> tuple[float, Pair]:
        """How far the next zone or fence is, and its direction: east and north, of length 1."""
        point = shapely.Point(here)
        near = min((area.border for area in self.mission.cruised), key=point.distance)
        to = shapely.get_coordinates(shapely.shortest_line(point, near))[1]
        away_m = max(float(point.distance(near)), 1e-6)
        return away_m, ((to[0] - here[0]) / away_m, (to[1] - here[1]) / away_m)

    def around_a_corner(self, here: Pair, velocity_m_s: Pair, rng: random.Random) -> Pair | None:
        """A place that is clear from here, and not from where it can stop; None: none found."""
        seconds = _BRAKES_LATER_S + math.hypot(*velocity_m_s) / (2 * _BRAKING_M_S2)
        stands = here[0] + velocity_m_s[0] * seconds, here[1] + velocity_m_s[1] * seconds
        if not self._legal.covers(shapely.LineString([here, stands])):
            return None
        places = _around(here, rng, 6.0, 45.0)
        swept = shapely.polygons([[here, stands, place] for place in places])
        short = ~shapely.covers(self._legal, swept)
        return self._first(here, [p for p, is_short in zip(places, short, strict=True) if is_short])

    def turn(
        self, here: Pair, speed_m_s: float, brakes_s: float, rng: random.Random
    ) -> Turn | None:
        """A straight way, and a place on it where it is too fast for another; None: none found.

        Too fast, having braked for so long, with a jerk of 4 m/s3, since it was there.
        """
        left_m_s = speed_m_s - 2.0 * brakes_s**2
        for towards in _around(here, rng, 30.0, 70.0):
            if self._first(here, [towards]) is None:
                continue
            away_m = math.dist(here, towards)
            east, north = ((b - a) / away_m for a, b in zip(here, towards, strict=True))
            for along_m in range(12, int(away_m - 12.0), 4):
                at = here[0] + along_m * east, here[1] + along_m * north
                on_m = speed_m_s * brakes_s
                from_ = at[0] + on_m * east, at[1] + on_m * north
                off_to = self.around_a_corner(from_, (left_m_s * east, left_m_s * north), rng)
                if off_to is not None:
                    return Turn(towards, at, off_to)
        return None

    def in_sight(self, here: Pair, rng: random.Random) -> Pair | None:
        """A place that a straight way leads to; None: none found."""
        return self._first(here, _around(here, rng, 25.0, 60.0))

    def _first(self, here: Pair, places: list[Pair]) -> Pair | None:
        """The first of these that is clear, and on a way that may be left on."""
        for place in places:
            way = shapely.LineString([here, place])
            if self._clear.covers(shapely.Point(place)) and self._leaving.covers(way):
                return place
        return None


def _around(here: Pair, rng: random.Random, least_m: float, most_m: float) -> list[Pair]:
    ways = [(rng.uniform(0.0, 2 * math.pi), rng.uniform(least_m, most_m)) for _ in range(_TRIES)]
    return [(here[0] + away * math.sin(a), here[1] + away * math.cos(a)) for a, away in ways]


@functools.lru_cache(maxsize=4)
def _space(path: Path, text: str, uav: str | None) -> FlyableSpace:
    return FlyableSpace(read_mission(path, text, uav, ground_amsl_m=0.0))
