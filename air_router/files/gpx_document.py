"""GPX files of handheld receivers and map programs: their points, routes and tracks.

GPX has no areas and no altitudes to fly at: a line that ends where it begins is taken for the
border of a zone, a route or the points for waypoints. Elevations, where the receiver was carried,
are not read.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from shapely import LineString

from air_router.counted import counted
from air_router.files.mission_document import Keys, MissionDocument, MissionPoint
from air_router.files.settings import DEFAULT_SPEED_M_S
from air_router.files.whole_file import PlacedSource
from air_router.files.xml_document import Element, parse_xml
from geo.frame import FrameError, Geodetic, LocalFrame
from mocha_link.team.problem import DocumentError, ProblemList

HOME, RALLY_POINT = "home", "rally_point"
"""Types of the points that `convert` writes, beside which a route is flown."""

_TRACK_ERROR_M: Final = 2.0


@dataclass(frozen=True, slots=True)
class GpxPoint:
    """A waypoint of the file."""

    name: str
    kind: str  # HOME, RALLY_POINT or whatever its type says
    place: Geodetic
    keys: Keys


@dataclass(frozen=True, slots=True)
class GpxLine:
    """A route or a segment of a track; `points` each have a place and its keys."""

    name: str
    kind: str  # as its type says
    points: tuple[GpxPoint, ...]
    keys: Keys


@dataclass(slots=True)
class GpxDocument:
    """All of a GPX file that is read; what is wrong with it is in `problems`."""

    source: PlacedSource
    points: list[GpxPoint] = field(default_factory=list)  # waypoints outside of routes and tracks
    routes: list[GpxLine] = field(default_factory=list)
    tracks: list[GpxLine] = field(default_factory=list)  # a line for each segment
    problems: ProblemList = field(default_factory=ProblemList)


def read_gpx(raw: bytes, path: Path) -> GpxDocument:
    """A GPX file's bytes. Raises DocumentError: it is not XML, or not GPX."""
    root = parse_xml(raw, path)
    document = GpxDocument(PlacedSource(path))
    if root.name != "gpx":
        message = f"the outermost element is <{root.name[:30]}>, not <gpx>; choose another file"
        raise DocumentError([document.source.problem(root.keys, message, "unknown-format")])
    document.points = _points(document, root, "wpt")
    document.routes = [_line(document, route, route, "rtept") for route in root.all("rte")]
    document.tracks = [
        _line(document, track, segment, "trkpt")
        for track in root.all("trk")
        for segment in track.all("trkseg")
    ]
    return document


def gpx_draft(document: GpxDocument, altitude_m: float) -> MissionDocument:
    """A mission by the file's first route; without one by its waypoints, then by its first track.

    Args:
        document: The file.
        altitude_m: Where to fly, above home: the file does not say.
    """
    source = document.source
    draft = MissionDocument(source, source.path.stem)
    draft.problems = list(document.problems)
    draft.altitude_m, draft.speed_m_s = altitude_m, DEFAULT_SPEED_M_S
    free = [point for point in document.points if point.kind not in (HOME, RALLY_POINT)]
    lines = [line for line in (*document.routes, *document.tracks) if line.points]
    by_points = bool(free) and not any(route.points for route in document.routes)
    if not free and not lines:
        draft.report((), "no route, no waypoints and no track in it", "no-waypoints")
        return draft
    spots = free if by_points else list(lines[0].points)
    home = next((point for point in document.points if point.kind == HOME), None)
    if home is None:
        home = spots[0]
        message = "no point has the type 'home': the first waypoint is taken; move it"
        draft.note(home.keys, message, "home-assumed")
    try:
        draft.frame = LocalFrame(home.place)
        if not by_points and lines[0] in document.tracks:
            spots = _thinned(spots, draft.frame)
    except FrameError as error:
        draft.report(home.keys, f"home: {error}; correct it", "not-on-earth")
        return draft
    draft.home = draft.spot("home", home.place, home.keys)
    draft.waypoints = _spots(draft, "waypoint", spots)
    rally_points = [point for point in document.points if point.kind == RALLY_POINT]
    draft.rally_points = _spots(draft, "rally point", rally_points)
    others = len(lines) - (not by_points)
    if others:
        draft.note((), f"{counted(others, 'other lines')}: not flown", "not-flown")
    return draft


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


def _line(document: GpxDocument, named: Element, line: Element, tag: str) -> GpxLine:
    name, kind = named.text_of("name")[:80], named.text_of("type")
    return GpxLine(name, kind, tuple(_points(document, line, tag)), line.keys)


def _points(document: GpxDocument, parent: Element, tag: str) -> list[GpxPoint]:
    points = []
    for element in parent.all(tag):
        place = _place(document, element)
        if place is not None:
            name = element.text_of("name")[:80]
            points.append(GpxPoint(name, element.text_of("type"), place, element.keys))
    return points


def _place(document: GpxDocument, element: Element) -> Geodetic | None:
    words = [element.attributes.get(name, "") for name in ("lat", "lon")]
    try:
        latitude_deg, longitude_deg = map(float, words)
    except ValueError:
        message, code = f"<{element.name}> needs 'lat' and 'lon' in degrees", "wrong-type"
    else:
        if abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180:
            return Geodetic(latitude_deg, longitude_deg)
        message, code = f"there is no place {words[0]:.20}, {words[1]:.20}", "not-on-earth"
    problem = document.source.problem(element.keys, f"{message}; correct it", code)
    document.problems.add(document.source.path, code, lambda: problem)
    return None
