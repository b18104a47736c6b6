"""What goes on board: the mission's nodes as plan items, its fence and its rally points.

The vehicle flies by jumping between the items (MISSION_SET_CURRENT in Mission mode), so every
node stops it: `autocontinue` is 0 everywhere but on the take-off. The pilot sees the operator's
own waypoints in the ground station, and Return, pause and the fence stay the autopilot's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from air_router.mission.fence_plan import fence_plan
from air_router.mission.mission import Mission
from air_router.mission.plan_item import Command, Frame, PlanItem, degrees_e7
from geo.frame import Point

__all__ = ["HOME_NODE", "Command", "FlightPlan", "Frame", "PlanItem"]

HOME_NODE = 0
"""The node that hovers above home; the operator's waypoints count from 1."""


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """What goes on board of a mission, and which item is which node.

    Attributes:
        items: speed, take-off and nodes.
        fence: the vertices and circles of fences and zones.
        rally: where the autopilot's own return may land beside home.
        first_node_item: the item of node 0.
    """

    items: tuple[PlanItem, ...]
    fence: tuple[PlanItem, ...]
    rally: tuple[PlanItem, ...]
    first_node_item: int

    @property
    def size(self) -> str:
        """How much it is, in words."""
        fence, rally = len(self.fence), len(self.rally)
        return f"{len(self.items)} items, {fence} fence points, {rally} rally points"

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
        x, y = degrees_e7(mission.frame, mission.home)
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
        # A waypoint that a zone was drawn over is not flown to; with it in there PX4 flies nothing.
        out = mission.skipped
        nodes += [
            (mission.home if w.number in out else w.position, w.altitude_above_home_m)
            for w in mission.waypoints
        ]
        items = [speed, takeoff]
        for position, node_altitude_m in nodes:
            node_x, node_y = degrees_e7(mission.frame, position)
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
            fence=fence_plan(mission).items,
            rally=tuple(_rally_point(mission, place) for place in mission.landings),
            first_node_item=2,
        )


def _rally_point(mission: Mission, place: Point) -> PlanItem:
    # Height 0: the ground there is taken to be as high as home's, as everywhere in a mission.
    # Return in PX4 1.17 knows no INT frames: with one it passes over the point, and complains.
    x, y = degrees_e7(mission.frame, place)
    return PlanItem(Command.RALLY_POINT, Frame.RELATIVE_ALT, (0.0, 0.0, 0.0, 0.0), x, y)
