"""What of a QGroundControl plan can be taken hold of; see `sketch`."""

from __future__ import annotations

from typing import Any

from air_router.editor.sketch import (
    Handle,
    Region,
    Sketch,
    as_number,
    handle_of,
    ring_of,
    round_of,
)
from air_router.files.mission_document import Keys
from air_router.files.qgc.qgc_items import MavCommand

ITEMS: Keys = ("mission", "items")
POLYGONS: Keys = ("geoFence", "polygons")
CIRCLES: Keys = ("geoFence", "circles")
RALLY_POINTS: Keys = ("rallyPoints", "points")


def sketch_plan(data: Any) -> Sketch:
    """A sketch of a plan's data; what surveys are made of stays with QGroundControl."""
    sketch = Sketch()
    home: Keys = ("mission", "plannedHomePosition")
    sketch.home = handle_of(_at(data, home), home)
    sketch.origin = sketch.home.pair if sketch.home else None
    for index, item in enumerate(_list(data, ITEMS)):
        handle = _waypoint(item, (*ITEMS, index))
        sketch.waypoints += [handle] if handle else []
    for index, point in enumerate(_list(data, RALLY_POINTS)):
        keys = (*RALLY_POINTS, index)
        handle = handle_of(point, keys, keys)
        sketch.rally_points += [handle] if handle else []
    for path in (POLYGONS, CIRCLES):
        for index, value in enumerate(_list(data, path)):
            if isinstance(value, dict):
                sketch.regions.append(_region(sketch, value, (*path, index)))
    return sketch


def _waypoint(item: Any, keys: Keys) -> Handle | None:
    if not isinstance(item, dict) or item.get("command") != MavCommand.WAYPOINT:
        return None
    params = item.get("params")
    if item.get("type") != "SimpleItem" or not isinstance(params, list) or len(params) < 7:
        return None
    pair = as_number(params[4]), as_number(params[5])
    if pair[0] is None or pair[1] is None:
        return None
    first, second = (*keys, "params", 4), (*keys, "params", 5)
    return Handle(first, first, second, (pair[0], pair[1]), keys)


def _region(sketch: Sketch, value: dict[Any, Any], keys: Keys) -> Region:
    is_fence = value.get("inclusion") is True
    number = sum(not region.is_fence for region in sketch.regions) + 1
    name = "fence" if is_fence else f"zone {number}"
    ring = ring_of(value.get("polygon"), (*keys, "polygon"))
    circle = round_of(value.get("circle"), (*keys, "circle"), centre="center", radius="radius")
    return Region(keys, name, is_fence, (ring,) if ring else (), circle, keys)


def _at(data: Any, keys: Keys) -> Any:
    for key in keys:
        data = data.get(key) if isinstance(data, dict) else None
    return data


def _list(data: Any, keys: Keys) -> list[Any]:
    value = _at(data, keys)
    return value if isinstance(value, list) else []
