"""The plan to upload: the mission's nodes as plan items, the fence and the rally points.

The companion flies the vehicle by jumps between items (MISSION_SET_CURRENT in Mission mode), so the
vehicle stops at every node: `autocontinue` is 0 except on take-off. The ground station shows the
operator's own waypoints, and PX4 itself keeps providing Return, pause and fence.

PX4's fence is the second line of defence. Its areas are circles and polygons without holes, with
sides that are straight in degrees, without altitude limits, hours or clearance. The vehicle stays
inside every inclusion and outside every exclusion. The companion alone enforces the rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from types import MappingProxyType
from typing import Final

import numpy as np
import shapely
from shapely import LinearRing
from shapely import Point as ShapelyPoint

from air_router.mission.mission import Mission
from geo.airspace import Circle, Outline, Ring, Shape
from geo.frame import LocalFrame, Point, stepped


class Command(IntEnum):
    """MAV_CMD values of the items that we upload."""

    WAYPOINT = 16
    TAKEOFF = 22
    CHANGE_SPEED = 178
    FENCE_INCLUSION = 5001
    FENCE_EXCLUSION = 5002
    FENCE_CIRCLE_INCLUSION = 5003
    FENCE_CIRCLE_EXCLUSION = 5004
    RALLY_POINT = 5100


class Frame(IntEnum):
    """MAV_FRAME values: three that PX4 returns unchanged, and two that it may return instead."""

    GLOBAL_INT = 5
    MISSION = 2
    RELATIVE_ALT_INT = 6
    GLOBAL = 0
    RELATIVE_ALT = 3


SAME_M: Final = 0.1
"""Places and altitudes that differ by less are equal."""

_E7_M: Final = 0.0111195
"""Metres of 1e-7 degrees of latitude."""

_FRAMES: Final[Mapping[Frame, Frame]] = MappingProxyType(
    {Frame.GLOBAL: Frame.GLOBAL_INT, Frame.RELATIVE_ALT: Frame.RELATIVE_ALT_INT}
)
"""Frames that are equivalent to another."""


@dataclass(frozen=True, slots=True)
class PlanItem:
    """One MISSION_ITEM_INT: parameters numbered as in MAVLink, degrees in units of 1e-7.

    `z_m` is above home in frame RELATIVE_ALT_INT, and unused in other frames.
    """

    command: Command
    frame: Frame
    params: tuple[float, float, float, float]  # 1 to 4; 5 to 7 are x, y and z
    x_deg_e7: int = 0  # latitude
    y_deg_e7: int = 0  # longitude
    z_m: float = 0.0
    autocontinue: bool = False  # PX4 continues with the next item

    def same_as(self, other: PlanItem) -> bool:
        """Whether the vehicle would fly both alike; used to compare a read-back.

        A ground station that uploads the plan again rounds it, and PX4 returns equivalent frames.
        """
        return (
            self.command == other.command
            and _FRAMES.get(self.frame, self.frame) == _FRAMES.get(other.frame, other.frame)
            and self._apart_m(other) <= SAME_M
            and math.isclose(self.z_m, other.z_m, abs_tol=SAME_M)
            and self.autocontinue == other.autocontinue
            and all(
                # PX4 stores the radius of a large circle as a 32-bit float
                (math.isnan(a) and math.isnan(b)) or math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-2)
                for a, b in zip(self.params, other.params, strict=True)
            )
        )

    def _apart_m(self, other: PlanItem) -> float:
        """Horizontal distance between two items that are near to each other."""
        north_m = (self.x_deg_e7 - other.x_deg_e7) * _E7_M
        east_m = (self.y_deg_e7 - other.y_deg_e7) * _E7_M
        return math.hypot(north_m, east_m * math.cos(math.radians(self.x_deg_e7 / 1e7)))


def degrees_e7(frame: LocalFrame, point: Point) -> tuple[int, int]:
    """Latitude and longitude in units of 1e-7 degrees: at most 8 mm away from the point."""
    latitude_deg, longitude_deg = frame.to_geodetic(point)
    return round(latitude_deg * 1e7), round(longitude_deg * 1e7)


# The fence


FENCE_POINTS: Final = 64
"""Fence points that PX4 1.17 stores by default; a circle is one point, a polygon its corners."""

FENCE_TOO_LONG: Final = "fence-points"
"""Code of the note that the fence has more points, which PX4 would refuse."""

_STEP_M: Final = 2_000.0
"""Longer sides get corners in between, because they are not straight in degrees."""

_STRAIGHT_E7: Final = 1.5
"""Corners this near to the straight line between others (1e-7 degrees, 1 cm) are omitted."""

_CIRCLES: Final = frozenset({Command.FENCE_CIRCLE_INCLUSION, Command.FENCE_CIRCLE_EXCLUSION})

_HALF_TURN_E7: Final = 180 * 10**7


@dataclass(frozen=True, slots=True)
class FencePlan:
    """The fence as items, and the areas that the items cannot represent.

    Attributes:
        items: To upload. Each vertex of a polygon has the number of its vertices; circles are last.
        simpler: Name and reason of each area that PX4 cannot enforce as drawn.
    """

    items: tuple[PlanItem, ...]
    simpler: tuple[tuple[str, str], ...]


def fence_plan(mission: Mission) -> FencePlan:
    """The fence of a mission, without zones that lie outside it or do not apply."""
    items: list[PlanItem] = []
    simpler: list[tuple[str, str]] = []

    def add(name: str, shape: Shape, *, inclusion: bool) -> None:
        area = _area_items(mission.frame, shape, inclusion=inclusion)
        if not area:
            simpler.append((name, "it lies on the antimeridian, where PX4's test fails"))
        items.extend(area)

    for fence in mission.fences:
        add("fence", fence, inclusion=True)
        for hole in fence.holes if isinstance(fence, Outline) else ():
            add("fence", Outline(hole), inclusion=False)
    inside = shapely.intersection_all([fence.polygon for fence in mission.fences])
    for zone in mission.airspace.zones:
        if mission.fences and not inside.intersects(zone.polygon):
            continue
        around = _hole_around(zone.shape, mission.home)
        if around is not None:
            add(zone.name, Outline(around), inclusion=True)
        else:
            add(zone.name, zone.shape, inclusion=False)
    simpler += [
        (idle.zone.name, "PX4 would apply it at all altitudes, and the mission flies above it")
        for idle in mission.idle_zones
        if idle.below
    ]
    # PX4 1.17 reads every corner after a circle as another circle.
    items.sort(key=lambda item: item.command in _CIRCLES)
    return FencePlan(tuple(items), tuple(simpler))


def _hole_around(shape: Shape, home: Point) -> Ring | None:
    """The hole of a zone that contains home, and so the whole flight.

    The vehicle cannot reach other holes, so that PX4 may treat them as part of the zone.
    """
    for hole in () if isinstance(shape, Circle) else shape.holes:
        if Outline(hole).polygon.contains(ShapelyPoint(home)):
            return hole
    return None


@lru_cache(maxsize=2_000)
def _area_items(frame: LocalFrame, shape: Shape, *, inclusion: bool) -> tuple[PlanItem, ...]:
    """The items of one area; none if PX4 cannot test it. Cached: most edits keep most areas."""
    if isinstance(shape, Circle):
        command = Command.FENCE_CIRCLE_INCLUSION if inclusion else Command.FENCE_CIRCLE_EXCLUSION
        corners, parameter = [degrees_e7(frame, shape.centre)], shape.radius_m
    else:
        command = Command.FENCE_INCLUSION if inclusion else Command.FENCE_EXCLUSION
        corners = _corners_e7(frame, shape.ring)
        parameter = float(len(corners))
    parameters = (parameter, 0.0, 0.0, 0.0)
    return tuple(
        PlanItem(command, Frame.GLOBAL_INT, parameters, x, y, autocontinue=True) for x, y in corners
    )


def _corners_e7(frame: LocalFrame, ring: Ring) -> list[tuple[int, int]]:
    """The corners of a ring with sides straight in degrees; none if it crosses 180 degrees."""
    sides = zip(ring, (*ring[1:], ring[0]), strict=True)
    dense = [place for start, end in sides for place in stepped(start, end, _STEP_M)]
    corners = np.rint(frame.to_geodetic_many(dense) * 1e7)
    if np.ptp(corners[:, 1]) > _HALF_TURN_E7:
        return []
    needed = shapely.get_coordinates(LinearRing(corners).simplify(_STRAIGHT_E7))[:-1]
    return [(int(x), int(y)) for x, y in needed]


# The whole plan


HOME_NODE = 0
"""The node above home; the operator's waypoints are nodes 1, 2 ..."""

