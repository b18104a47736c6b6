"""Edits of QGroundControl plans."""

from typing import Any, ClassVar

from air_router.editor import edits
from air_router.editor.changes import (
    Changes,
    Features,
    Handle,
    Region,
    as_number,
    as_pair,
    circle_of,
    entries_of,
    handle_of,
    ring_of,
)
from air_router.editor.edits import EditError
from air_router.files.json_document import value_at
from air_router.files.mission_document import Keys
from air_router.files.missions.qgc_items import RELATIVE_FRAMES, MavCommand
from air_router.files.missions.qgc_write import simple_item
from air_router.files.yaml_text import metres

ITEMS: Keys = ("mission", "items")
POLYGONS: Keys = ("geoFence", "polygons")
CIRCLES: Keys = ("geoFence", "circles")
RALLY_POINTS: Keys = ("rallyPoints", "points")
"""The lists of a QGroundControl plan."""

_DEFAULT_ALTITUDE_M = 30.0


class PlanChanges(Changes):
    """Of a QGroundControl plan."""

    settable: ClassVar[bool] = False

    @staticmethod
    def features_of(data: Any) -> Features:
        """What can be moved."""
        return plan_features(data)

    def add_waypoint(self, edit: edits.AddWaypoint) -> None:
        """Insert a simple item behind the waypoint before it, at the same altitude."""
        waypoints = self.features.waypoints
        if edit.index > len(waypoints):
            raise EditError(f"the mission has only {len(waypoints)} waypoints")
        items = value_at(self.data, ITEMS)
        if not isinstance(items, list):
            raise EditError("the plan has no list of items; save it with QGroundControl")
        position, altitude_m = len(items), _DEFAULT_ALTITUDE_M
        if waypoints:
            neighbour = waypoints[max(edit.index - 1, 0)]
            position = int(neighbour.keys[len(ITEMS)]) + (1 if edit.index else 0)
            altitude_m = self._relative_altitude_m(neighbour) or _DEFAULT_ALTITUDE_M
        used = [item.get("doJumpId") for item in items if isinstance(item, dict)]
        number = max((n for n in used if isinstance(n, int)), default=0) + 1
        params = [0, 0, 0, None, *self.digits(edit.at), metres(altitude_m)]
        items.insert(position, simple_item(MavCommand.WAYPOINT, params, number=number))

    def add_rally_point(self, edit: edits.AddRallyPoint) -> None:
        """Add a point at home's altitude, which is what they count from."""
        points = value_at(self.data, RALLY_POINTS)
        if not isinstance(points, list):
            raise EditError("the plan has no list of rally points; save it with QGroundControl")
        points.append([*self.digits(edit.at), metres(0)])

    def add_area(self, edit: edits.AddArea) -> None:
        """Add an inclusion or exclusion polygon or circle."""
        areas = value_at(self.data, POLYGONS if edit.radius_m is None else CIRCLES)
        if not isinstance(areas, list):
            raise EditError("the plan has no list of fences; save it with QGroundControl")
        corners = [self.digits(corner) for corner in edit.corners]
        area: dict[str, Any] = {"inclusion": edit.fence, "polygon": corners, "version": 1}
        if edit.radius_m is not None:
            circle = {"center": corners[0], "radius": metres(edit.radius_m, 1)}
            area = {"circle": circle, "inclusion": edit.fence, "version": 1}
        areas.append(area)

    def redraw(self, edit: edits.Redraw) -> None:
        """Polygons stand in a list of their own."""
        region = self._region(edit.keys)
        if region.circle is None:
            self._at(region.rings[0].keys)[:] = [self.digits(corner) for corner in edit.corners]
        else:
            self._take_out(region.keys)
            self.add_area(edits.AddArea(do="add_area", fence=region.is_fence, corners=edit.corners))

    def set_altitude(self, edit: edits.SetAltitude) -> None:
        """Write the altitude, and QGroundControl's copy of it."""
        handle = self._handle(edit.keys)
        if handle not in self.features.waypoints:
            raise EditError("only waypoints have altitudes of their own")
        if edit.altitude_m is None:
            raise EditError("in a plan every waypoint has its own altitude")
        if self._relative_altitude_m(handle) is None:
            raise EditError("its altitude does not count from home; edit it in QGroundControl")
        item, altitude_m = self._item(handle), metres(edit.altitude_m)
        self._put(item["params"], 6, altitude_m)
        if as_number(item.get("Altitude")) is not None:
            self._put(item, "Altitude", altitude_m)

    def _item(self, handle: Handle) -> dict[str, Any]:
        item: dict[str, Any] = self._at(handle.keys[: len(ITEMS) + 1])
        return item

    def _relative_altitude_m(self, handle: Handle) -> float | None:
        item = self._item(handle)
        return as_number(item["params"][6]) if item.get("frame") in RELATIVE_FRAMES else None


def plan_features(data: Any) -> Features:
    """The features of a QGroundControl plan; what surveys are made of stays with that program."""
    features = Features()
    home: Keys = ("mission", "plannedHomePosition")
    features.home = handle_of(value_at(data, home), home)
    features.origin = features.home.pair if features.home else None
    for keys, item in entries_of(data, ITEMS):
        handle = _plan_waypoint(item, keys)
        features.waypoints += [handle] if handle else []
    for keys, point in entries_of(data, RALLY_POINTS):
        handle = handle_of(point, keys, keys)
        features.rally_points += [handle] if handle else []
    for path in (POLYGONS, CIRCLES):
        for keys, value in entries_of(data, path):
            if isinstance(value, dict):
                features.regions.append(_plan_region(features, value, keys))
    return features


def _plan_waypoint(item: Any, keys: Keys) -> Handle | None:
    if not isinstance(item, dict) or item.get("command") != MavCommand.WAYPOINT:
        return None
    params = item.get("params")
    if item.get("type") != "SimpleItem" or not isinstance(params, list) or len(params) < 7:
        return None
    pair = as_pair(params[4:6])
    return Handle((*keys, "params", 4), (*keys, "params"), 4, pair, keys) if pair else None


def _plan_region(features: Features, value: dict[Any, Any], keys: Keys) -> Region:
    is_fence = value.get("inclusion") is True
    number = sum(not region.is_fence for region in features.regions) + 1
    name = "fence" if is_fence else f"zone {number}"
    ring = ring_of(value.get("polygon"), (*keys, "polygon"))
    circle = circle_of(value.get("circle"), (*keys, "circle"), centre="center", radius="radius")
    return Region(keys, name, is_fence, (ring,) if ring else (), circle, keys)
