"""Fences of ArduPilot's programs, from waypoint files ("QGC WPL 110") and from their old `.fen`.

Polygons and circles to stay out of are zones. What to stay inside of is no zone: it is handed to
who reads the file as a mission, and noted where zones are read.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import takewhile
from pathlib import Path
from typing import Final

from air_router.files import Keys, PlacedSource
from air_router.files.maps.map_area import MapCircle, MapOutline, place_of
from air_router.files.maps.zone_format import (
    MAX_RADIUS_M,
    ZoneFeature,
    ZoneFeatures,
    short_name,
)
from air_router.words import counted
from geo.frame import Geodetic
from mocha_link.team import text_in

_MAGIC: Final = b"QGC WPL"
_COLUMNS: Final = 12
_COMMAND, _FIRST, _LATITUDE = 3, 4, 8  # columns: command, its first parameter, and its place

_PAIR: Final = r"[ \t]*[-+]?\d{1,3}(?:\.\d*)?[ \t]+[-+]?\d{1,3}(?:\.\d*)?[ \t]*"
_OLD_FENCE = re.compile(rf"(?:[ \t]*#[^\n]*\r?\n|\s)*{_PAIR}\r?\n{_PAIR}\r?(?:\n|$)")


class FenceCommand(IntEnum):
    """MAV_CMD values of fences and rally points."""

    RETURN_POINT = 5000
    POLYGON_INCLUSION = 5001
    POLYGON_EXCLUSION = 5002
    CIRCLE_INCLUSION = 5003
    CIRCLE_EXCLUSION = 5004
    RALLY_POINT = 5100


_POLYGONS: Final = (FenceCommand.POLYGON_INCLUSION, FenceCommand.POLYGON_EXCLUSION)
_INCLUSIONS: Final = (FenceCommand.POLYGON_INCLUSION, FenceCommand.CIRCLE_INCLUSION)
FENCE_COMMANDS: Final = frozenset(FenceCommand)


@dataclass(frozen=True, slots=True)
class FenceItem:
    """An item of a fence: a corner of a polygon, a circle, or a place.

    Attributes:
        command: What it is.
        parameter: Of a corner: how many its polygon has; of a circle: its radius in metres.
        latitude_deg: Of its place.
        longitude_deg: Of its place.
        keys: Where it stands.
    """

    command: FenceCommand
    parameter: float
    latitude_deg: float
    longitude_deg: float
    keys: Keys


@dataclass(frozen=True, slots=True)
class FenceArea:
    """A polygon or a circle, to stay inside of or out of.

    Attributes:
        inclusion: The vehicle stays inside of it.
        shape: Where it is; None: it could not be read.
        places: What of its places is known.
        error: Why it could not be read.
        keys: Where its first item stands.
    """

    inclusion: bool
    shape: MapOutline | MapCircle | None
    places: tuple[Geodetic, ...]
    error: str
    keys: Keys


def fence_areas(items: Sequence[FenceItem]) -> Iterator[FenceArea]:
    """The areas that items draw: each corner has the number of its polygon's corners."""
    index = 0
    while index < len(items):
        item, taken = items[index], 1
        if item.command in _POLYGONS:
            count = int(max(item.parameter, 1))
            run = items[index : index + count]
            corners = [*takewhile(lambda each: each.command == item.command, run)]  # noqa: B023
            taken = len(corners)
            yield _polygon(corners, count)
        elif item.command in (FenceCommand.CIRCLE_INCLUSION, FenceCommand.CIRCLE_EXCLUSION):
            yield _circle(item)
        index += taken


def _polygon(corners: Sequence[FenceItem], count: int) -> FenceArea:
    read = [place_of(corner.latitude_deg, corner.longitude_deg) for corner in corners]
    places = tuple(place for place in read if place is not None)
    error = ""
    if len(corners) < count:
        error = f"a polygon of {count} corners has only {len(corners)}; export it again"
    elif len(places) < count:
        error = "a corner of it is not on Earth; correct it"
    elif count < 3:
        error = f"a polygon has {count} corners, an area needs 3; draw it again"
    shape = None if error else MapOutline(places)
    first = corners[0]
    return FenceArea(first.command in _INCLUSIONS, shape, places, error, first.keys)


def _circle(item: FenceItem) -> FenceArea:
    centre, radius_m = place_of(item.latitude_deg, item.longitude_deg), item.parameter
    error = ""
    if centre is None:
        error = f"there is no place {item.latitude_deg:g}, {item.longitude_deg:g}; correct it"
    elif not 0 < radius_m <= MAX_RADIUS_M:
        error = f"a circle has a radius of {radius_m:g} m; correct it"
    shape = None if centre is None or error else MapCircle(centre, radius_m)
    places = () if centre is None else (centre,)
    return FenceArea(item.command in _INCLUSIONS, shape, places, error, item.keys)


