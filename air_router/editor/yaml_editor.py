"""Edits of missions in YAML."""

from typing import Any, ClassVar

from air_router.editor import edits
from air_router.editor.edits import EditError
from air_router.editor.features import yaml_features
from air_router.editor.text_editor import TextEditor
from air_router.files.mission_document import Keys
from air_router.files.text.rendering import METRE_DECIMALS, metres
from air_router.files.text.source import Splice, TextSource
from mocha_link.team.document import Document

SECTIONS: dict[str, tuple[str, ...]] = {
    "planner": ("clearance_m", "tracking_margin_m", "max_edge_m"),
    "timers": ("init_s", "explore_s", "search_s", "communicate_s", "hold_s"),
}
"""The settings of the page that stand in sections of the file."""

_SECTION_OF = {name: section for section, names in SECTIONS.items() for name in names}
_WORDS = ("name", "team", "uav")


class YamlEditor(TextEditor):
    """A mission file in YAML; see docs/mission-file.md."""

    settable: ClassVar[bool] = True

    def __init__(self, text: str, document: Document) -> None:
        super().__init__(
            TextSource(text, document.node(), json=False), yaml_features(document.data)
        )
        data = document.data
        # `seek` names no robots
        self._only_policy = isinstance(data, dict) and isinstance(data.get("seek"), str)

    def add_waypoint(self, edit: edits.AddWaypoint) -> list[Splice]:
        """Insert a bare pair: it flies at the mission's altitude."""
        return self._listed("waypoints", edit.index, self.digits(edit.at))

    def add_rally_point(self, edit: edits.AddRallyPoint) -> list[Splice]:
        """Add a pair to the list, which is begun if there is none."""
        count = self.source.length("rally_points")
        return self._listed("rally_points", count, self.digits(edit.at))

    def add_area(self, edit: edits.AddArea) -> list[Splice]:
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

    def rename(self, edit: edits.Rename) -> list[Splice]:
        """Change the name, or give one to a zone that had none."""
        region, name = self._region(edit.keys), edit.name
        if region.is_fence:
            raise EditError("a fence has no name")
        if not self.source.is_mapping(*region.keys):
            return self.source.wrap(region.keys, "polygon", {"name": name})
        if self.source.has(*region.keys, "name"):
            return self.source.words((*region.keys, "name"), name)
        return self.source.add_key(region.keys, "name", name)

    def set_altitude(self, edit: edits.SetAltitude) -> list[Splice]:
        """Write the altitude beside the position, or take it away."""
        handle, altitude_m = self._handle(edit.keys), edit.altitude_m
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

    def set_value(self, edit: edits.SetValue) -> list[Splice]:
        """Change a setting, add it where the default was meant, or take it away."""
        name, value = edit.name, edit.value
        section = _SECTION_OF.get(name)
        keys: Keys = (section, name) if section else (name,)
        if value is None:
            return self.source.remove(keys) if self.source.has(*keys) else []
        if isinstance(value, str) != (name in _WORDS):
            raise EditError(f"{name} cannot be '{value}'")
        if self.source.has(*keys):
            if isinstance(value, str):
                return self.source.words(keys, value)
            return self.source.number(keys, value, METRE_DECIMALS)
        written = value if isinstance(value, str) else metres(value)
        if section is None or self.source.is_mapping(section):
            return self.source.add_key(keys[:-1], name, written)
        if self.source.has(section):
            raise EditError(f"{section} is empty in the file; write {section}.{name} by hand")
        return self.source.add_key((), section, {name: written})

    def seek(self, edit: edits.Seek) -> list[Splice]:
        """Change the list by the one robot that is more or less in it, or begin it."""
        robots = edit.robots
        if not robots:
            raise EditError("a mission seeks at least one robot")
        source = self.source
        keys: Keys = ("seek", "robots") if source.is_mapping("seek") else ("seek",)
        listed = [str(name.value) for name in source.items(keys)]
        for index in range(len(listed)):
            if listed[:index] + listed[index + 1 :] == [*robots]:
                return source.remove((*keys, index))
        if listed and [*robots[:-1]] == listed:
            return source.insert(keys, len(listed), robots[-1])
        if listed:
            return source.rewrite(keys, [*robots])
        if self._only_policy:
            return source.wrap(keys, "policy", {"robots": [*robots]})
        if source.has(*keys):
            return source.fill(keys, [*robots])
        return source.add_key(keys[:-1], str(keys[-1]), [*robots])

    def set_crossing(self, edit: edits.SetCrossing) -> list[Splice]:
        """Write the key, or take it away."""
        region, crosses = self._region(edit.keys), edit.crosses
        keys = (*region.keys, "crosses_fence")
        if region.is_fence:
            raise EditError("only zones cross the fence")
        if not self.source.is_mapping(*region.keys):
            return self.source.wrap(region.keys, "polygon", {"crosses_fence": True})
        if not self.source.has(*keys):
            return self.source.add_key(region.keys, "crosses_fence", crosses)
        return self.source.remove(keys) if not crosses else self.source.rewrite(keys, crosses)

    def redraw(self, edit: edits.Redraw) -> list[Splice]:
        """Write other corners, in the place of a circle too."""
        region = self._region(edit.keys)
        corners = [self.digits(corner) for corner in edit.corners]
        if region.circle is None:
            return self.source.rewrite((*region.keys, "polygon"), corners)
        return self.source.exchange((*region.keys, "circle"), "polygon", corners)

    def _listed(self, name: str, index: int, item: Any) -> list[Splice]:
        if not self.source.has(name):
            return self.source.add_key((), name, [item])
        if not self.source.length(name):
            return self.source.fill((name,), [item])
        return self.source.insert((name,), index, item)
