"""What goes on board: the mission's nodes as plan items, and its fence.

The vehicle flies by jumping between the items (MISSION_SET_CURRENT in Mission mode), so every
node stops it: `autocontinue` is 0 everywhere but on the take-off. The pilot sees the operator's
own waypoints in the ground station, and Return, pause and the fence stay the autopilot's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from shapely import Point as ShapelyPoint

from geo.zone import Circle, Outline, Ring, Shape

if TYPE_CHECKING:
    from air_router.mission import Mission
    from geo.frame import LocalFrame, Point

HOME_NODE = 0
"""The node that hovers above home; the operator's waypoints count from 1."""


class Command(IntEnum):
    """MAV_CMD values that we put on board."""

    WAYPOINT = 16
    TAKEOFF = 22
    CHANGE_SPEED = 178
    FENCE_INCLUSION = 5001
    FENCE_EXCLUSION = 5002
    FENCE_CIRCLE_INCLUSION = 5003
    FENCE_CIRCLE_EXCLUSION = 5004


class Frame(IntEnum):
    """MAV_FRAME values that PX4 takes and gives back unchanged."""

    GLOBAL_INT = 5
    MISSION = 2
    RELATIVE_ALT_INT = 6


@dataclass(frozen=True, slots=True)
class PlanItem:
    """One MISSION_ITEM_INT: parameters as MAVLink numbers them, degrees in units of 1e-7.

    `z_m` is above home in frame RELATIVE_ALT_INT and without meaning in the others.
    """

    command: Command
    frame: Frame
    params: tuple[float, float, float, float]
    x_deg_e7: int = 0
    y_deg_e7: int = 0
    z_m: float = 0.0
    autocontinue: bool = False

    def same_as(self, other: PlanItem) -> bool:
        """Whether the vehicle would do the same: what a read-back has to hold to."""
        return (
            self.command == other.command
            and self.frame == other.frame
            and self.x_deg_e7 == other.x_deg_e7
            and self.y_deg_e7 == other.y_deg_e7
            and math.isclose(self.z_m, other.z_m, abs_tol=1e-3)
            and self.autocontinue == other.autocontinue
            and all(
                (math.isnan(a) and math.isnan(b)) or math.isclose(a, b, abs_tol=1e-3)
                for a, b in zip(self.params, other.params, strict=True)
            )
        )


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """Items and fence of a mission as they go on board, and which item is which node."""

    items: tuple[PlanItem, ...]
    fence: tuple[PlanItem, ...]
    first_node_item: int

    def item_of(self, node: int) -> int:
        """The plan item of a node (0 is home, then the operator's waypoint numbers)."""
        item = self.first_node_item + node
        if not self.first_node_item <= item < len(self.items):
            raise IndexError(f"no node {node} in a plan of {len(self.items)} items")
        return item

    def node_of(self, item: int) -> int | None:
        """The node of a plan item, None for speed and take-off."""
        node = item - self.first_node_item
        return node if 0 <= node < len(self.items) - self.first_node_item else None

    @classmethod
    def of(cls, mission: Mission) -> FlightPlan:
        """The plan of a mission: speed, take-off, the point above home, every waypoint."""
        x, y = _degrees_e7(mission.frame, mission.home)
        altitude_m = mission.altitude_above_home_m
        radius_m = mission.planner.acceptance_radius_m
        speed = PlanItem(
            Command.CHANGE_SPEED,
            Frame.MISSION,
            (1.0, mission.speed_m_s, -1.0, 0.0),
            autocontinue=True,
        )
        # Frame, position and NaN yaw as PX4 gives them back: what was sent can be compared.
        takeoff = PlanItem(
            Command.TAKEOFF,
            Frame.RELATIVE_ALT_INT,
            (0.0, 0.0, 0.0, math.nan),
            x,
            y,
            altitude_m,
            autocontinue=True,
        )
        nodes = [(mission.home, altitude_m)]
        nodes += [(w.position, w.altitude_above_home_m) for w in mission.waypoints]
        items = [speed, takeoff]
        for position, node_altitude_m in nodes:
            node_x, node_y = _degrees_e7(mission.frame, position)
            items.append(
                PlanItem(
                    Command.WAYPOINT,
                    Frame.RELATIVE_ALT_INT,
                    (0.0, radius_m, 0.0, math.nan),
                    node_x,
                    node_y,
                    node_altitude_m,
                )
            )
        return cls(
            items=tuple(items),
            fence=tuple(_fence_items(mission)),
            first_node_item=2,
        )


def _degrees_e7(frame: LocalFrame, point: Point) -> tuple[int, int]:
    latitude_deg, longitude_deg = frame.to_geodetic(point)
    return round(latitude_deg * 1e7), round(longitude_deg * 1e7)


def _fence_items(mission: Mission) -> list[PlanItem]:
    """The fence as PX4 takes it: circles, and polygons as runs of vertices that know their number.

    Only zones that apply where the mission cruises: PX4's have no altitude limits and no hours.
    """
    items = []
    for fence in mission.fences:
        items += _area_items(mission.frame, fence, inclusion=True)
        if isinstance(fence, Outline):
            for hole in fence.holes:
                items += _area_items(mission.frame, Outline(hole), inclusion=False)
    for zone in mission.airspace.zones:
        around = _hole_around(zone.shape, mission.home)
        if around is not None:
            items += _area_items(mission.frame, Outline(around), inclusion=True)
        else:
            items += _area_items(mission.frame, zone.shape, inclusion=False)
    return items


def _hole_around(shape: Shape, home: Point) -> Ring | None:
    """The hole of a zone that home lies in: the whole flight is in there."""
    holes = () if isinstance(shape, Circle) else shape.holes
    for hole in holes:
        if Outline(hole).polygon.contains(ShapelyPoint(home)):
            return hole
    return None


def _area_items(frame: LocalFrame, shape: Shape, *, inclusion: bool) -> list[PlanItem]:
    """One area; PX4 knows no holes, a zone's are out of reach from outside of it."""
    if isinstance(shape, Circle):
        command = Command.FENCE_CIRCLE_INCLUSION if inclusion else Command.FENCE_CIRCLE_EXCLUSION
        points: Ring = (shape.centre,)
        parameter = shape.radius_m
    else:
        command = Command.FENCE_INCLUSION if inclusion else Command.FENCE_EXCLUSION
        points, parameter = shape.ring, float(len(shape.ring))
    items = []
    for point in points:
        x, y = _degrees_e7(frame, point)
        parameters = (parameter, 0.0, 0.0, 0.0)
        items.append(PlanItem(command, Frame.GLOBAL_INT, parameters, x, y, autocontinue=True))
    return items
