"""One item of a plan on board: of the mission, of the fence, or a rally point."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from geo.frame import LocalFrame, Point


class Command(IntEnum):
    """MAV_CMD values that we put on board."""

    WAYPOINT = 16
    TAKEOFF = 22
    CHANGE_SPEED = 178
    FENCE_INCLUSION = 5001
    FENCE_EXCLUSION = 5002
    FENCE_CIRCLE_INCLUSION = 5003
    FENCE_CIRCLE_EXCLUSION = 5004
    RALLY_POINT = 5100


class Frame(IntEnum):
    """MAV_FRAME values: those that PX4 gives back unchanged, and two that it makes of them."""

    GLOBAL_INT = 5
    MISSION = 2
    RELATIVE_ALT_INT = 6
    GLOBAL = 0
    RELATIVE_ALT = 3


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
                # a circle of kilometres is a float of 32 bits on board
                (math.isnan(a) and math.isnan(b)) or math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-3)
                for a, b in zip(self.params, other.params, strict=True)
            )
        )


def degrees_e7(frame: LocalFrame, point: Point) -> tuple[int, int]:
    """Latitude and longitude in units of 1e-7 degrees: at most 8 mm away from the point."""
    latitude_deg, longitude_deg = frame.to_geodetic(point)
    return round(latitude_deg * 1e7), round(longitude_deg * 1e7)
