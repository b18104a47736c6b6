"""A mission by a GPX file: a route or the points are its waypoints; it has no altitudes."""

from functools import partial
from typing import Final

from shapely import LineString

from air_router.files import DEFAULT_SPEED_M_S, MissionDocument, SpotForm, WaypointForm
from air_router.files.maps import GpxDocument, GpxPoint, ZoneFeature
from air_router.files.missions.placing import FileForm
from air_router.words import counted
from geo.frame import FrameError, Geodetic, LocalFrame
from mocha_link.team import Problem, ProblemList

_HOME, _RALLY_POINT = "home", "rally_point"
"""Types of points with a meaning."""

_TRACK_ERROR_M: Final = 2.0


def gpx_draft(document: GpxDocument, altitude_m: float) -> MissionDocument:
    """A mission by the file's first route; without one by its waypoints, then by its first track.

    Args:
        document: The file.
        altitude_m: Where to fly, above home: the file does not say.
    """
    source = document.file.source
    draft = MissionDocument(source, source.path.stem, problems=_problems(document.file))
    free = [point for point in document.points if point.kind not in (_HOME, _RALLY_POINT)]
    lines = [line for line in (*document.routes, *document.tracks) if line.points]
    by_points = bool(free) and not any(route.points for route in document.routes)
    if not free and not lines:
        draft.report((), "no route, no waypoints and no track in it", "no-waypoints")
        return draft
    points = free if by_points else list(lines[0].points)
    home = next((point for point in document.points if point.kind == _HOME), None)
    if home is None:
        home = points[0]
        message = "no point has the type 'home': the first waypoint is taken; move it"
        draft.note(home.keys, message, "home-assumed")
    if not draft.find_frame("home", home.place, home.keys) or draft.frame is None:
        return draft
    if not by_points and lines[0] in document.tracks:
        try:
            points = _thinned(points, draft.frame)
        except FrameError as error:
            draft.report(home.keys, f"home: {error}; correct it", "not-on-earth")
            return draft
    form = FileForm({"name": source.path.stem})
    form.put("altitude_m", altitude_m)
    form.put("speed_m_s", DEFAULT_SPEED_M_S)
    form.set_home(home.place, home.keys)
    for point in _once(draft, "waypoint", points):
        entry = WaypointForm.model_construct(position=list(point.place))
        form.append("waypoints", entry, position=point.keys)
    rally_points = [point for point in document.points if point.kind == _RALLY_POINT]
    for point in _once(draft, "rally point", rally_points):
        spot = SpotForm.model_construct(position=list(point.place))
        form.append("rally_points", spot, position=point.keys)
    form.place(draft)
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


def _once(draft: MissionDocument, label: str, points: list[GpxPoint]) -> list[GpxPoint]:
    """The points, each place once; that a place comes again is noted."""
    places: dict[Geodetic, GpxPoint] = {}
    for point in points:
        if point.place in places:
            message = f"'{point.name}' lies on an earlier {label}: visited once"
            draft.note(point.keys, message, "waypoint-twice")
        places.setdefault(point.place, point)
    return list(places.values())


def _thinned(points: list[GpxPoint], frame: LocalFrame) -> list[GpxPoint]:
    """The points of a track without those that are nearly on a line between others."""
    places = frame.to_local_many(*zip(*(point.place for point in points), strict=True))
    if len(places) < 2:
        return points
    kept = set(map(tuple, LineString(places).simplify(_TRACK_ERROR_M).coords))
    return [
        point for point, place in zip(points, places.tolist(), strict=True) if tuple(place) in kept
    ]
