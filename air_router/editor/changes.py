"""What edits change of a mission's data; the same for YAML and for QGroundControl plans."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

from air_router.editor import edits
from air_router.editor.edits import Edit, EditError
from air_router.editor.features import (
    CIRCLES,
    ITEMS,
    POLYGONS,
    RALLY_POINTS,
    Features,
    Handle,
    Pair,
    Region,
    as_number,
    plan_features,
    yaml_features,
)
from air_router.files.json_document import value_at
from air_router.files.mission_document import Keys
from air_router.files.missions.qgc_items import RELATIVE_FRAMES, MavCommand
from air_router.files.missions.qgc_write import simple_item
from air_router.files.text_values import (
    Digits,
    degrees,
    metres,
)
from geo.frame import FrameError, Geodetic, LocalFrame, Point

SECTIONS: dict[str, tuple[str, ...]] = {
    "planner": ("clearance_m", "tracking_margin_m", "max_edge_m"),
    "timers": ("init_s", "explore_s", "search_s", "communicate_s", "hold_s"),
}
"""The settings of the page that stand in sections of a mission file."""

_SECTION_OF = {name: section for section, names in SECTIONS.items() for name in names}
_WORDS = ("name", "team", "uav")
_LEAST_CORNERS = 3
_DEFAULT_ALTITUDE_M = 30.0


class Changes(ABC):
    """A mission's data, and how edits change them: a method for each edit, of the same name.

    Attributes:
        settable: Whether settings and names are possible in this kind of file.
        data: The file's values; they are changed in place.
        features: What of them can be moved.
    """

    settable: ClassVar[bool]

    def __init__(self, data: Any) -> None:
        self.data = data
        self.features = self.features_of(data)
        self._regions = {region.keys: region for region in self.features.regions}

    @staticmethod
    @abstractmethod
    def features_of(data: Any) -> Features:
        """What can be moved in such a file."""

    def make(self, edit: Edit) -> None:
        """Change the data.

        Raises:
            EditError: the mission has no such part, or would not survive.
        """
        change: Callable[[Edit], None] = getattr(self, edit.do)
        change(edit)

    # Places

    def geodetic(self, pair: Pair) -> Pair | None:
        """A pair of the file as latitude and longitude; None if it is not on Earth."""
        try:
            if self.features.in_metres:
                return self._frame().to_geodetic(Point(*pair))
        except (EditError, FrameError):
            return None
        return pair if abs(pair[0]) <= 90 and abs(pair[1]) <= 180 else None

    def digits(self, place: Pair) -> list[Digits]:
        """Latitude and longitude as the file would write them."""
        if self.features.in_metres:
            return [metres(value) for value in self._frame().to_local(*place)]
        return [degrees(value) for value in place]

    def _frame(self) -> LocalFrame:
        if self.features.origin is None:
            raise EditError("the mission's frame is not known; write frame.origin first")
        try:
            return LocalFrame(Geodetic(*self.features.origin))
        except FrameError as error:
            raise EditError(f"frame.origin: {error}; correct it first") from None

    # Edits that are the same in every file

    def move(self, edit: edits.Move) -> None:
        """Write another pair."""
        self._move(self._handle(edit.keys), edit.to)

    def shift(self, edit: edits.Shift) -> None:
        """Write all pairs of an area anew; it keeps its size in metres."""
        region = self._region(edit.keys)
        handles = [corner for ring in region.rings for corner in ring.corners]
        handles += [region.circle.centre] if region.circle else []
        try:
            frame = LocalFrame(Geodetic(*edit.to))
            start = frame.to_local(*edit.origin)
            for handle in handles:
                here = self.geodetic(handle.pair)
                if here is None:
                    raise EditError(f"{region.name} has a corner that is not on Earth")
                point = frame.to_local(*here)
                there = Point(point.east_m - start.east_m, point.north_m - start.north_m)
                self._move(handle, frame.to_geodetic(there))
        except FrameError as error:
            raise EditError(f"{region.name} cannot be moved there: {error}") from None

    def resize(self, edit: edits.Resize) -> None:
        """Write another radius."""
        region = self._region(edit.keys)
        if region.circle is None:
            raise EditError(f"{region.name} is no circle")
        *keys, name = region.circle.radius_keys
        self._put(self._at(keys), name, metres(edit.radius_m, 1 if edit.radius_m >= 1 else 2))

    def add_corner(self, edit: edits.AddCorner) -> None:
        """Insert a corner into a ring."""
        rings = {ring.keys: ring for region in self.features.regions for ring in region.rings}
        if edit.keys not in rings:
            raise EditError("the mission has no such border any more")
        if edit.index > len(rings[edit.keys].corners):
            raise EditError(f"the ring has only {len(rings[edit.keys].corners)} corners")
        self._at(edit.keys).insert(edit.index, self.digits(edit.at))

    def remove(self, edit: edits.Remove) -> None:
        """Take a place, a corner or an area out."""
        keys = edit.keys
        if keys in self._regions:
            region = self._regions[keys]
            if region.entry is None:
                raise EditError(f"the {region.name} is removed by hand: write 'fence: null'")
            self._take_out(region.entry)
            return
        handle = self._handle(keys)
        if handle.entry is None:
            raise EditError("this cannot be removed; move it instead")
        rings = {ring.keys: ring for region in self.features.regions for ring in region.rings}
        ring = rings.get(keys[:-1])
        if ring and len(ring.corners) <= _LEAST_CORNERS:
            raise EditError("an area needs three corners; remove the whole area instead")
        if self.features.waypoints == [handle]:
            raise EditError("a mission needs a waypoint; move it instead")
        self._take_out(handle.entry)

    @abstractmethod
    def add_area(self, edit: edits.AddArea) -> None:
        """Add a zone or a fence."""

    # Parts of the data

    def _at(self, keys: Sequence[str | int]) -> Any:
        """The value at a path, which may name the long form of what has the short one."""
        value = self.data
        for key in keys:
            if not (isinstance(value, list) and isinstance(key, str)):
                value = value[key]
        return value

    def _take_out(self, keys: Keys) -> None:
        del self._at(keys[:-1])[keys[-1]]

    def _move(self, handle: Handle, place: Pair) -> None:
        numbers = self._at(handle.numbers)
        for index, digits in enumerate(self.digits(place), start=handle.offset):
            self._put(numbers, index, digits)

    def _put(self, values: Any, key: str | int, digits: Digits) -> None:
        """Write a number, unless the one that stands there is the same, as fine as this one is."""
        old = as_number(values[key])
        if old is None or abs(old - digits) >= 0.5 * 10.0**-digits.decimals:
            values[key] = digits

    def _handle(self, keys: Keys) -> Handle:
        handle = next((each for each in self.features.handles() if each.keys == keys), None)
        if handle is None:
            raise EditError("the mission has no such place any more")
        return handle

    def _region(self, keys: Keys) -> Region:
        if keys not in self._regions:
            raise EditError("the mission has no such area any more")
        return self._regions[keys]


class YamlChanges(Changes):
    """Of a mission file in YAML; see docs/mission-file.md."""

    settable: ClassVar[bool] = True

    @staticmethod
    def features_of(data: Any) -> Features:
        """What can be moved."""
        return yaml_features(data)

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
            values = values.get(section, {}) if value is None else values.setdefault(section, {})
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
        values: list[Any] = self.data[name]
        return values

    def _long_form(self, keys: Keys, key: str) -> dict[str, Any]:
        """An entry as a mapping; one in short form becomes one, with its value under a key."""
        parent, index = self._at(keys[:-1]), keys[-1]
        if not isinstance(parent[index], dict):
            parent[index] = {key: parent[index]}
        entry: dict[str, Any] = parent[index]
        return entry

    def _unused_name(self) -> str:
        names = {region.name for region in self.features.regions}
        number = sum(not region.is_fence for region in self.features.regions) + 1
        while f"zone {number}" in names:
            number += 1
        return f"zone {number}"


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

    def rename(self, edit: edits.Rename) -> None:
        """Plans have no names for their areas."""
        name = self._region(edit.keys).name
        raise EditError(f"{name} cannot be called '{edit.name}': plans have no names for areas")

    def set_value(self, edit: edits.SetValue) -> None:
        """Plans keep their numbers elsewhere."""
        raise EditError(f"{edit.name} = {edit.value} cannot be set here; edit it in QGroundControl")

    def seek(self, edit: edits.Seek) -> None:
        """Plans know no robots."""
        raise EditError(f"a plan cannot say to seek {', '.join(edit.robots)}; convert it to YAML")

    def set_crossing(self, edit: edits.SetCrossing) -> None:
        """Plans say nothing of it."""
        name = self._region(edit.keys).name
        raise EditError(f"a plan has no crosses_fence for {name}; convert it to YAML")

    def _item(self, handle: Handle) -> dict[str, Any]:
        item: dict[str, Any] = self._at(handle.keys[: len(ITEMS) + 1])
        return item

    def _relative_altitude_m(self, handle: Handle) -> float | None:
        item = self._item(handle)
        return as_number(item["params"][6]) if item.get("frame") in RELATIVE_FRAMES else None