_FIRST_NODE_ITEM = 2
"""The item of that node, after speed and take-off."""


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """The plan to upload, and the mapping between its items and the mission's nodes.

    Attributes:
        items: Speed, take-off and nodes.
        fence: Vertices and circles of fences and zones.
        rally: Landing places of PX4's own Return besides home.
    """

    items: tuple[PlanItem, ...]
    fence: tuple[PlanItem, ...]
    rally: tuple[PlanItem, ...]

    @property
    def size(self) -> str:
        """Its size, as text."""
        fence, rally = len(self.fence), len(self.rally)
        return f"{len(self.items)} items, {fence} fence points, {rally} rally points"

    def item_of(self, node: int) -> int:
        """The plan item of a node (0 is home, then the operator's waypoint numbers)."""
        item = _FIRST_NODE_ITEM + node
        if not _FIRST_NODE_ITEM <= item < len(self.items):
            raise IndexError(f"no node {node} in a plan of {len(self.items)} items")
        return item

    def node_of(self, item: int) -> int | None:
        """The node of a plan item, None for speed and take-off."""
        node = item - _FIRST_NODE_ITEM
        return node if 0 <= node < len(self.items) - _FIRST_NODE_ITEM else None

    @classmethod
    def of(cls, mission: Mission) -> FlightPlan:
        """The plan of a mission: speed, take-off, the point above home, every waypoint."""
        altitude_m = mission.altitude_above_home_m
        speed_params = (1.0, mission.speed_m_s, -1.0, 0.0)
        speed = PlanItem(Command.CHANGE_SPEED, Frame.MISSION, speed_params, autocontinue=True)
        takeoff = _place_item(mission, Command.TAKEOFF, mission.home, altitude_m, autocontinue=True)
        nodes = [(mission.home, altitude_m)]
        # PX4 rejects a plan with a waypoint in a zone, so skipped waypoints move above home.
        out = mission.skipped
        nodes += [
            (mission.home if w.number in out else w.position, w.altitude_above_home_m)
            for w in mission.waypoints
        ]
        hovers = [_place_item(mission, Command.WAYPOINT, *node) for node in nodes]
        return cls(
            items=(speed, takeoff, *hovers),
            fence=fence_plan(mission).items,
            rally=tuple(_rally_point(mission, place) for place in mission.landings),
        )


def _place_item(
    mission: Mission,
    command: Command,
    place: Point,
    altitude_m: float,
    *,
    autocontinue: bool = False,
) -> PlanItem:
    """An item at a place, with frame, position and NaN yaw as PX4 returns them.

    So the read-back can be compared with it. Only a waypoint has a radius.
    """
    radius_m = mission.planner.acceptance_radius_m if command is Command.WAYPOINT else 0.0
    params = (0.0, radius_m, 0.0, math.nan)
    x, y = degrees_e7(mission.frame, place)
    return PlanItem(command, Frame.RELATIVE_ALT_INT, params, x, y, altitude_m, autocontinue)


def _rally_point(mission: Mission, place: Point) -> PlanItem:
    # Altitude 0: a mission assumes that the ground is everywhere as high as at home.
    # PX4 1.17's Return does not support INT frames: it skips such a point with a warning.
    x, y = degrees_e7(mission.frame, place)
    return PlanItem(Command.RALLY_POINT, Frame.RELATIVE_ALT, (0.0, 0.0, 0.0, 0.0), x, y)
