"""What of a QGroundControl plan can be moved; see `features`."""

from typing import Any

from air_router.editor.features import (
    Features,
    Handle,
    Region,
    as_number,
    circle_of,
    handle_of,
    ring_of,
)
from air_router.files.mission_document import Keys
from air_router.files.qgc.qgc_items import MavCommand

ITEMS: Keys = ("mission", "items")
POLYGONS: Keys = ("geoFence", "polygons")
CIRCLES: Keys = ("geoFence", "circles")
RALLY_POINTS: Keys = ("rallyPoints", "points")


def plan_features(data: Any) -> Features:
    """The features of a plan's data; what surveys are made of stays with QGroundControl."""
    features = Features()
    home: Keys = ("mission", "plannedHomePosition")
    features.home = handle_of(_at(data, home), home)
    features.origin = features.home.pair if features.home else None
    for index, item in enumerate(_list(data, ITEMS)):
        handle = _waypoint(item, (*ITEMS, index))
        features.waypoints += [handle] if handle else []
    for index, point in enumerate(_list(data, RALLY_POINTS)):
        keys = (*RALLY_POINTS, index)
        handle = handle_of(point, keys, keys)
        features.rally_points += [handle] if handle else []
    for path in (POLYGONS, CIRCLES):
        for index, value in enumerate(_list(data, path)):
            if isinstance(value, dict):
                features.regions.append(_region(features, value, (*path, index)))
    return features


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


def _region(features: Features, value: dict[Any, Any], keys: Keys) -> Region:
    is_fence = value.get("inclusion") is True
    number = sum(not region.is_fence for region in features.regions) + 1
    name = "fence" if is_fence else f"zone {number}"
    ring = ring_of(value.get("polygon"), (*keys, "polygon"))
    circle = circle_of(value.get("circle"), (*keys, "circle"), centre="center", radius="radius")
    return Region(keys, name, is_fence, (ring,) if ring else (), circle, keys)


def _at(data: Any, keys: Keys) -> Any:
    for key in keys:
        data = data.get(key) if isinstance(data, dict) else None
    return data


def _list(data: Any, keys: Keys) -> list[Any]:
    value = _at(data, keys)
    return value if isinstance(value, list) else []