def is_waypoint_file(begin: bytes) -> bool:
    """Whether a file that begins so is one of waypoints, and of fences drawn with them."""
    return begin.startswith(_MAGIC)


def is_fence_file(begin: bytes) -> bool:
    """Whether a file that begins so has a place in degrees on each line, and nothing else."""
    return _OLD_FENCE.match(begin.decode("latin1")) is not None


class WaypointFenceFormat:
    """Fences among the items of a waypoint file."""

    name: Final = "waypoint files"
    suffixes: Final = ()

    def recognises(self, head: bytes) -> bool:
        """Whether it is a waypoint file."""
        return is_waypoint_file(head)

    def read(self, content: bytes, path: Path) -> ZoneFeatures:
        """The fences in it to stay out of. Raises DocumentError: it is not text."""
        text = text_in(content, path)
        return ZoneFeatures(_features(text, PlacedSource(path)), self.name)


class OldFenceFormat:
    """An old fence, of places only: it is one to stay inside of, so it has no zones."""

    name: Final = "fences"
    suffixes: Final = ()

    def recognises(self, head: bytes) -> bool:
        """Whether it has a place on each line."""
        return is_fence_file(head)

    def read(self, content: bytes, path: Path) -> ZoneFeatures:
        """A note. Raises DocumentError: it is not text."""
        items, source = old_fence_items(text_in(content, path)), PlacedSource(path)
        features = [_feature(source, area, 1) for area in fence_areas(items)]
        return ZoneFeatures(features, self.name)


WAYPOINT_FENCES: Final = WaypointFenceFormat()
OLD_FENCES: Final = OldFenceFormat()


def _features(text: str, source: PlacedSource) -> Iterator[ZoneFeature]:
    file, items, others = ZoneFeature(source), [], 0
    for number, line in enumerate(text.splitlines()[1:], start=2):
        parts = line.split()
        if not parts:
            continue
        numbers = [_number(part) for part in parts]
        if len(numbers) != _COLUMNS or None in numbers:
            message = f"'{line.strip()[:40]}' is no item of twelve numbers; export again"
            file.report((number, 1), message, "wrong-length")
            continue
        values = [value for value in numbers if value is not None]
        if values[_COMMAND] in FENCE_COMMANDS:
            command = FenceCommand(int(values[_COMMAND]))
            latitude_deg, longitude_deg = values[_LATITUDE : _LATITUDE + 2]
            where: Keys = (number, 1)
            items.append(FenceItem(command, values[_FIRST], latitude_deg, longitude_deg, where))
        else:
            others += 1
    yield file
    for number, area in enumerate(fence_areas(items), start=1):
        yield _feature(source, area, number)
    if others:
        rest = ZoneFeature(source)
        rest.note((), f"{counted(others, 'items')} of the mission: left out", "not-a-zone")
        yield rest


def old_fence_items(text: str) -> list[FenceItem]:
    """The return point of an old fence, which is its first place, and its corners."""
    places = []
    for number, line in enumerate(text.splitlines(), start=1):
        parts = line.partition("#")[0].split()
        pair = [_number(part) for part in parts]
        if len(pair) == 2 and pair[0] is not None and pair[1] is not None:
            places.append((pair[0], pair[1], number))
    point, corners = places[:1], places[1:]
    if len(corners) > 1 and corners[0][:2] == corners[-1][:2]:
        corners.pop()
    return [
        FenceItem(command, float(len(of)), latitude_deg, longitude_deg, (number, 1))
        for command, of in (
            (FenceCommand.RETURN_POINT, point),
            (FenceCommand.POLYGON_INCLUSION, corners),
        )
        for latitude_deg, longitude_deg, number in of
    ]


def _feature(source: PlacedSource, area: FenceArea, number: int) -> ZoneFeature:
    feature = ZoneFeature(source, short_name("", source.path, number))
    feature.saw(area.places)
    if area.inclusion:
        message = (
            "a fence to stay inside of is no no-fly zone: left out; `air-router convert` to "
            ".geojson shows its corners, for 'fence' in the mission"
        )
        feature.note(area.keys, message, "not-a-zone")
    elif area.shape is None:
        feature.report(area.keys, area.error, "wrong-form")
    else:
        feature.add([(area.keys, area.shape)])
    return feature


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
