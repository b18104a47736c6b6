"""A mission by a GPX file: a route or the points are its waypoints; it has no altitudes."""

from functools import partial
from typing import Final

from shapely import LineString

from air_router.files import (
    DEFAULT_SPEED_M_S,
    Findings,
    MissionForm,
    SpotForm,
    WaypointForm,
)
from air_router.files.maps import GpxDocument, GpxPoint, ZoneFeature
from air_router.files.missions.form_builder import FormBuilder
from air_router.files.missions.placed_form import Placer
from air_router.words import counted
from geo.frame import FrameError, Geodetic, LocalFrame
from mocha_link.team import Problem, ProblemList

_HOME, _RALLY_POINT = "home", "rally_point"
"""Types of points with a meaning."""

_TRACK_ERROR_M: Final = 2.0


def read_gpx_mission(document: GpxDocument, altitude_m: float) -> tuple[MissionForm, Findings]:
    """A mission by the file's first route; without one by its waypoints, then by its first track.

    Args:
        document: The file.
        altitude_m: Where to fly, above home: the file does not say.
    """
    source = document.file.source
    findings, form = Findings(source), FormBuilder({"name": source.path.stem})
    findings.problems += _problems(document.file)
    free = [point for point in document.points if point.kind not in (_HOME, _RALLY_POINT)]
    lines = [line for line in (*document.routes, *document.tracks) if line.points]
    by_points = bool(free) and not any(route.points for route in document.routes)
    if not free and not lines:
        findings.report((), "no route, no waypoints and no track in it", "no-waypoints")
        return form.form(source.path), findings
    points = free if by_points else list(lines[0].points)
    home = next((point for point in document.points if point.kind == _HOME), None)
    if home is None:
        home = points[0]
        message = "no point has the type 'home': the first waypoint is taken; move it"
        findings.note(home.keys, message, "home-assumed")
    placer = Placer.around("home", home.place, home.keys, findings)
    if placer is None:
        return form.form(source.path), findings
    if not by_points and lines[0] in document.tracks:
        try:
            points = _thinned(points, placer.frame)
        except FrameError as error:
            findings.report(home.keys, f"home: {error}; correct it", "not-on-earth")
            return form.form(source.path), findings
    form.put("altitude_m", altitude_m)
    form.put("speed_m_s", DEFAULT_SPEED_M_S)
    form.set_home(home.place, home.keys)
    for point in _once(findings, "waypoint", points):
        entry = WaypointForm.model_construct(position=list(point.place))
        form.append("waypoints", entry, position=point.keys)
    rally_points = [point for point in document.points if point.kind == _RALLY_POINT]
    for point in _once(findings, "rally point", rally_points):
        spot = SpotForm.model_construct(position=list(point.place))
        form.append("rally_points", spot, position=point.keys)
    others = len(lines) - (not by_points)
    if others:
        findings.note((), f"{counted(others, 'other lines')}: not flown", "not-flown")
    return form.form(source.path), findings


def _problems(file: ZoneFeature) -> list[Problem]:
    """The first of each kind, and how many more there are."""
    problems = ProblemList()
    for keys, message, code in file.problems:
        problems.add(file.source.path, code, partial(file.source.problem, keys, message, code))
    return list(problems)


def _once(findings: Findings, label: str, points: list[GpxPoint]) -> list[GpxPoint]:
    """The points, each place once; that a place comes again is noted."""
    places: dict[Geodetic, GpxPoint] = {}
    for point in points:
        if point.place in places:
            message = f"'{point.name}' lies on an earlier {label}: visited once"
            findings.note(point.keys, message, "waypoint-twice")
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
