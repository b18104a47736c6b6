"""Edits of QGroundControl plans."""

from collections.abc import Mapping
from typing import Any, ClassVar

from air_router.editor import edits
from air_router.editor.edits import EditError
from air_router.editor.features import Handle, as_number
from air_router.editor.plan_features import (
    CIRCLES,
    ITEMS,
    POLYGONS,
    RALLY_POINTS,
    plan_features,
)
from air_router.editor.text_editor import TextEditor
from air_router.files.qgc.qgc_items import MavCommand
from air_router.files.qgc.qgc_write import simple_item
from air_router.files.text.rendering import METRE_DECIMALS, Digits, metres
from air_router.files.text.source import Splice, TextSource
from mocha_link.team.document import Document

_RELATIVE_FRAMES = (3, 6)
_DEFAULT_ALTITUDE_M = 30.0


class PlanEditor(TextEditor):
    """A `.plan` file; keys are written in the order of the alphabet, as QGroundControl does."""

    settable: ClassVar[bool] = False

    def __init__(self, text: str, document: Document) -> None:
        self._data = document.data  # of the whole plan
        super().__init__(TextSource(text, document.node(), json=True), plan_features(document.data))

    def add_waypoint(self, edit: edits.AddWaypoint) -> list[Splice]:
        """Insert a simple item behind the waypoint before it, at the same altitude."""
        waypoints = self.features.waypoints
        if edit.index > len(waypoints):
            raise EditError(f"the mission has only {len(waypoints)} waypoints")
        items = self._data["mission"]["items"]
        if edit.index:
            position = self._position(waypoints[edit.index - 1]) + 1
        elif waypoints:
            position = self._position(waypoints[0])
        else:
            position = len(items)
        neighbour = waypoints[max(edit.index - 1, 0)] if waypoints else None
        altitude_m = self._relative_altitude_m(neighbour) or _DEFAULT_ALTITUDE_M
        used = [item.get("doJumpId") for item in items if isinstance(item, dict)]
        latitude, longitude = self.digits(edit.at)
        number = max((n for n in used if isinstance(n, int)), default=0) + 1
        params = [0, 0, 0, None, latitude, longitude, metres(altitude_m)]
        item = simple_item(MavCommand.WAYPOINT, params, number=number)
        return self.source.insert(ITEMS, position, item)

    def add_rally_point(self, edit: edits.AddRallyPoint) -> list[Splice]:
        """Add a point at home's altitude, which is what they count from."""
        if not self.source.has(*RALLY_POINTS):
            raise EditError("the plan has no list of rally points; save it with QGroundControl")
        index = self.source.length(*RALLY_POINTS)
        return self.source.insert(RALLY_POINTS, index, [*self.digits(edit.at), Digits("0")])

    def add_area(self, edit: edits.AddArea) -> list[Splice]:
        """Add an inclusion or exclusion polygon or circle."""
        keys = POLYGONS if edit.radius_m is None else CIRCLES
        if not self.source.has(*keys):
            raise EditError("the plan has no list of fences; save it with QGroundControl")
        corners = [self.digits(corner) for corner in edit.corners]
        area: Mapping[str, Any] = {"inclusion": edit.fence, "polygon": corners, "version": 1}
        if edit.radius_m is not None:
            circle = {"center": corners[0], "radius": metres(edit.radius_m, 1)}
            area = {"circle": circle, "inclusion": edit.fence, "version": 1}
        return self.source.insert(keys, self.source.length(*keys), area)

    def rename(self, edit: edits.Rename) -> list[Splice]:
        """Plans have no names for their areas."""
        name = self._region(edit.keys).name
        raise EditError(f"{name} cannot be called '{edit.name}': plans have no names for areas")

    def set_altitude(self, edit: edits.SetAltitude) -> list[Splice]:
        """Write the altitude, and QGroundControl's copy of it."""
        handle, altitude_m = self._handle(edit.keys), edit.altitude_m
        if handle.entry is None or handle not in self.features.waypoints:
            raise EditError("only waypoints have altitudes of their own")
        if altitude_m is None:
            raise EditError("in a plan every waypoint has its own altitude")
        if self._relative_altitude_m(handle) is None:
            raise EditError("its altitude does not count from home; edit it in QGroundControl")
        splices = self.source.number((*handle.entry, "params", 6), altitude_m, METRE_DECIMALS)
        if as_number(self._item(handle).get("Altitude")) is not None:
            splices += self.source.number((*handle.entry, "Altitude"), altitude_m, METRE_DECIMALS)
        return splices

    def set_value(self, edit: edits.SetValue) -> list[Splice]:
        """Plans keep their numbers elsewhere."""
        raise EditError(f"{edit.name} = {edit.value} cannot be set here; edit it in QGroundControl")

    def seek(self, edit: edits.Seek) -> list[Splice]:
        """Plans know no robots."""
        raise EditError(f"a plan cannot say to seek {', '.join(edit.robots)}; convert it to YAML")

    def set_crossing(self, edit: edits.SetCrossing) -> list[Splice]:
        """Plans say nothing of it."""
        name = self._region(edit.keys).name
        raise EditError(f"a plan has no crosses_fence for {name}; convert it to YAML")

    def redraw(self, edit: edits.Redraw) -> list[Splice]:
        """Polygons stand in a list of their own."""
        region = self._region(edit.keys)
        if region.circle is None:
            return self.source.rewrite(
                region.rings[0].keys, [self.digits(corner) for corner in edit.corners]
            )
        area = edits.AddArea(do="add_area", fence=region.is_fence, corners=edit.corners)
        return [*self.source.remove(region.keys), *self.add_area(area)]

    def _position(self, handle: Handle) -> int:
        """A waypoint's place among the items."""
        return int(handle.keys[len(ITEMS)])

    def _item(self, handle: Handle) -> dict[str, Any]:
        item: dict[str, Any] = self._data["mission"]["items"][self._position(handle)]
        return item

    def _relative_altitude_m(self, handle: Handle | None) -> float | None:
        if handle is None:
            return None
        item = self._item(handle)
        relative = item.get("frame") in _RELATIVE_FRAMES
        return as_number(item["params"][6]) if relative else None
