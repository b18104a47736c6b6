"""GPX files of handheld receivers and map programs: their points, routes and tracks.

GPX has no areas and no altitudes to fly at: a line that ends where it begins is taken for the
border of a zone, a route or the points for waypoints. Elevations, where the receiver was carried,
are not read.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

from shapely import LineString

from air_router.files import (
    DEFAULT_SPEED_M_S,
    Element,
    Keys,
    MissionDocument,
    MissionPoint,
    PlacedSource,
    parse_xml,
)
from air_router.files.maps.map_area import MapOutline, place_of
from air_router.files.maps.zone_format import ZoneFeature, ZoneFeatures, short_name
from air_router.words import counted
from geo.frame import FrameError, Geodetic, LocalFrame, polar
from mocha_link.team import DocumentError, Problem, ProblemList, number_advice

_HOME, _RALLY_POINT, _ZONE = "home", "rally_point", "zone"
"""Types of points and lines with a meaning."""

_ROOT: Final = re.compile(rb"<(?:[^>]{0,2000}>\s{0,200}<){0,5}(?:\w{1,20}:)?gpx[\s/>]")
_CLOSED_M: Final = 25.0
"""A line whose ends are no farther from each other than this is the border of an area."""

_TRACK_ERROR_M: Final = 2.0


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

    file: ZoneFeature  # takes what is wrong with the file
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
        words = [element.attributes.get(name, "") for name in ("lat", "lon")]
        try:
            place = place_of(*map(float, words))
        except ValueError:
            advice = next(filter(None, map(number_advice, words)), "correct it")
            message = f"<{element.name}> needs 'lat' and 'lon' in degrees; {advice}"
            report(element.keys, message, "wrong-type")
            continue
        if place is None:
            message = f"there is no place {words[0]:.20}, {words[1]:.20}; correct it"
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


# As a mission


def gpx_draft(document: GpxDocument, altitude_m: float) -> MissionDocument:
    """A mission by the file's first route; without one by its waypoints, then by its first track.

    Args:
        document: The file.
        altitude_m: Where to fly, above home: the file does not say.
    """
    source = document.file.source
    draft = MissionDocument(source, source.path.stem, problems=_problems(document.file))
    draft.altitude_m, draft.speed_m_s = altitude_m, DEFAULT_SPEED_M_S
    free = [point for point in document.points if point.kind not in (_HOME, _RALLY_POINT)]
    lines = [line for line in (*document.routes, *document.tracks) if line.points]
    by_points = bool(free) and not any(route.points for route in document.routes)
    if not free and not lines:
        draft.report((), "no route, no waypoints and no track in it", "no-waypoints")
        return draft
    spots = free if by_points else list(lines[0].points)
    home = next((point for point in document.points if point.kind == _HOME), None)
    if home is None:
        home = spots[0]
        message = "no point has the type 'home': the first waypoint is taken; move it"
        draft.note(home.keys, message, "home-assumed")
    if not draft.find_frame("home", home.place, home.keys) or draft.frame is None:
        return draft
    if not by_points and lines[0] in document.tracks:
        try:
            spots = _thinned(spots, draft.frame)
        except FrameError as error:
            draft.report(home.keys, f"home: {error}; correct it", "not-on-earth")
            return draft
    draft.home = draft.spot("home", home.place, home.keys)
    draft.waypoints = _spots(draft, "waypoint", spots)
    rally_points = [point for point in document.points if point.kind == _RALLY_POINT]
    draft.rally_points = _spots(draft, "rally point", rally_points)
    others = len(lines) - (not by_points)
    if others:
        draft.note((), f"{counted(others, 'other lines')}: not flown", "not-flown")
    return draft


def _problems(file: ZoneFeature) -> list[Problem]:
    """The first of each kind, and how many more there are."""
    problems = ProblemList()
    for keys, message, code in file.problems:
        problems.add(file.source.path, code, partial(file.source.problem, keys, message, code))
    return list(problems)


def _spots(draft: MissionDocument, label: str, points: list[GpxPoint]) -> list[MissionPoint]:
    """The points in the draft's frame, each place once."""
    places: dict[Geodetic, GpxPoint] = {}
    for point in points:
        if point.place in places:
            message = f"'{point.name}' lies on an earlier {label}: visited once"
            draft.note(point.keys, message, "waypoint-twice")
        places.setdefault(point.place, point)
    found = (
        draft.spot(f"{label} {number}", point.place, point.keys)
        for number, point in enumerate(places.values(), start=1)
    )
    return [spot for spot in found if spot is not None]


def _thinned(points: list[GpxPoint], frame: LocalFrame) -> list[GpxPoint]:
    """The points of a track without those that are nearly on a line between others."""
    places = frame.to_local_many(*zip(*(point.place for point in points), strict=True))
    if len(places) < 2:
        return points
    kept = set(map(tuple, LineString(places).simplify(_TRACK_ERROR_M).coords))
    return [
        point for point, place in zip(points, places.tolist(), strict=True) if tuple(place) in kept
    ]
