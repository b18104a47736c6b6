"""What of a mission can be moved: every place, corner and radius that its file spells out.

Read leniently from the bare data, before anything is validated: a zone that crosses itself, or a
waypoint on another continent, can still be seen and dragged back.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from air_router.files.json_document import value_at
from air_router.files.mission_document import Keys
from air_router.files.missions.qgc_items import MavCommand

Pair = tuple[float, float]
"""As the file has it: degrees (latitude first), or metres east and north."""


ITEMS: Keys = ("mission", "items")
POLYGONS: Keys = ("geoFence", "polygons")
CIRCLES: Keys = ("geoFence", "circles")
RALLY_POINTS: Keys = ("rallyPoints", "points")
"""The lists of a QGroundControl plan."""


@dataclass(frozen=True, slots=True)
class Handle:
    """A pair of numbers that can be moved.

    Attributes:
        keys: Its name.
        numbers: The list that has them (latitude first, or metres east).
        offset: Where in this list they begin.
        pair: Both.
        entry: What is removed with it; None if it cannot be removed.
    """

    keys: Keys
    numbers: Keys
    offset: int
    pair: Pair
    entry: Keys | None = None


@dataclass(frozen=True, slots=True)
class CircleHandle:
    """A circle: its centre, and where its radius stands."""

    centre: Handle  # moves the circle
    radius_keys: Keys
    radius_m: float


@dataclass(frozen=True, slots=True)
class Ring:
    """A ring of corners, of an area or of a hole in it."""

    keys: Keys
    corners: tuple[Handle, ...]


@dataclass(frozen=True, slots=True)
class Region:
    """A fence or a no-fly zone. `entry` is what is removed with it, None if that must not be."""

    keys: Keys
    name: str  # shown on the page
    is_fence: bool
    rings: tuple[Ring, ...] = ()  # the outline, then its holes
    circle: CircleHandle | None = None
    entry: Keys | None = None


@dataclass(slots=True)
class Features:
    """Everything in a mission's file that can be moved; `origin` is that of metres, in degrees."""

    home: Handle | None = None  # None: the file has none that can be read
    waypoints: list[Handle] = field(default_factory=list)  # in the operator's order
    rally_points: list[Handle] = field(default_factory=list)
    regions: list[Region] = field(default_factory=list)  # fences first, then zones
    in_metres: bool = False  # pairs are metres, else degrees
    origin: Pair | None = None

    def handles(self) -> Iterator[Handle]:
        """All of them."""
        yield from [self.home] if self.home else []
        yield from self.waypoints
        yield from self.rally_points
        for region in self.regions:
            for ring in region.rings:
                yield from ring.corners
            if region.circle:
                yield region.circle.centre


def yaml_features(data: Any) -> Features:
    """The features of a YAML mission's data."""
    features = Features()
    if not isinstance(data, dict):
        return features
    frame = data.get("frame")
    origin = as_pair(frame.get("origin")) if isinstance(frame, dict) else None
    features.home = _spot(data.get("home"), ("home",), removable=False)
    features.in_metres = data.get("coordinates") == "local"
    features.origin = origin or (
        None if features.in_metres or not features.home else features.home.pair
    )
    features.waypoints = _spots(data, "waypoints")
    features.rally_points = _spots(data, "rally_points")
    if data.get("fence") is not None:
        features.regions.append(_region(data["fence"], ("fence",), "fence", None, is_fence=True))
    for keys, value in _entries(data, ("fences",)):
        features.regions.append(_region(value, keys, "fence", keys, is_fence=True))
    for number, (keys, value) in enumerate(_entries(data, ("no_fly_zones",)), start=1):
        name = value.get("name") if isinstance(value, dict) else None
        name = name if isinstance(name, str) else f"zone {number}"
        features.regions.append(_region(value, keys, name, keys, is_fence=False))
    return features


def as_pair(value: Any) -> Pair | None:
    """The first two numbers of a list; None if it has none."""
    if not isinstance(value, list) or len(value) < 2:
        return None
    first, second = as_number(value[0]), as_number(value[1])
    return None if first is None or second is None else (first, second)


def as_number(value: Any) -> float | None:
    """A finite number; None if it is something else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value) if math.isfinite(value) else None
    except OverflowError:
        return None


def handle_of(value: Any, keys: Keys, entry: Keys | None = None) -> Handle | None:
    """A handle of a list that begins with a pair."""
    pair = as_pair(value)
    return Handle(keys, keys, 0, pair, entry) if pair else None


def ring_of(value: Any, keys: Keys) -> Ring | None:
    """The corners of a list of pairs; None if it is none."""
    if not isinstance(value, list):
        return None
    corners = [handle_of(pair, (*keys, i), (*keys, i)) for i, pair in enumerate(value)]
    known = tuple(corner for corner in corners if corner)
    return Ring(keys, known) if len(known) == len(value) else None


def circle_of(value: Any, keys: Keys, *, centre: str, radius: str) -> CircleHandle | None:
    """A circle, its parts under these names."""
    if not isinstance(value, dict):
        return None
    handle = handle_of(value.get(centre), (*keys, centre))
    radius_m = as_number(value.get(radius))
    if handle is None or radius_m is None:
        return None
    return CircleHandle(handle, (*keys, radius), radius_m)


def _spots(data: dict[Any, Any], name: str) -> list[Handle]:
    spots = (_spot(value, keys, removable=True) for keys, value in _entries(data, (name,)))
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
    rings += [ring_of(hole, (*keys, *path)) for path, hole in _entries(area, ("holes",))]
    circle = circle_of(area.get("circle"), (*keys, "circle"), centre="centre", radius="radius_m")
    return Region(keys, name, is_fence, tuple(r for r in rings if r), circle, entry)


def plan_features(data: Any) -> Features:
    """The features of a QGroundControl plan; what surveys are made of stays with that program."""
    features = Features()
    home: Keys = ("mission", "plannedHomePosition")
    features.home = handle_of(value_at(data, home), home)
    features.origin = features.home.pair if features.home else None
    for keys, item in _entries(data, ITEMS):
        handle = _plan_waypoint(item, keys)
        features.waypoints += [handle] if handle else []
    for keys, point in _entries(data, RALLY_POINTS):
        handle = handle_of(point, keys, keys)
        features.rally_points += [handle] if handle else []
    for path in (POLYGONS, CIRCLES):
        for keys, value in _entries(data, path):
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


def _entries(data: Any, keys: Keys) -> Iterator[tuple[Keys, Any]]:
    """The items of a list in a plan, with their keys; none where there is no list."""
    value = value_at(data, keys)
    for index, item in enumerate(value if isinstance(value, list) else []):
        yield (*keys, index), item
