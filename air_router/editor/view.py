"""What the page shows of a mission, in degrees: everything that it draws, as plain values."""

from collections.abc import Iterable
from functools import lru_cache
from os.path import relpath
from typing import Any

from air_router.editor.editable_mission import MissionAnalysis
from air_router.editor.edits import SETTINGS
from air_router.editor.parts import Handle, Pair, Parts, Region
from air_router.files import Area, Keys
from air_router.mission import UAV_KIND, Mission, TrackingMargin
from air_router.routing import Route
from air_router.web import Degrees, Rings, area_beside, beside, buffer, degrees, line
from mocha_link.team import DocumentError, Problem, Team

_MOST_EDGES = 20_000


_buffer = lru_cache(maxsize=4_000)(buffer)
"""Most shapes do not change with an edit."""


def view(parts: Parts, analysis: MissionAnalysis) -> dict[str, Any]:
    """Everything that the page draws."""
    found = analysis.findings
    problems = sorted(set(found.problems)), sorted(set(found.notes))
    marks = _Marks(parts)
    shown = [marks.problem(problem, note=False) for problem in problems[0]]
    wrong = {tuple(keys) for entry in shown if (keys := entry["feature"])}
    shown += [marks.problem(problem, note=True) for problem in problems[1]]
    return {
        "places": list(_places(parts, analysis, wrong)),
        "areas": list(_areas(parts, analysis, wrong)),
        "edges": _edges(analysis),
        "detours": _detours(analysis),
        "legs": _legs(analysis),
        "problems": shown,
        "settings": _settings(parts, analysis),
    }


def _areas(parts: Parts, analysis: MissionAnalysis, wrong: set[Keys]) -> Iterable[dict[str, Any]]:
    placed = analysis.placed
    areas = {area.keys: area for area in (*placed.fences, *placed.zones) if area.source is None}
    for region in parts.regions:
        area = areas.get(region.keys)
        yield {
            **_region(parts, region),
            "wrong": any(keys[: len(region.keys)] == region.keys for keys in wrong),
            "notes": _notes(area, analysis.mission),
            "crosses": area is not None and area.crosses_fence,
            "buffers": _kept(analysis, area, is_fence=region.is_fence),
        }
    for area in (area for area in placed.zones if area.source is not None):
        if placed.frame is not None:  # from another file: to be seen, not to be edited
            yield area_beside(
                area.name,
                _buffer(placed.frame, area.shape, 0.0),
                _kept(analysis, area, is_fence=False),
                _notes(area, analysis.mission),
            )


def _kept(analysis: MissionAnalysis, area: Area | None, *, is_fence: bool) -> list[list[Rings]]:
    """How far to keep away, at least and when planning; as polygons with holes."""
    form, frame = analysis.placed.form, analysis.placed.frame
    if area is None or frame is None or "planner" in form.unread:
        return []
    planner = form.planner
    clearance_m = planner.clearance_m if area.terms.clearance_m is None else area.terms.clearance_m
    margin_m = TrackingMargin.of(planner, form.speed_m_s).planned_m
    kept_m = (clearance_m, clearance_m + margin_m)
    sign = -1 if is_fence else 1
    return [_buffer(frame, area.shape, sign * distance_m) for distance_m in kept_m]


def route_view(analysis: MissionAnalysis, start: int, end: int) -> dict[str, Any]:
    """The route between two nodes (0: home), or why there is none."""
    graph, router = analysis.graph, analysis.router
    if graph is None or router is None:
        return {"reason": "the mission cannot be planned yet; correct its problems first"}
    if start not in graph.positions or end not in graph.positions:
        return {"reason": "the mission has no such waypoint any more"}
    mission = graph.mission
    if not mission.planning_airspace.point_clear(graph.position(start)):
        name = f"waypoint {start}" if start else "home"
        return {"reason": f"{name} is not a legal place"}
    route = router.route(graph.position(start), end)
    if not isinstance(route, Route):
        return {"reason": route.reason}
    points = [graph.position(start), *(leg.to for leg in route.legs)]
    closest_m, closest_to = mission.airspace.track_distance_m(points)
    return {
        "points": line(mission.frame, points),
        "nodes": [start, *(leg.node for leg in route.legs)],
        "length_m": round(route.length_m, 1),
        "time_s": round(route.length_m / mission.speed_m_s),
        "closest_m": round(closest_m, 1) if closest_to else None,
        "closest_to": closest_to or None,
    }


