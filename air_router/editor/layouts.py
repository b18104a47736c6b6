"""Where the parts stand in mission files (YAML, docs/mission-file.md) and QGroundControl plans."""

from collections.abc import Sequence
from typing import Any, ClassVar

from air_router.editor.parts import (
    EditError,
    Handle,
    Pair,
    Parts,
    Region,
    as_number,
    as_pair,
    circle_of,
    entries_of,
    handle_of,
    ring_of,
)
from air_router.files import Keys, metres, value_at
from air_router.files.missions import RELATIVE_FRAMES, MavCommand, simple_item


class YamlParts(Parts):
    """Of a mission file in YAML."""

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

    def insert_waypoint(self, index: int, place: Pair) -> None:
        """Insert a bare pair: it flies at the mission's altitude."""
        waypoints = self._list("waypoints")
        if index > len(waypoints):
            raise EditError("the file has not so many waypoints; load the page again")
        waypoints.insert(index, self.digits(place))

    def add_rally_point(self, place: Pair) -> None:
        """Add a pair to the list, which is begun if there is none."""
        self._list("rally_points").append(self.digits(place))

    def add_area(self, corners: Sequence[Pair], radius_m: float | None, *, fence: bool) -> None:
        """Add a zone under a name of its own, or the fence where there is none."""
        ring = [self.digits(corner) for corner in corners]
        shape: dict[str, Any] = {"polygon": ring}
        if radius_m is not None:
            shape = {"circle": {"centre": ring[0], "radius_m": metres(radius_m, 1)}}
        if not fence:
            self._list("no_fly_zones").append({"name": self._unused_name(), **shape})
        elif self.data.get("fence") or self.data.get("fences"):
            raise EditError("the mission has a fence already; move its corners")
        else:
            self.data["fence"] = shape

    def redraw(self, region: Region, corners: Sequence[Pair]) -> None:
        """Write other corners where the old ones, or the circle, are."""
        ring = [self.digits(corner) for corner in corners]
        area = self.at(region.keys)
        if isinstance(area, list):
            area[:] = ring
        else:
            area.pop("circle", None)
            area["polygon"] = ring

    def set_altitude(self, waypoint: Handle, altitude_m: float | None) -> None:
        """Write the altitude beside the position, or take it away."""
        if waypoint.entry is None:
            raise EditError("only waypoints have altitudes of their own")
        if altitude_m is not None:
            entry = self.long_form(waypoint.entry, "position")
            entry.setdefault("altitude_m", None)
            self.put(entry, "altitude_m", metres(altitude_m))
        elif isinstance(entry := self.at(waypoint.entry), dict):
            entry.pop("altitude_m", None)

    def _list(self, name: str) -> list[Any]:
        """A list of the file, begun if there is none."""
        if self.data.get(name) is None:
            self.data[name] = []
        values: list[Any] = self.at((name,))
        return values

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


# QGroundControl plans


ITEMS: Keys = ("mission", "items")
POLYGONS: Keys = ("geoFence", "polygons")
CIRCLES: Keys = ("geoFence", "circles")
RALLY_POINTS: Keys = ("rallyPoints", "points")
"""The lists of a QGroundControl plan."""

_DEFAULT_ALTITUDE_M = 30.0


class PlanParts(Parts):
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

    def insert_waypoint(self, index: int, place: Pair) -> None:
        """Insert a simple item behind the waypoint before it, at the same altitude."""
        waypoints = self.waypoints
        if index > len(waypoints):
            raise EditError(f"the mission has only {len(waypoints)} waypoints")
        items = value_at(self.data, ITEMS)
        if not isinstance(items, list):
            raise EditError("the plan has no list of items; save it with QGroundControl")
        position, altitude_m = len(items), _DEFAULT_ALTITUDE_M
        if waypoints:
            neighbour = waypoints[max(index - 1, 0)]
            position = int(neighbour.keys[len(ITEMS)]) + (1 if index else 0)
            altitude_m = self._relative_altitude_m(neighbour) or _DEFAULT_ALTITUDE_M
        used = [item.get("doJumpId") for item in items if isinstance(item, dict)]
        number = max((n for n in used if isinstance(n, int)), default=0) + 1
        params = [0, 0, 0, None, *self.digits(place), metres(altitude_m)]
        self.at(ITEMS).insert(position, simple_item(MavCommand.WAYPOINT, params, number=number))

    def add_rally_point(self, place: Pair) -> None:
        """Add a point at home's altitude, which is what they count from."""
        if not isinstance(value_at(self.data, RALLY_POINTS), list):
            raise EditError("the plan has no list of rally points; save it with QGroundControl")
        self.at(RALLY_POINTS).append([*self.digits(place), metres(0)])

    def add_area(self, corners: Sequence[Pair], radius_m: float | None, *, fence: bool) -> None:
        """Add an inclusion or exclusion polygon or circle."""
        path = POLYGONS if radius_m is None else CIRCLES
        if not isinstance(value_at(self.data, path), list):
            raise EditError("the plan has no list of fences; save it with QGroundControl")
        ring = [self.digits(corner) for corner in corners]
        area: dict[str, Any] = {"inclusion": fence, "polygon": ring, "version": 1}
        if radius_m is not None:
            circle = {"center": ring[0], "radius": metres(radius_m, 1)}
            area = {"circle": circle, "inclusion": fence, "version": 1}
        self.at(path).append(area)

    def redraw(self, region: Region, corners: Sequence[Pair]) -> None:
        """Polygons stand in a list of their own."""
        if region.circle is None:
            self.at(region.rings[0].keys)[:] = [self.digits(corner) for corner in corners]
        else:
            self.take_out(region.keys)
            self.add_area(corners, None, fence=region.is_fence)

    def set_altitude(self, waypoint: Handle, altitude_m: float | None) -> None:
        """Write the altitude, and QGroundControl's copy of it."""
        if altitude_m is None:
            raise EditError("in a plan every waypoint has its own altitude")
        if self._relative_altitude_m(waypoint) is None:
            raise EditError("its altitude does not count from home; edit it in QGroundControl")
        digits, keys = metres(altitude_m), waypoint.keys[: len(ITEMS) + 1]
        self.put(self.at((*keys, "params")), 6, digits)
        item = self.at(keys)
        if as_number(item.get("Altitude")) is not None:
            self.put(item, "Altitude", digits)

    def _region_of(self, value: dict[Any, Any], keys: Keys) -> Region:
        is_fence = value.get("inclusion") is True
        number = sum(not region.is_fence for region in self.regions) + 1
        name = "fence" if is_fence else f"zone {number}"
        ring = ring_of(value.get("polygon"), (*keys, "polygon"))
        circle = circle_of(value.get("circle"), (*keys, "circle"), centre="center", radius="radius")
        return Region(keys, name, is_fence, (ring,) if ring else (), circle, keys)

    def _item(self, handle: Handle) -> dict[str, Any]:
        item: dict[str, Any] = self.at(handle.keys[: len(ITEMS) + 1])
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
