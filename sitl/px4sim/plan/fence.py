"""The autopilot's geofence: PX4's test of points, not of legs.

Every area is tested by itself: a point is allowed if it is inside every inclusion and outside
every exclusion. An area that home, or a flying vehicle, violates is left out when it is loaded.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from sitl.px4sim.motion.projection import MapProjection
from sitl.px4sim.plan.mission_items import Command, MissionItem

_CIRCLES = frozenset({Command.FENCE_CIRCLE_INCLUSION, Command.FENCE_CIRCLE_EXCLUSION})
_INCLUSIONS = frozenset({Command.FENCE_CIRCLE_INCLUSION, Command.FENCE_POLYGON_INCLUSION})


@dataclass(frozen=True, slots=True)
class FenceArea:
    """One polygon (vertices) or circle (centre, radius) in local metres (north, east)."""

    inclusion: bool
    vertices: tuple[tuple[float, float], ...]
    radius_m: float | None = None

    def allows(self, north_m: float, east_m: float) -> bool:
        """Whether a point is on the allowed side."""
        if self.radius_m is not None:
            north, east = self.vertices[0]
            inside = math.hypot(north_m - north, east_m - east) < self.radius_m
        else:
            inside = _inside(self.vertices, north_m, east_m)
        return inside == self.inclusion


class FenceConflict(Enum):
    """Why an area is left out."""

    HOME = "home"
    VEHICLE = "vehicle"


class Fence:
    """All areas that are in force."""

    def __init__(self) -> None:
        self._areas: tuple[FenceArea, ...] = ()  # without those left out for a conflict

    def load(
        self,
        areas: tuple[FenceArea, ...],
        home: tuple[float, float] | None,
        vehicle: tuple[float, float] | None,
        report: Callable[[FenceConflict], None],
    ) -> None:
        """Replace the fence.

        Args:
            areas: From `fence_areas`.
            home: North, east in metres, if known.
            vehicle: North, east in metres, if it flies.
            report: Called once for each reason and area that is left out.
        """
        kept = []
        for area in areas:
            fits = True
            for point, conflict in (
                (home, FenceConflict.HOME),
                (vehicle, FenceConflict.VEHICLE),
            ):
                if point is not None and not area.allows(*point):
                    report(conflict)
                    fits = False
            if fits:
                kept.append(area)
        self._areas = tuple(kept)

    def allows(self, north_m: float, east_m: float) -> bool:
        """Whether a point violates no area."""
        return all(area.allows(north_m, east_m) for area in self._areas)


def fence_areas(items: tuple[MissionItem, ...], projection: MapProjection) -> tuple[FenceArea, ...]:
    """The areas that a list of fence items describes.

    A polygon takes as many items as its first vertex says, whatever they are, as in PX4. Behind a
    circle PX4 1.17 goes on item by item: every vertex begins a polygon, and one that would reach
    beyond the last item contains nothing.
    """
    areas: list[FenceArea] = []
    index = 0
    behind_circle = False
    while index < len(items):
        item = items[index]
        if item.command == Command.FENCE_RETURN_POINT:
            index += 1
            continue
        circle = item.command in _CIRCLES
        count = 1 if circle else max(1, int(item.params[0]))
        points = tuple(
            projection.to_local(vertex.latitude_deg, vertex.longitude_deg)
            for vertex in items[index : index + count]
        )
        radius_m = item.params[0] if circle else None
        whole = points if len(points) == count else ()
        areas.append(FenceArea(item.command in _INCLUSIONS, whole, radius_m))
        behind_circle |= circle
        index += 1 if behind_circle else count
    return tuple(areas)


def _inside(ring: tuple[tuple[float, float], ...], north_m: float, east_m: float) -> bool:
    inside = False
    last_north, last_east = ring[-1] if ring else (0.0, 0.0)
    for north, east in ring:
        if (east >= east_m) != (last_east >= east_m) and (
            north_m <= (last_north - north) * (east_m - east) / (last_east - east) + north
        ):
            inside = not inside
        last_north, last_east = north, east
    return inside
