"""One item of a plan on board: of the mission, of the fence, or a rally point."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType
from typing import Final

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


SAME_M: Final = 0.1
"""Places and altitudes that differ by less are flown alike."""

_E7_M: Final = 0.0111195
"""Metres of 1e-7 degrees of latitude."""

_FRAMES: Final[Mapping[Frame, Frame]] = MappingProxyType(
    {Frame.GLOBAL: Frame.GLOBAL_INT, Frame.RELATIVE_ALT: Frame.RELATIVE_ALT_INT}
)
"""Frames that mean the same as another."""


@dataclass(frozen=True, slots=True)
class PlanItem:
    """One MISSION_ITEM_INT: parameters as MAVLink numbers them, degrees in units of 1e-7.

    `z_m` is above home in frame RELATIVE_ALT_INT and without meaning in the others.
    """

    command: Command
    frame: Frame
    params: tuple[float, float, float, float]  # 1 to 4; 5 to 7 are x, y and z
    x_deg_e7: int = 0  # latitude
    y_deg_e7: int = 0  # longitude
    z_m: float = 0.0
    autocontinue: bool = False  # go on to the next item by itself

    def same_as(self, other: PlanItem) -> bool:
        """Whether the vehicle would fly the same: what a read-back has to hold to.

        A ground station that uploads a plan anew rounds it, and PX4 gives frames back as others.
        """
        return (
            self.command == other.command
            and _FRAMES.get(self.frame, self.frame) == _FRAMES.get(other.frame, other.frame)
            and self._apart_m(other) <= SAME_M
            and math.isclose(self.z_m, other.z_m, abs_tol=SAME_M)
            and self.autocontinue == other.autocontinue
            and all(
                # a circle of kilometres is a float of 32 bits on board
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
