"""The autopilot's geofence: PX4's test of points, not of legs.

Every area is tested by itself: a point is allowed if it is inside every inclusion and outside
every exclusion. A fence is in force some time after its upload, without the areas that home, or a
flying vehicle, violates then.
"""

import math
from dataclasses import dataclass
from typing import Final

from sitl.px4sim.failsafe import Action
from sitl.px4sim.plan_store import Command, MissionItem, MissionType, PlanStore
from sitl.px4sim.state import MapProjection, Notice, Severity, Situation

_CIRCLES: Final = frozenset({Command.FENCE_CIRCLE_INCLUSION, Command.FENCE_CIRCLE_EXCLUSION})
_INCLUSIONS: Final = frozenset({Command.FENCE_CIRCLE_INCLUSION, Command.FENCE_POLYGON_INCLUSION})
_LOAD_S: Final = 0.35  # PX4 has it in force 0.2 to 0.5 s after it acknowledged the upload
_CHECK_S: Final = 0.2
_ACTIONS: Final = {  # by GF_ACTION
    1: Action.WARN,
    2: Action.HOLD,
    3: Action.RTL,
    4: Action.TERMINATE,
    5: Action.LAND,
}


@dataclass(frozen=True, slots=True)
class FenceArea:
    """One polygon (vertices) or circle (centre, radius) in local metres (north, east)."""

    inclusion: bool
    vertices: tuple[tuple[float, float], ...]
    radius_m: float | None = None

    def allows(self, north_m: float, east_m: float) -> bool:
        """Whether a point is on the allowed side."""
        if self.radius_m is not None:
            inside = math.dist((north_m, east_m), self.vertices[0]) < self.radius_m
        else:
            inside = _inside(self.vertices, north_m, east_m)
        return inside == self.inclusion


def fence_areas(items: tuple[MissionItem, ...], projection: MapProjection) -> tuple[FenceArea, ...]:
    """The areas that a list of fence items describes.

    A polygon takes as many items as its first vertex counts, whatever they are, as in PX4. Behind a
    circle PX4 1.17 goes on item by item: every vertex begins a polygon, and one that would reach
    beyond the last item contains nothing.
    """
    areas: list[FenceArea] = []
    index = 0
    behind_circle = False
    while index < len(items):
        item = items[index]
        circle = item.command in _CIRCLES
        count = 1 if circle else max(1, int(item.params[0]))
        points = tuple(
            projection.to_local(*vertex.degrees) for vertex in items[index : index + count]
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


class Fence:
    """The fence in force.

    Attributes:
        violated: Whether the vehicle was on the wrong side at the last check.
    """

    def __init__(self, plan: PlanStore) -> None:
        self._plan = plan
        self._areas: tuple[FenceArea, ...] = ()  # in force
        self._identifier = 0  # checksum of the fence seen last; 0: none
        self._load_at_s: float | None = None  # simulated time; None: nothing to load
        self._checked_s = -math.inf  # simulated time of the last check
        self.violated = False

    @property
    def loading(self) -> bool:
        """Whether an uploaded fence is not in force yet."""
        return self._load_at_s is not None

    def load_if_due(self, situation: Situation) -> bool:
        """Take up an uploaded fence; whether that happened now."""
        identifier = self._plan.identifier(MissionType.FENCE)
        if identifier != self._identifier:
            self._identifier = identifier
            self._load_at_s = situation.time_s + _LOAD_S
        if self._load_at_s is None or situation.time_s < self._load_at_s:
            return False
        self._load_at_s = None
        areas = fence_areas(self._plan.items(MissionType.FENCE), situation.projection)
        self._areas = tuple(area for area in areas if self._fits(area, situation))
        return True

    def encloses(self, north_m: float, east_m: float) -> bool:
        """Whether a point violates no area."""
        return all(area.allows(north_m, east_m) for area in self._areas)

    def allows(self, north_m: float, east_m: float, situation: Situation) -> bool:
        """Whether the vehicle may go to a point: GF_MAX_HOR_DIST counts, too."""
        furthest_m, home = situation.parameters["GF_MAX_HOR_DIST"], situation.home
        near = home is None or furthest_m <= 0 or math.dist(home, (north_m, east_m)) < furthest_m
        return near and self.encloses(north_m, east_m)

    def breach(self, situation: Situation) -> Action:
        """The action on a breach that has just begun; checked five times a second."""
        action = _ACTIONS.get(int(situation.parameters["GF_ACTION"]), Action.NONE)
        if action is Action.NONE or situation.time_s - self._checked_s < _CHECK_S:
            return Action.NONE
        self._checked_s = situation.time_s
        before, self.violated = self.violated, self._breached(situation)
        if before or not self.violated or not situation.armed:
            return Action.NONE
        text = situation.parameters.behaviour.breach_text
        situation.notices.append(Notice(Severity.CRITICAL, text))
        return action

    def _breached(self, situation: Situation) -> bool:
        height_m = situation.altitude_m - situation.home_altitude_m
        highest_m = situation.parameters["GF_MAX_VER_DIST"]
        too_high = situation.home is not None and 0 < highest_m <= height_m
        return too_high or not self.allows(*situation.here, situation)

    def _fits(self, area: FenceArea, situation: Situation) -> bool:
        """Whether home and a flying vehicle keep to it; announces which of them does not."""
        fits = True
        if situation.home is not None and not area.allows(*situation.home):
            fits = False
            situation.announce("navigator_geofence_invalid_against_home")
        flying = situation.parameters["GF_ACTION"] > 0 and not situation.landed
        if flying and not area.allows(*situation.here):
            fits = False
            situation.announce("navigator_geofence_invalid_against_cur_pos")
        return fits
