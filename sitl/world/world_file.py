"""Reads world files: the radio, the camera, the terrain and the robots of a simulation.

The format is described in docs/simulation.md. A mission without a world file gets a default world,
made from the mission and a seed.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import shapely
from pydantic import BaseModel, Field, model_validator

from air_router.files import parse_world
from air_router.files.missions import other_kind
from air_router.gossip import MARGIN_M
from air_router.mission import Mission
from geo.airspace import Circle, Ring, Zone, ZoneError, checked_ring
from geo.frame import FrameError, Point
from mocha_link.team import Document, DocumentError, Problem
from sitl.world.explorers import Exploration, ExplorerSettings, PlacedBy
from sitl.world.radio import RadioModel
from sitl.world.towns import Camera, LandCover, Road, load_town, scatter
from sitl.world.ugv import MAX_SPEED_M_S, Patrol, PatrolPlan, default_patrols

Keys = tuple[str | int, ...]
_Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
_Line = Annotated[list[_Pair], Field(min_length=2)]


class _Road(BaseModel):
    points: _Line
    width_m: Annotated[float, Field(gt=0, le=1000)] = 6.0


class _Terrain(BaseModel):
    margin_m: Annotated[float, Field(ge=0, le=1e4)] = MARGIN_M
    roads: list[_Road] = []
    vegetation: list[list[_Pair]] = []
    buildings: list[list[_Pair]] | None = None
    vehicles: list[_Pair] = []


class _Robot(BaseModel):
    patrol: Annotated[list[_Pair], Field(min_length=1, description="points to drive through")]
    closed: bool = True
    speed_m_s: Annotated[float, Field(gt=0, le=MAX_SPEED_M_S)] = 1.0
    start_m: Annotated[float, Field(ge=0)] = 0.0


class _Explore(ExplorerSettings):
    town: Annotated[str, Field(min_length=1, description="the path of a town's file")]
    goals: PlacedBy = "town"
    starts: PlacedBy = "town"


class _World(BaseModel):
    coordinates: Literal["degrees", "local"] = "degrees"
    radio: RadioModel = RadioModel()
    camera: Camera = Camera()
    terrain: _Terrain = _Terrain()
    robots: dict[str, _Robot] = {}
    explore: _Explore | None = None

    @model_validator(mode="before")
    @classmethod
    def _empty(cls, data: object) -> object:
        return {} if data is None else data


@dataclass(frozen=True, slots=True)
class WorldPlan:
    """A world, ready to be simulated; positions in metres of the mission's local frame.

    Attributes:
        radio: Which robots receive which.
        camera: What the vehicle sees.
        land_cover: What stands where.
        patrols: Where each ground robot drives, by name.
        margin_m: How far the terrain reaches beyond the fence.
        seed: Chooses the fading.
        exploration: The robots that search for the vehicles of a town; None: all are on patrol. Of
            its robots those that have a patrol keep to it.
    """

    radio: RadioModel
    camera: Camera
    land_cover: LandCover
    patrols: Mapping[str, PatrolPlan]
    margin_m: float = MARGIN_M
    seed: int = 0
    exploration: Exploration | None = None


def load_world(path: Path | None, mission: Mission, robots: Sequence[str], seed: int) -> WorldPlan:
    """The world of a mission.

    Args:
        path: The world file; None: a default world.
        mission: Gives the frame, and the buildings where the file names none.
        robots: Names of the ground robots; those that the file does not mention explore its town,
            or get patrols near waypoints, far from each other.
        seed: Chooses the default patrols, the radio's shadowing, and what exploring robots draw.

    Raises:
        DocumentError: every problem of the file, with line and column.
    """
    if path is None:
        document = Document.from_text("", Path("(default world)"))
    else:
        document = Document.load(path)
    if other := other_kind(document.data, "world"):
        message = f"this is {other}; a mission's 'world' names the file of what is simulated"
        raise DocumentError.at(document.path, message, "wrong-file")
    return _Reader(document, parse_world(document, _World), mission).plan(robots, seed)


@dataclass(slots=True)
class _Reader:
    """Takes a parsed file into the local frame and collects its mistakes."""

    document: Document
    model: _World
    mission: Mission
    problems: list[Problem] = field(default_factory=list)

    def plan(self, robots: Sequence[str], seed: int) -> WorldPlan:
        model = self.model
        exploration = self._exploration(robots, seed)
        land_cover = self._scene(exploration)
        patrols = {
            name: plan
            for name, robot in model.robots.items()
            if (plan := self._patrol(name, robot, robots, land_cover)) is not None
        }
        if self.problems:
            raise DocumentError(self.problems)
        if exploration is None:
            missing = [name for name in robots if name not in patrols]
            patrols |= default_patrols(self.mission, missing, seed, patrols.values())
        world = (model.radio, model.camera, land_cover, patrols, model.terrain.margin_m)
        return WorldPlan(*world, seed, exploration)

    def _exploration(self, robots: Sequence[str], seed: int) -> Exploration | None:
        explore = self.model.explore
        if explore is None:
            return None
        town = load_town(self.document.path.parent / explore.town)
        ours, theirs = self.mission.frame.origin, town.frame.origin
        if ours != theirs:
            message = (
                f"the town's frame.origin is {theirs[0]}, {theirs[1]}, and the mission's "
                f"{ours[0]}, {ours[1]}: robots would take its map for another place; give the "
                "mission the town's"
            )
            self._report(("explore", "town"), message, "other-origin")
        for key in sorted(self.model.terrain.model_fields_set - {"margin_m"}):
            message = f"'{key}' stand in the town's file; remove them here, or 'explore'"
            self._report(("terrain", key), message, "town-has-it")
        if explore.goals == "seed":
            town = scatter(town, seed, len(town.goals))
        settings = ExplorerSettings(**explore.model_dump(exclude={"town", "goals", "starts"}))
        return Exploration(
            *(town, tuple(robots), seed, settings), drawn_starts=explore.starts == "seed"
        )

    def _scene(self, exploration: Exploration | None) -> LandCover:
        if exploration is not None:
            return exploration.town.land_cover
        terrain = self.model.terrain
        shapes = (zone.shape for zone in self._standing())
        buildings = tuple(s.corners if isinstance(s, Circle) else s.ring for s in shapes)
        if terrain.buildings is not None:
            buildings = self._rings(terrain.buildings, ("terrain", "buildings"))
        return LandCover(
            vegetation=self._rings(terrain.vegetation, ("terrain", "vegetation")),
            roads=tuple(
                Road(self._points(road.points, ("terrain", "roads", index, "points")), road.width_m)
                for index, road in enumerate(terrain.roads)
            ),
            buildings=buildings,
            vehicles=self._points(terrain.vehicles, ("terrain", "vehicles")),
        )

    def _patrol(
        self, name: str, robot: _Robot, robots: Sequence[str], land_cover: LandCover
    ) -> PatrolPlan | None:
        keys: Keys = ("robots", name)
        if name not in robots:
            known = ", ".join(robots) or "none"
            message = f"no ground robot '{name}' in the team; use one of {known}"
            self._report(keys, message, "unknown-robot")
            return None
        points = self._points(robot.patrol, (*keys, "patrol"))
        if len(points) < len(robot.patrol):
            return None
        patrol = Patrol(points, closed=robot.closed)
        for index, building in enumerate(land_cover.buildings):
            polygon = shapely.Polygon(building)
            if any(polygon.intersects(shapely.LineString(leg)) for leg in patrol.legs()):
                what = self._building_name(index)
                self._report(
                    (*keys, "patrol"),
                    f"the patrol of {name} drives through {what}; lead it around",
                    "patrol-through-building",
                )
        return PatrolPlan(patrol, robot.speed_m_s, robot.start_m)

    def _building_name(self, index: int) -> str:
        if self.model.explore or self.model.terrain.buildings is not None:
            return f"building {index + 1}"
        return f"the no-fly zone '{self._standing()[index].name}', which counts as a building"

    def _standing(self) -> list[Zone]:
        """The zones that stand on the ground, whatever the time is: others are only airspace."""
        return [
            zone
            for zone in self.mission.zones
            if zone.validity is None and (zone.band is None or zone.band.lower_m <= 0)
        ]

    def _rings(self, polygons: Sequence[list[list[float]]], keys: Keys) -> tuple[Ring, ...]:
        rings: list[Ring] = []
        for index, polygon in enumerate(polygons):
            points = self._points(polygon, (*keys, index))
            if len(points) < len(polygon):
                continue
            try:
                rings.append(checked_ring(points))
            except ZoneError as error:
                message = f"cannot be an area: {error}; draw it again"
                self._report((*keys, index), message, error.code)
        return tuple(rings)

    def _points(self, pairs: Iterable[list[float]], keys: Keys) -> tuple[Point, ...]:
        points: list[Point] = []
        for index, (first, second) in enumerate(pairs):
            try:
                points.append(self._point(first, second))
            except FrameError as error:
                message = f"{error}; correct it (latitude comes first)"
                self._report((*keys, index), message, "not-on-earth")
        return tuple(points)

    def _point(self, first: float, second: float) -> Point:
        point = Point(first, second)
        if self.model.coordinates == "degrees":
            point = self.mission.frame.to_local(first, second)
        if math.hypot(point.east_m, point.north_m) > 1e5:
            raise FrameError(f"{first}, {second} lies more than 100 km from the mission")
        return point

    def _report(self, keys: Keys, message: str, code: str) -> None:
        self.problems.append(self.document.problem(keys, message, code))
