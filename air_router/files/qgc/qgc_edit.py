"""Changes of a QGroundControl plan within its own document: everything else stays as it is.

Unknown items and keys, surveys, cameras, the order of keys: what is not changed is not touched.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any, Final

from air_router.errors import AirRouterError, ExitCode
from air_router.files.json_document import json_text, value_at
from air_router.files.mission_document import Keys
from air_router.files.qgc.qgc_items import MavCommand
from geo.frame import Geodetic

RELATIVE_FRAME: Final = 3
MISSION_FRAME: Final = 2
DEGREE_DIGITS: Final = 10
"""Of degrees that are written: a hundredth of a millimetre."""

_HOME: Final = ("mission", "plannedHomePosition")
_RALLY: Final = ("rallyPoints", "points")
_ITEMS: Final = ("mission", "items")
_EMPTY_SECTIONS: Final[dict[str, dict[str, Any]]] = {
    "geoFence": {"circles": [], "polygons": [], "version": 2},
    "rallyPoints": {"points": [], "version": 2},
}


class PlanEditError(AirRouterError):
    """A change that the plan does not allow; nothing has been changed."""

    exit_code = ExitCode.USAGE


class PlanEdit:
    """A plan's data and changes of them. Keys are those that a draft's spots and areas have.

    Args:
        data: of the plan as read; they are copied.
    """

    def __init__(self, data: dict[str, Any]) -> None:
        self.data: dict[str, Any] = copy.deepcopy(data)

    def text(self) -> str:
        """The plan's text."""
        return json_text(self.data)

    def move(self, keys: Keys, place: Geodetic) -> None:
        """Move home, a waypoint, a rally point, a corner of a polygon or a circle's centre.

        Raises:
            PlanEditError: there is no such place, or a survey made it.
        """
        if "TransectStyleComplexItem" in keys:
            raise PlanEditError(
                "this waypoint belongs to a survey, which works it out anew; "
                "change the survey in QGroundControl"
            )
        latitude_deg, longitude_deg = _rounded(place)
        if keys[-2:-1] == ("params",):
            values, first = value_at(self.data, keys[:-1]), int(keys[-1])
        elif keys[:2] == ("geoFence", "circles") and len(keys) == 3:
            values, first = value_at(self.data, (*keys, "circle", "center")), 0
        else:
            values, first = value_at(self.data, keys), 0
        if not isinstance(values, list) or len(values) < first + 2:
            raise PlanEditError(f"the plan has no place at {keys}; nothing was changed")
        values[first : first + 2] = [latitude_deg, longitude_deg]

    def set_altitude(self, keys: Keys, altitude_above_home_m: float) -> None:
        """Give a waypoint another altitude; it counts from home then."""
        params = value_at(self.data, keys[:-1])
        item = value_at(self.data, keys[:-2])
        if not isinstance(item, dict) or not isinstance(params, list) or len(params) < 7:
            raise PlanEditError(f"the plan has no waypoint at {keys}; nothing was changed")
        params[6] = altitude_above_home_m
        item["frame"] = RELATIVE_FRAME
        for key, value in _altitude_keys(altitude_above_home_m).items():
            if key in item:
                item[key] = value

    def add_polygon(self, corners: Sequence[Geodetic], *, inclusion: bool) -> Keys:
        """Add a fence or a zone; returns its keys."""
        entry = {
            "inclusion": inclusion,
            "polygon": [_rounded(corner) for corner in corners],
            "version": 1,
        }
        return self._append("geoFence", "polygons", entry)

    def add_circle(self, centre: Geodetic, radius_m: float, *, inclusion: bool) -> Keys:
        """Add a round fence or zone; returns its keys."""
        entry = {
            "circle": {"center": _rounded(centre), "radius": radius_m},
            "inclusion": inclusion,
            "version": 1,
        }
        return self._append("geoFence", "circles", entry)

    def add_rally_point(self, place: Geodetic, altitude_above_home_m: float = 0.0) -> Keys:
        """Add a rally point; returns its keys."""
        return self._append("rallyPoints", "points", [*_rounded(place), altitude_above_home_m])

    def add_waypoint(
        self,
        place: Geodetic,
        altitude_above_home_m: float,
        *,
        acceptance_radius_m: float = 0.0,
        before: Keys | None = None,
    ) -> Keys:
        """Add a waypoint before another item, or behind the last waypoint; returns its keys."""
        items = value_at(self.data, _ITEMS)
        index = int(before[2]) if before else self._behind_waypoints(items)
        latitude_deg, longitude_deg = _rounded(place)
        item = simple_item(
            MavCommand.WAYPOINT,
            [0, acceptance_radius_m, 0, None, latitude_deg, longitude_deg, altitude_above_home_m],
            number=1 + max(map(_jump_id, items), default=0),
        )
        items.insert(index, item)
        return (*_ITEMS, index, "params", 4)

    def remove(self, keys: Keys) -> None:
        """Take an item, a fence, a zone or a rally point out of the plan.

        Keys of what comes behind it count one less from then on.
        """
        entry = keys[:3]
        values = value_at(self.data, entry[:-1])
        known = entry[:-1] in (_ITEMS, _RALLY, ("geoFence", "polygons"), ("geoFence", "circles"))
        if not known or not isinstance(values, list) or int(entry[-1]) >= len(values):
            raise PlanEditError(f"the plan has nothing to remove at {keys}; nothing was changed")
        del values[int(entry[-1])]

    def _append(self, section: str, name: str, entry: Any) -> Keys:
        if not isinstance(self.data.get(section), dict):
            self.data[section] = copy.deepcopy(_EMPTY_SECTIONS[section])
        entries = self.data[section].setdefault(name, [])
        entries.append(entry)
        return (section, name, len(entries) - 1)

    def _behind_waypoints(self, items: list[Any]) -> int:
        ends = (MavCommand.RETURN_TO_LAUNCH, MavCommand.LAND, MavCommand.VTOL_LAND)
        index = len(items)
        while index and isinstance(items[index - 1], dict):
            if items[index - 1].get("command") not in ends:
                break
            index -= 1
        return index


def simple_item(
    command: MavCommand, params: list[float | None], *, number: int, frame: int = RELATIVE_FRAME
) -> dict[str, Any]:
    """A simple item as QGroundControl writes it; `number` counts the plan's items from 1."""
    altitude = _altitude_keys(params[6] or 0.0) if frame == RELATIVE_FRAME else {}
    return {
        **altitude,
        "autoContinue": True,
        "command": int(command),
        "doJumpId": number,
        "frame": frame,
        "params": params,
        "type": "SimpleItem",
    }


def _altitude_keys(altitude_m: float) -> dict[str, Any]:
    return {"AMSLAltAboveTerrain": None, "Altitude": altitude_m, "AltitudeMode": 1}


def _jump_id(item: Any) -> int:
    """The highest number that an item, or one within it, has."""
    numbers = [0]
    if isinstance(item, dict):
        inner = item.get("TransectStyleComplexItem")
        items = inner.get("Items") if isinstance(inner, dict) else None
        numbers += [_jump_id(each) for each in items] if isinstance(items, list) else []
        number = item.get("doJumpId")
        numbers += [number] if isinstance(number, int) else []
    return max(numbers)


def _rounded(place: Geodetic) -> list[float]:
    return [round(place.latitude_deg, DEGREE_DIGITS), round(place.longitude_deg, DEGREE_DIGITS)]