class _Marks:
    """Finds the part that a problem is about, and where it is."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        # handles of everything with keys of its own
        self._handles: dict[Keys, list[Handle]] = {}
        for handle in parts.handles():
            self._handles[handle.keys] = [handle]
            if handle.entry:
                self._handles[handle.entry] = [handle]
        # of an entry, the handle in it
        self._names = {handle.entry: handle.keys for handle in parts.handles()}
        for region in parts.regions:
            self._handles[region.keys] = region.handles

    def problem(self, problem: Problem, *, note: bool) -> dict[str, Any]:
        """A problem, with the keys of the faulty parts and the places to zoom to."""
        outer = (problem.keys[:count] for count in range(len(problem.keys), 0, -1))
        keys = next((keys for keys in outer if keys in self._handles), None)
        return {
            "code": problem.code,
            "message": problem.message,
            "file": problem.path.name,
            "line": problem.line,
            "column": problem.column,
            "note": note,
            "feature": None if keys is None else list(self._names.get(keys, keys)),
            "at": [] if keys is None else _corners(self._parts, self._handles[keys]),
        }


def _places(parts: Parts, analysis: MissionAnalysis, wrong: set[Keys]) -> Iterable[dict[str, Any]]:
    placed = analysis.placed
    spots = {spot.keys: spot for spot in placed.waypoints}
    numbers = {spot.keys: number for number, spot in enumerate(placed.waypoints, start=1)}
    kinds = [("home", [parts.home] if parts.home else []), ("waypoint", parts.waypoints)]
    for kind, handles in [*kinds, ("rally", parts.rally_points)]:
        for index, handle in enumerate(handles, start=1):
            at = _on_map(parts, handle.pair)
            if at is None:
                continue
            spot = spots.get(handle.keys)
            yield {
                "keys": list(handle.keys),
                "kind": kind,
                "index": index,
                "node": 0 if kind == "home" else numbers.get(handle.keys),
                "at": list(at),
                "altitude_m": spot.altitude_m if spot else None,
                "wrong": handle.keys in wrong,
                "removable": handle.entry is not None,
            }
    own = {handle.keys for handle in parts.waypoints}
    for spot in placed.waypoints:  # out of surveys: to be seen, not to be edited
        if spot.keys not in own and placed.frame is not None:
            yield {
                "keys": None,
                "kind": "waypoint",
                "index": numbers[spot.keys],
                "node": numbers[spot.keys],
                "at": degrees(placed.frame, spot.position),
                "altitude_m": spot.altitude_m,
                "wrong": spot.keys in wrong,
                "removable": False,
            }


def _region(parts: Parts, region: Region) -> dict[str, Any]:
    rings = [
        {"keys": list(ring.keys), "corners": corners}
        for ring in region.rings
        if len(corners := _corners(parts, ring.corners)) == len(ring.corners)
    ]
    circle = None
    if region.circle and (centre := _on_map(parts, region.circle.centre.pair)):
        circle = {
            "keys": list(region.circle.centre.keys),
            "centre": list(centre),
            "radius_m": region.circle.radius_m,
        }
    return {
        "keys": list(region.keys),
        "name": region.name,
        "fence": region.is_fence,
        "removable": region.entry is not None,
        "rings": rings,
        "circle": circle,
        "outline": None,
    }


def _corners(parts: Parts, corners: Iterable[Handle]) -> list[Degrees]:
    places = (_on_map(parts, corner.pair) for corner in corners)
    return [list(place) for place in places if place is not None]


def _notes(area: Area | None, mission: Mission | None) -> list[str]:
    """The notes on an area."""
    notes = []
    if area is not None and area.terms.clearance_m is not None:
        notes.append(f"clearance {area.terms.clearance_m:g} m")
    if area is not None and mission is not None:
        notes += [idle.reason for idle in mission.idle_zones if idle.zone.name == area.name]
    return notes


def _edges(analysis: MissionAnalysis) -> list[list[int]]:
    """For each node those of higher numbers that a straight edge leads to; not of too many."""
    graph, left = analysis.graph, _MOST_EDGES
    edges: list[list[int]] = []
    if graph is None:
        return edges
    around = set(graph.detours)
    for node, neighbours in enumerate(graph.neighbours):
        higher = [other for other, _ in neighbours if other > node and (node, other) not in around]
        edges.append(higher[:left])
        left -= len(edges[-1])
    return edges


def _detours(analysis: MissionAnalysis) -> list[list[Degrees]]:
    graph = analysis.graph
    if graph is None:
        return []
    detours = list(graph.detours)[:_MOST_EDGES]
    ways = ([graph.position(a), *graph.via(a, b), graph.position(b)] for a, b in detours)
    return [line(graph.mission.frame, way) for way in ways]


def _legs(analysis: MissionAnalysis) -> list[dict[str, Any]]:
    mission = analysis.mission
    if mission is None:
        return []
    points = iter(line(mission.frame, [point for leg in analysis.legs for point in leg.points]))
    return [
        {
            "from": leg.start,
            "to": leg.end,
            "way": leg.way.value,
            "points": [next(points) for _ in leg.points],
        }
        for leg in analysis.legs
    ]


def _settings(parts: Parts, analysis: MissionAnalysis) -> dict[str, Any]:
    form, length_m = analysis.placed.form, analysis.length_m()
    return {
        "settable": parts.settable,
        **{
            name: getattr(getattr(form, section) if section else form, name)
            for section, names in SETTINGS.items()
            for name in names
        },
        "name": form.title,
        "uav": analysis.uav,
        "team": form.team_file and relpath(form.team_file, form.path.parent),
        "robots": _robots(analysis),
        "length_m": round(length_m),
        "time_s": round(length_m / form.speed_m_s) if form.speed_m_s > 0 else None,
    }


def _robots(analysis: MissionAnalysis) -> list[dict[str, Any]]:
    """Whom the mission may seek, and whether it does; those that are sought in their order."""
    form = analysis.placed.form
    if form.team_file is None:
        return []
    try:
        team = Team.load(form.team_file)
    except (DocumentError, OSError):
        return []  # the team's problems are listed
    others = [name for name in team.robots if name != analysis.uav]
    sought = form.seek.robots or [n for n in others if team.robots[n].kind != UAV_KIND]
    names = dict.fromkeys([*sought, *others])
    return [{"name": name, "sought": name in sought} for name in names]


def _on_map(parts: Parts, pair: Pair) -> Pair | None:
    """A pair of the file as it is drawn; None if it is not on Earth."""
    place, origin = parts.geodetic(pair), parts.origin
    return place if place is None or origin is None else beside(origin, place)
