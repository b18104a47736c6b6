"""Edits of mission files in YAML (see docs/mission-file.md), and of QGroundControl plans."""

from typing import Any, ClassVar

from air_router.editor import edits
from air_router.editor.changes import (
    Changes,
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
from air_router.files import Keys, metres, value_at
from air_router.files.missions import RELATIVE_FRAMES, MavCommand, simple_item

SECTIONS: dict[str, tuple[str, ...]] = {
    "planner": ("clearance_m", "tracking_margin_m", "max_edge_m"),
    "timers": ("init_s", "explore_s", "search_s", "communicate_s", "hold_s", "revisit_s"),
}
"""The settings of the page that stand in sections of a mission file."""

_SECTION_OF = {name: section for section, names in SECTIONS.items() for name in names}
_WORDS = ("name", "team", "uav")


class YamlChanges(Changes):
    """Of a mission file in YAML; see docs/mission-file.md."""

    settable: ClassVar[bool] = True

    def _find(self) -> None:
        data = self.data
        if not isinstance(data, dict):
            return
        frame = data.get("frame")
        origin = as_pair(frame.get("origin")) if isinstance(frame, dict) else None
        self.home = _spot(data.get("home"), ("home",), removable=False)
        self.in_metres = data.get("coordinates") == "local"
        self.origin = origin or (None if self.in_metres or not self.home else self.home.pair)
        self.waypoints = _spots(data, "waypoints")
        self.rally_points = _spots(data, "rally_points")
        if data.get("fence") is not None:
            self.regions.append(_region(data["fence"], ("fence",), "fence", None, is_fence=True))
        for keys, value in entries_of(data, ("fences",)):
            self.regions.append(_region(value, keys, "fence", keys, is_fence=True))
        for number, (keys, value) in enumerate(entries_of(data, ("no_fly_zones",)), start=1):
            name = value.get("name") if isinstance(value, dict) else None
            name = name if isinstance(name, str) else f"zone {number}"
            self.regions.append(_region(value, keys, name, keys, is_fence=False))

    def add_waypoint(self, edit: edits.AddWaypoint) -> None:
        """Insert a bare pair: it flies at the mission's altitude."""
        waypoints = self._list("waypoints")
        if edit.index > len(waypoints):
            raise EditError("the file has not so many waypoints; load the page again")
        waypoints.insert(edit.index, self.digits(edit.at))

    def add_rally_point(self, edit: edits.AddRallyPoint) -> None:
        """Add a pair to the list, which is begun if there is none."""
        self._list("rally_points").append(self.digits(edit.at))

    def add_area(self, edit: edits.AddArea) -> None:
        """Add a zone under a name of its own, or the fence where there is none."""
        corners = [self.digits(corner) for corner in edit.corners]
        shape: dict[str, Any] = {"polygon": corners}
        if edit.radius_m is not None:
            shape = {"circle": {"centre": corners[0], "radius_m": metres(edit.radius_m, 1)}}
        if not edit.fence:
            self._list("no_fly_zones").append({"name": self._unused_name(), **shape})
        elif self.data.get("fence") or self.data.get("fences"):
            raise EditError("the mission has a fence already; move its corners")
        else:
            self.data["fence"] = shape

    def rename(self, edit: edits.Rename) -> None:
        """Change the name, or give one to a zone that had none."""
        if self._region(edit.keys).is_fence:
            raise EditError("a fence has no name")
        self._long_form(edit.keys, "polygon")["name"] = edit.name

    def set_altitude(self, edit: edits.SetAltitude) -> None:
        """Write the altitude beside the position, or take it away."""
        handle = self._handle(edit.keys)
        if handle.entry is None or handle.keys[0] != "waypoints":
            raise EditError("only waypoints have altitudes of their own")
        if edit.altitude_m is not None:
            waypoint = self._long_form(handle.entry, "position")
            waypoint.setdefault("altitude_m", None)
            self._put(waypoint, "altitude_m", metres(edit.altitude_m))
        elif isinstance(waypoint := self._at(handle.entry), dict):
            waypoint.pop("altitude_m", None)

    def set_value(self, edit: edits.SetValue) -> None:
        """Change a setting, add it where the default was meant, or take it away."""
        name, value, values = edit.name, edit.value, self.data
        section = _SECTION_OF.get(name)
        if value is not None and isinstance(value, str) != (name in _WORDS):
            raise EditError(f"{name} cannot be '{value}'")
        if section is not None:
            if section in values and not isinstance(values[section], dict):
                raise EditError(f"{section} is empty in the file; write {section}.{name} by hand")
            if value is not None:
                values.setdefault(section, {})
            values = self._at((section,)) if section in values else {}
        if value is None:
            values.pop(name, None)
        elif isinstance(value, str):
            values[name] = value
        else:
            values.setdefault(name, None)
            self._put(values, name, metres(value))

    def seek(self, edit: edits.Seek) -> None:
        """Write the list of robots, whatever stood there."""
        if not edit.robots:
            raise EditError("a mission seeks at least one robot")
        seek = self.data.get("seek")
        if isinstance(seek, str):
            seek = {"policy": seek}
        if isinstance(seek, dict):
            self.data["seek"] = {**seek, "robots": [*edit.robots]}
        else:
            self.data["seek"] = [*edit.robots]

    def set_crossing(self, edit: edits.SetCrossing) -> None:
        """Write the key, or take it away."""
        if self._region(edit.keys).is_fence:
            raise EditError("only zones cross the fence")
        zone = self._long_form(edit.keys, "polygon")
        if edit.crosses:
            zone["crosses_fence"] = True
        else:
            zone.pop("crosses_fence", None)

    def redraw(self, edit: edits.Redraw) -> None:
        """Write other corners, in the place of a circle too."""
        self._region(edit.keys)
        corners = [self.digits(corner) for corner in edit.corners]
        area = self._at(edit.keys)
        if isinstance(area, list):
            area[:] = corners
        else:
            area.pop("circle", None)
            area["polygon"] = corners

    def _list(self, name: str) -> list[Any]:
        """A list of the file, begun if there is none."""
        if self.data.get(name) is None:
            self.data[name] = []
        values: list[Any] = self._at((name,))
        return values

    def _long_form(self, keys: Keys, key: str) -> dict[str, Any]:
        """An entry as a mapping; one in short form becomes one, with its value under a key."""
        parent, index = self._at(keys[:-1]), keys[-1]
        if not isinstance(parent[index], dict):
            parent[index] = {key: parent[index]}
        entry: dict[str, Any] = self._at(keys)
        return entry

    def _unused_name(self) -> str:
        names = {region.name for region in self.regions}
        number = sum(not region.is_fence for region in self.regions) + 1
        while f"zone {number}" in names:
            number += 1
        return f"zone {number}"


def _spots(data: dict[Any, Any], name: str) -> list[Handle]:
    spots = (_spot(value, keys, removable=True) for keys, value in entries_of(data, (name,)))
    return [spot for spot in spots if spot is not None]


def _spot(value: Any, keys: Keys, *, removable: bool) -> Handle | None:
    if isinstance(value, dict):
        value = value.get("position")
    return handle_of(value, (*keys, "position"), keys if removable else None)


def _region(value: Any, keys: Keys, name: str, entry: Keys | None, *, is_fence: bool) -> Region:
    area = {"polygon": value} if isinstance(value, list) else value
    if not isinstance(area, dict):
        return Region(keys, name, is_fence, entry=entry)
    rings = [ring_of(area.get("polygon"), (*keys, "polygon"))]
    rings += [ring_of(hole, (*keys, *path)) for path, hole in entries_of(area, ("holes",))]
    circle = circle_of(area.get("circle"), (*keys, "circle"), centre="centre", radius="radius_m")
    return Region(keys, name, is_fence, tuple(r for r in rings if r), circle, entry)


# Edits of QGroundControl plans.


ITEMS: Keys = ("mission", "items")
POLYGONS: Keys = ("geoFence", "polygons")
CIRCLES: Keys = ("geoFence", "circles")
RALLY_POINTS: Keys = ("rallyPoints", "points")
"""The lists of a QGroundControl plan."""

_DEFAULT_ALTITUDE_M = 30.0


class PlanChanges(Changes):
    """Of a QGroundControl plan."""

    settable: ClassVar[bool] = False

    def _find(self) -> None:
        """Find what can be moved; what surveys are made of stays with QGroundControl."""
        data = self.data
        home: Keys = ("mission", "plannedHomePosition")
        self.home = handle_of(value_at(data, home), home)
        self.origin = self.home.pair if self.home else None
        for keys, item in entries_of(data, ITEMS):
            handle = _plan_waypoint(item, keys)
            self.waypoints += [handle] if handle else []
        for keys, point in entries_of(data, RALLY_POINTS):
            handle = handle_of(point, keys, keys)
            self.rally_points += [handle] if handle else []
        for path in (POLYGONS, CIRCLES):
            for keys, value in entries_of(data, path):
                if isinstance(value, dict):
                    self.regions.append(self._region_of(value, keys))

    def add_waypoint(self, edit: edits.AddWaypoint) -> None:
        """Insert a simple item behind the waypoint before it, at the same altitude."""
        waypoints = self.waypoints
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
        self._at(ITEMS).insert(position, simple_item(MavCommand.WAYPOINT, params, number=number))

    def add_rally_point(self, edit: edits.AddRallyPoint) -> None:
        """Add a point at home's altitude, which is what they count from."""
        if not isinstance(value_at(self.data, RALLY_POINTS), list):
            raise EditError("the plan has no list of rally points; save it with QGroundControl")
        self._at(RALLY_POINTS).append([*self.digits(edit.at), metres(0)])

    def add_area(self, edit: edits.AddArea) -> None:
        """Add an inclusion or exclusion polygon or circle."""
        path = POLYGONS if edit.radius_m is None else CIRCLES
        if not isinstance(value_at(self.data, path), list):
            raise EditError("the plan has no list of fences; save it with QGroundControl")
        corners = [self.digits(corner) for corner in edit.corners]
        area: dict[str, Any] = {"inclusion": edit.fence, "polygon": corners, "version": 1}
        if edit.radius_m is not None:
            circle = {"center": corners[0], "radius": metres(edit.radius_m, 1)}
            area = {"circle": circle, "inclusion": edit.fence, "version": 1}
        self._at(path).append(area)

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
        if handle not in self.waypoints:
            raise EditError("only waypoints have altitudes of their own")
        if edit.altitude_m is None:
            raise EditError("in a plan every waypoint has its own altitude")
        if self._relative_altitude_m(handle) is None:
            raise EditError("its altitude does not count from home; edit it in QGroundControl")
        altitude_m, keys = metres(edit.altitude_m), handle.keys[: len(ITEMS) + 1]
        self._put(self._at((*keys, "params")), 6, altitude_m)
        item = self._at(keys)
        if as_number(item.get("Altitude")) is not None:
            self._put(item, "Altitude", altitude_m)

    def _region_of(self, value: dict[Any, Any], keys: Keys) -> Region:
        is_fence = value.get("inclusion") is True
        number = sum(not region.is_fence for region in self.regions) + 1
        name = "fence" if is_fence else f"zone {number}"
        ring = ring_of(value.get("polygon"), (*keys, "polygon"))
        circle = circle_of(value.get("circle"), (*keys, "circle"), centre="center", radius="radius")
        return Region(keys, name, is_fence, (ring,) if ring else (), circle, keys)

    def _item(self, handle: Handle) -> dict[str, Any]:
        item: dict[str, Any] = self._at(handle.keys[: len(ITEMS) + 1])
        return item

    def _relative_altitude_m(self, handle: Handle) -> float | None:
        item = self._item(handle)
        return as_number(item["params"][6]) if item.get("frame") in RELATIVE_FRAMES else None


def _plan_waypoint(item: Any, keys: Keys) -> Handle | None:
    if not isinstance(item, dict) or item.get("command") != MavCommand.WAYPOINT:
        return None
    params = item.get("params")
    if item.get("type") != "SimpleItem" or not isinstance(params, list) or len(params) < 7:
        return None
    pair = as_pair(params[4:6])
    return Handle((*keys, "params", 4), pair, keys) if pair else None
