"""GPX files of handheld receivers and map programs: their points, routes and tracks.

GPX has no areas: a line that ends where it begins is taken for the border of a zone. Elevations,
where the receiver was carried, are not read.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from air_router.files import (
    Element,
    Keys,
    PlacedSource,
    parse_xml,
)
from air_router.files.maps.map_area import MapOutline, place_of
from air_router.files.maps.zone_format import ZoneFeature, ZoneFeatures, short_name
from geo.frame import Geodetic, polar
from mocha_link.team import DocumentError, number_advice

_ZONE: Final = "zone"
"""The type of lines that are borders, where others are not."""

_ROOT: Final = re.compile(rb"<(?:[^>]{0,2000}>\s{0,200}<){0,5}(?:\w{1,20}:)?gpx[\s/>]")
_CLOSED_M: Final = 25.0
"""A line whose ends are no farther from each other than this is the border of an area."""


@dataclass(frozen=True, slots=True)
class GpxPoint:
    """A point of the file, with its type; `keys` are its line and column."""

    name: str
    kind: str
    place: Geodetic
    keys: Keys


@dataclass(frozen=True, slots=True)
class GpxLine:
    """A route or a segment of a track."""

    name: str
    kind: str  # its type
    points: tuple[GpxPoint, ...]
    keys: Keys


@dataclass(slots=True)
class GpxDocument:
    """All of a GPX file that is read."""

    file: ZoneFeature  # takes the problems of the file
    points: list[GpxPoint] = field(default_factory=list)  # waypoints outside of routes and tracks
    routes: list[GpxLine] = field(default_factory=list)
    tracks: list[GpxLine] = field(default_factory=list)  # a line for each segment


def read_gpx(raw: bytes, path: Path) -> GpxDocument:
    """A GPX file's bytes. Raises DocumentError: it is not XML, or not GPX."""
    root = parse_xml(raw, path)
    document = GpxDocument(ZoneFeature(PlacedSource(path)))
    if root.name != "gpx":
        message = f"the outermost element is <{root.name[:30]}>, not <gpx>; choose another file"
        raise DocumentError.at(path, message, "unknown-format", *root.keys)
    document.points = _points(document, root, "wpt")
    document.routes = [_line(document, route, route, "rtept") for route in root.all("rte")]
    document.tracks = [
        _line(document, track, segment, "trkpt")
        for track in root.all("trk")
        for segment in track.all("trkseg")
    ]
    return document


def _line(document: GpxDocument, named: Element, line: Element, tag: str) -> GpxLine:
    name, kind = named.text_of("name")[:80], named.text_of("type")
    return GpxLine(name, kind, tuple(_points(document, line, tag)), line.keys)


def _points(document: GpxDocument, parent: Element, tag: str) -> list[GpxPoint]:
    points, report = [], document.file.report
    for element in parent.all(tag):
        numbers = [element.attributes.get(name, "") for name in ("lat", "lon")]
        try:
            place = place_of(*map(float, numbers))
        except ValueError:
            advice = next(filter(None, map(number_advice, numbers)), "correct it")
            message = f"<{element.name}> needs 'lat' and 'lon' in degrees; {advice}"
            report(element.keys, message, "wrong-type")
            continue
        if place is None:
            message = f"there is no place {numbers[0]:.20}, {numbers[1]:.20}; correct it"
            report(element.keys, message, "not-on-earth")
        else:
            name, kind = element.text_of("name")[:80], element.text_of("type")
            points.append(GpxPoint(name, kind, place, element.keys))
    return points


# As zones


class GpxFormat:
    """GPX, whose closed lines are borders."""

    name: Final = "GPX"
    suffixes: Final = (".gpx",)

    def recognises(self, head: bytes) -> bool:
        """Whether its outermost element is <gpx>."""
        return _ROOT.match(head) is not None

    def read(self, content: bytes, path: Path) -> ZoneFeatures:
        """One feature for each line. Raises DocumentError: it is no GPX."""
        document = read_gpx(content, path)
        return ZoneFeatures(_features(document), self.name)


GPX: Final = GpxFormat()


def _features(document: GpxDocument) -> Iterator[ZoneFeature]:
    file = document.file
    lines = [*document.routes, *document.tracks]
    zones = [line for line in lines if line.kind == _ZONE] or lines
    left = len(lines) - len(zones) + len(document.points)
    yield file
    for number, line in enumerate(zones, start=1):
        feature = ZoneFeature(
            file.source, short_name(line.name, file.source.path, number), [line.kind]
        )
        feature.saw([point.place for point in line.points])
        _add_zone(feature, line)
        yield feature
    if left:
        others = ZoneFeature(file.source)
        message = f"{left} points and lines of other types than 'zone': left out"
        others.note((), message, "not-a-zone")
        yield others


def _add_zone(feature: ZoneFeature, line: GpxLine) -> None:
    places = [point.place for point in line.points]
    if not places:
        feature.note(line.keys, f"'{feature.name}' has no points: left out", "no-area")
        return
    _, gap_m = polar(places[0], places[-1])
    if gap_m > _CLOSED_M:
        message = (
            f"'{feature.name}' ends {gap_m:.0f} m from where it begins, so it has no area; close "
            "it, or draw a polygon"
        )
        feature.report(line.keys, message, "no-area")
        return
    ring = feature.ring(places, line.keys)
    if ring is not None:
        feature.add([(line.keys, MapOutline(ring))])
