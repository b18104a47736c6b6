"""Edits of missions in YAML."""

from __future__ import annotations

from typing import Any, ClassVar

from air_router.editor import edits
from air_router.editor.drawing import Drawing
from air_router.editor.edits import EditError
from air_router.editor.sketch import Handle, Region, sketch_yaml
from air_router.files.mission_document import Keys
from air_router.files.text.rendering import METRE_DECIMALS, metres
from air_router.files.text.source import Splice, TextSource
from mocha_link.team.document import Document

_SETTINGS: dict[str, Keys] = {
    "altitude_m": ("altitude_m",),
    "speed_m_s": ("speed_m_s",),
    "clearance_m": ("planner", "clearance_m"),
    "tracking_margin_m": ("planner", "tracking_margin_m"),
    "max_edge_m": ("planner", "max_edge_m"),
}


class YamlDrawing(Drawing):
    """A mission file in YAML; see docs/mission-file.md."""

    settable: ClassVar[bool] = True

    def __init__(self, text: str, document: Document) -> None:
        super().__init__(TextSource(text, document.node(), json=False), sketch_yaml(document.data))

    def waypoint_added(self, edit: edits.AddWaypoint) -> list[Splice]:
        """Insert a bare pair: it flies at the mission's altitude."""
        return self._listed("waypoints", edit.index, self.digits(edit.at))

    def rally_point_added(self, edit: edits.AddRallyPoint) -> list[Splice]:
        """Add a pair to the list, which is begun if there is none."""
        count = self.source.length("rally_points")
        return self._listed("rally_points", count, self.digits(edit.at))

    def area_added(self, edit: edits.AddArea) -> list[Splice]:
        """Add a zone under a name of its own, or the fence where there is none."""
        corners = [self.digits(corner) for corner in edit.corners]
        shape: dict[str, Any] = {"polygon": corners}
        if edit.radius_m is not None:
            shape = {"circle": {"centre": corners[0], "radius_m": metres(edit.radius_m, 1)}}
        if not edit.fence:
            zone = {"name": self.unused_name(), **shape}
            return self._listed("no_fly_zones", self.source.length("no_fly_zones"), zone)
        if self.source.length("fence") or self.source.length("fences"):
            raise EditError("the mission has a fence already; move its corners")
        if self.source.has("fence"):
            return self.source.fill(("fence",), shape)
        return self.source.add_key((), "fence", shape)

    def renamed(self, region: Region, name: str) -> list[Splice]:
        """Change the name, or give one to a zone that had none."""
        if region.is_fence:
            raise EditError("a fence has no name")
        if not self.source.is_mapping(*region.keys):
            return self.source.wrap(region.keys, "polygon", {"name": name})
        if self.source.has(*region.keys, "name"):
            return self.source.words((*region.keys, "name"), name)
        return self.source.add_key(region.keys, "name", name)

    def altitude_set(self, handle: Handle, altitude_m: float | None) -> list[Splice]:
        """Write the altitude beside the position, or take it away."""
        if handle.entry is None or handle.keys[0] != "waypoints":
            raise EditError("only waypoints have altitudes of their own")
        keys = (*handle.entry, "altitude_m")
        if altitude_m is None:
            return self.source.remove(keys) if self.source.has(*keys) else []
        if self.source.has(*keys):
            return self.source.number(keys, altitude_m, METRE_DECIMALS)
        if self.source.is_mapping(*handle.entry):
            return self.source.add_key(handle.entry, "altitude_m", metres(altitude_m))
        return self.source.wrap(handle.entry, "position", {"altitude_m": metres(altitude_m)})

    def number_set(self, name: str, value: float) -> list[Splice]:
        """Change a setting, or write it out where the default was meant."""
        keys = _SETTINGS[name]
        if self.source.has(*keys):
            return self.source.number(keys, value, METRE_DECIMALS)
        if len(keys) == 1 or self.source.is_mapping(*keys[:-1]):
            return self.source.add_key(keys[:-1], str(keys[-1]), metres(value))
        if self.source.has(*keys[:-1]):
            raise EditError(f"{keys[0]} is empty in the file; write {keys[0]}.{keys[1]} by hand")
        return self.source.add_key((), str(keys[0]), {keys[1]: metres(value)})

    def _listed(self, name: str, index: int, item: Any) -> list[Splice]:
        if not self.source.has(name):
            return self.source.add_key((), name, [item])
        if not self.source.length(name):
            return self.source.fill((name,), [item])
        return self.source.insert((name,), index, item)
