"""Towns as YAML (docs/evidence/town.md), and the missions of UAVs over towns that have none."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import shapely
import yaml
from pydantic import BaseModel, Field

from air_router.files.missions import place, read_mission
from air_router.mission import Mission, checked
from geo.airspace import ZoneError, checked_ring
from geo.frame import FrameError, Geodetic, LocalFrame, Point
from mocha_link.team import Document, DocumentError, Problem, as_yaml
from sitl.world.towns.terrain import MAX_CELLS, Road
from sitl.world.towns.town import (
    GRAIN_M,
    REACHED_M,
    RESOLUTION_M,
    SAME_GOAL_M,
    Bounds,
    Goal,
    Ring,
    Town,
)
from sitl.world.towns.ways import PASSABLE, Ways

Keys = tuple[str | int, ...]
_Metres = Annotated[float, Field(ge=-1e4, le=1e4)]
_Pair = Annotated[list[_Metres], Field(min_length=2, max_length=2)]
_Name = Annotated[str, Field(min_length=1, max_length=64)]


class _Frame(BaseModel):
    origin: Annotated[list[float], Field(min_length=2, max_length=2)]


class _Bounds(BaseModel):
    west_m: _Metres
    south_m: _Metres
    east_m: _Metres
    north_m: _Metres


class _Road(BaseModel):
    points: Annotated[list[_Pair], Field(min_length=2)]
    width_m: Annotated[float, Field(gt=0, le=1000)]


class _Town(BaseModel):
    name: _Name
    frame: _Frame
    home: _Pair
    bounds: _Bounds
    outline: list[_Pair]
    roads: Annotated[list[_Road], Field(min_length=1)]
    vegetation: list[list[_Pair]] = []
    buildings: list[list[_Pair]] = []
    yards: list[list[_Pair]] = []
    goals: dict[_Name, _Pair]
    starts: Annotated[list[_Pair], Field(min_length=1)]


def load_town(path: Path) -> Town:
    """The town of a file.

    Raises:
        DocumentError: every problem of the file, with line and column.
    """
    document = Document.load(path)
    return _Reader(document, document.parse(_Town)).town()


@dataclass(slots=True)
class _Reader:
    document: Document
    model: _Town
    problems: list[Problem] = field(default_factory=list)

    def town(self) -> Town:
        model = self.model
        frame, bounds = self._frame(), self._bounds()
        rings = {
            key: self._rings(getattr(model, key), key)
            for key in ("vegetation", "buildings", "yards")
        }
        outline = self._ring(model.outline, ("outline",))
        if self.problems or frame is None:
            raise DocumentError(self.problems)
        town = Town(
            name=model.name,
            frame=frame,
            bounds=bounds,
            outline=outline,
            roads=tuple(Road(_points(road.points), road.width_m) for road in model.roads),
            goals=tuple(Goal(name, Point(*place)) for name, place in model.goals.items()),
            starts=_points(model.starts),
            home=Point(*model.home),
            **rings,
        )
        self._check_places(town)
        if self.problems:
            raise DocumentError(self.problems)
        return town

    def _frame(self) -> LocalFrame | None:
        try:
            return LocalFrame(Geodetic(*self.model.frame.origin))
        except FrameError as error:
            message = f"{error}; correct it (latitude comes first)"
            self._report(("frame", "origin"), message, "not-on-earth")
            return None

    def _bounds(self) -> Bounds:
        bounds = Bounds(**self.model.bounds.model_dump())
        for key, value in bounds._asdict().items():
            if value % GRAIN_M:
                message = f"{key}: {value} is no multiple of {GRAIN_M:g} m; round it outwards"
                self._report(("bounds", key), message, "bounds-uneven")
        width_m, height_m = bounds.east_m - bounds.west_m, bounds.north_m - bounds.south_m
        if width_m <= 0 or height_m <= 0:
            message = "the bounds enclose nothing; exchange west and east, or south and north"
            self._report(("bounds",), message, "bounds-inverted")
        elif width_m * height_m / RESOLUTION_M**2 > MAX_CELLS:
            message = f"larger than {MAX_CELLS} cells of {RESOLUTION_M} m; make the town smaller"
            self._report(("bounds",), message, "too-large")
        return bounds

    def _rings(self, polygons: Sequence[list[list[float]]], key: str) -> tuple[Ring, ...]:
        return tuple(self._ring(pairs, (key, index)) for index, pairs in enumerate(polygons))

    def _ring(self, pairs: list[list[float]], keys: Keys) -> Ring:
        try:
            return checked_ring(_points(pairs))
        except ZoneError as error:
            message = f"cannot be an area: {error}; draw it again"
            self._report(keys, message, error.code)
            return ()

    def _check_places(self, town: Town) -> None:
        """Robots must be able to start, and to get from there to every goal."""
        standing = PASSABLE[town.ground[[town.lattice.cell(place) for place in town.starts]]]
        for index in np.flatnonzero(~standing).tolist():
            message = "no robot can stand here: a building reaches into this 2 m cell; move it"
            self._report(("starts", index), message, "start-in-building")
        if not standing[0]:
            return
        ways = Ways(town.lattice, town.ground, town.lattice.cell(town.starts[0]))
        for index, start in enumerate(town.starts):
            if standing[index] and math.isinf(ways.costs[town.lattice.cell(start)]):
                message = "no way leads from the first start to this one; open one, or move it"
                self._report(("starts", index), message, "start-unreachable")
        for goal in town.goals:
            keys = ("goals", goal.id)
            if ways.nearest(goal.position, REACHED_M) is None:
                message = f"no way leads from the first start to {goal.id}; open one, or move it"
                self._report(keys, message, "goal-unreachable")
        for index, goal in enumerate(town.goals):
            for other in town.goals[:index]:
                distance_m = math.dist(goal.position, other.position)
                if distance_m <= SAME_GOAL_M:
                    message = (
                        f"{distance_m:.1f} m from {other.id}: robots take both for one goal; "
                        f"move it beyond {SAME_GOAL_M} m"
                    )
                    self._report(("goals", goal.id), message, "goals-too-near")

    def _report(self, keys: Keys, message: str, code: str) -> None:
        self.problems.append(self.document.problem(keys, message, code))


def _points(pairs: Iterable[Sequence[float]]) -> tuple[Point, ...]:
    return tuple(Point(east_m, north_m) for east_m, north_m in pairs)


def town_text(town: Town) -> str:
    """A town as YAML; read again it is the same town."""
    rings = {
        key: [list(map(list, ring)) for ring in getattr(town, key)]
        for key in ("vegetation", "buildings", "yards")
    }
    data = {
        "name": town.name,
        "frame": {"origin": list(town.frame.origin)},
        "home": list(town.home),
        "bounds": town.bounds._asdict(),
        "outline": list(map(list, town.outline)),
        "roads": [
            {"width_m": road.width_m, "points": list(map(list, road.points))} for road in town.roads
        ],
        **rings,
        "goals": {goal.id: list(goal.position) for goal in town.goals},
        "starts": list(map(list, town.starts)),
    }
    return as_yaml(data, short_in_line=True)


_BEYOND_M: Final = 15.0
"""The fence is so far outside of the town."""

_LANE_M: Final = 45.0
"""Between lanes, and between two waypoints on one, at most."""


def mission_over(town: Town, *, altitude_m: float = 60.0, speed_m_s: float = 5.0) -> Mission:
    """A mission as `air_router.mission` reads it: waypoints in lanes, a fence around the town.

    Args:
        town: What to explore.
        altitude_m: Above home.
        speed_m_s: Cruise speed.
    """
    text = mission_text(town, altitude_m=altitude_m, speed_m_s=speed_m_s)
    path = Path(f"(mission over {town.name})")
    form, findings = read_mission(Document.from_text(text, path))
    return checked(place(form, findings), findings)


def mission_text(town: Town, *, altitude_m: float = 60.0, speed_m_s: float = 5.0) -> str:
    """The same as a mission file."""
    west_m, south_m, east_m, north_m = shapely.Polygon(town.outline).bounds
    fence = shapely.box(west_m, south_m, east_m, north_m).buffer(_BEYOND_M, join_style="mitre")
    mission: dict[str, Any] = {
        "name": town.name,
        "coordinates": "local",
        "frame": {"origin": list(town.frame.origin)},
        "home": {"position": list(town.home)},
        "altitude_m": altitude_m,
        "speed_m_s": speed_m_s,
        "seek": [],
        "waypoints": [list(place) for place in _lanes(west_m, south_m, east_m, north_m)],
        "fence": [list(corner) for corner in fence.exterior.coords[:-1]],
        "no_fly_zones": [],
    }
    return yaml.safe_dump(mission, sort_keys=False, default_flow_style=None, width=98)


def _lanes(west_m: float, south_m: float, east_m: float, north_m: float) -> list[Point]:
    """Places in lanes from west to east and back, from the south on."""
    columns, rows = _spread(west_m, east_m), _spread(south_m, north_m)
    return [
        Point(east, north)
        for number, north in enumerate(rows)
        for east in (columns if number % 2 == 0 else columns[::-1])
    ]


def _spread(low_m: float, high_m: float) -> list[float]:
    """The middles of equal parts that are no longer than `_LANE_M`."""
    parts = max(1, math.ceil((high_m - low_m) / _LANE_M))
    edges = [low_m + (high_m - low_m) * k / parts for k in range(parts + 1)]
    return [round(a + b) / 2 for a, b in pairwise(edges)]
