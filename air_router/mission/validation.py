"""Validates the geometry of a mission: problems, and the faults to draw in its picture."""

import contextlib
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely import Polygon, STRtree

from air_router.files import (
    Area,
    Findings,
    HomeAltitudeError,
    MissionForm,
    RefusedRing,
)
from air_router.files.missions import MissionPoint, PlacedForm
from air_router.mission.mission import FlightWindow, Mission, MissionAreas, areas_of
from air_router.mission.tracking import TrackingMargin
from geo.airspace import FENCE, Airspace, Circle, Shape, ZoneError, circle_ring
from geo.frame import FrameError, Point
from geo.paths import barriers, shortest_paths
from mocha_link.team import Problem

FAR_M = 50_000.0
"""Places farther from home than this are typing errors, and are not drawn."""

_SAME_PLACE_M = 0.1
_AT_ZERO_DEG = 0.01
_WHOLE_DEG = 1e-6
_ALL_WITHIN_M = 1.0  # a smaller mission has degrees that were read as metres
_SLIVER_M2 = 0.01

_CODES = {
    "home": ("home-outside-fence", "home-in-zone", "home-too-near"),
    "waypoint": ("waypoint-outside-fence", "waypoint-in-zone", "waypoint-too-near"),
    "rally point": ("rally-point-outside-fence", "rally-point-in-zone", "rally-point-too-near"),
}
"""Codes of places outside the fence, in a zone, and too near to either."""


def checked_areas(placed: PlacedForm, window: FlightWindow, findings: Findings) -> MissionAreas:
    """The areas of a mission; reports every problem of its places and areas."""
    areas, unread = areas_of(placed, window), placed.form.unread
    if placed.frame is None:
        return areas
    if not placed.waypoints and "waypoints" not in unread and not findings.problems:
        message = "a mission needs at least one waypoint; add one"
        findings.report(("waypoints",), message, "no-waypoints")
    if _check_units_of_places(placed, findings):
        return areas
    _check_names(placed, findings)
    _check_altitudes(placed, findings)
    _note_settings(placed.form, findings)
    _check_fence_crossings(placed, findings)
    _check_same_places(placed, findings)
    far = _check_distances(placed, findings)
    inside_known = "the fence" not in far  # every place is outside a misplaced fence
    kept = inside_known and _check_spots(placed, areas, far, findings)
    if kept and not far and "planner" not in unread:
        _check_ways(placed, areas, findings)
    return areas


def _check_names(placed: PlacedForm, findings: Findings) -> None:
    first: dict[str, Area] = {}
    for area in placed.zones:
        if area.name in first or area.name == FENCE:
            message = f"another area is called '{area.name}' too; rename one"
            findings.report(area.keys, message, "same-name", area.source)
        first.setdefault(area.name, area)


def _check_altitudes(placed: PlacedForm, findings: Findings) -> None:
    altitudes_m = placed.form.altitudes_m
    if altitudes_m and altitudes_m[0] > altitudes_m[1]:
        message = (
            "'altitudes_m' are the lowest and the highest altitude, in this order; exchange them"
        )
        findings.report(("altitudes_m",), message, "out-of-range")
    for area in placed.zones:
        label = f"no-fly zone '{area.name}'"
        try:
            placed.band(area)
        except HomeAltitudeError:
            message = (
                f"{label} has limits above the sea, and home's altitude is not known; "
                "add 'altitude_amsl_m' to home"
            )
            findings.report(area.keys, message, "home-altitude-unknown", area.source)
        except ZoneError as error:
            findings.report(area.keys, f"{label}: {error}", error.code, area.source)
        else:
            _note_contradiction(placed, area, findings)


def _note_contradiction(placed: PlacedForm, area: Area, findings: Findings) -> None:
    given, home_amsl_m = area.terms.altitudes, placed.home_altitude_amsl_m
    if given is None or not given.contradicts(home_amsl_m, placed.form.planner.terrain_relief_m):
        return
    home = "" if home_amsl_m is None else f", and home is {home_amsl_m:g} m above the sea"
    message = (
        f"no-fly zone '{area.name}' reaches from {given.lower} up to {given.upper}{home}: its "
        "limits exclude each other here; read as at every altitude"
    )
    findings.note(area.keys, message, "altitudes-contradict", area.source)


def _check_distances(placed: PlacedForm, findings: Findings) -> set[str]:
    """Report far places, which are typing errors: digits, signs, or longitude first.

    Returns the labels of such places, for which nothing else is reported.
    """
    far: set[str] = set()
    if placed.home is None:
        return far
    advice = "correct it (latitude comes first)" if not placed.form.in_metres else "correct it"
    home = placed.home.position
    spots = (*placed.waypoints, *placed.rally_points)
    nearest_m = min((math.dist(spot.position, home) for spot in spots), default=0.0)
    together = all(math.dist(spot.position, spots[0].position) <= FAR_M for spot in spots)
    if nearest_m > FAR_M and len(spots) > 1 and together:
        message = f"home is {nearest_m / 1000:.0f} km from every other place; {advice}"
        findings.report(placed.home.keys, message, "far-from-home")
        areas = [_label(placed, area) for area in (*placed.zones, *placed.fences)]
        return {placed.home.label, *(spot.label for spot in spots), *areas}
    for spot in spots:
        if (far_m := math.dist(spot.position, home)) > FAR_M:
            meant = _meant(placed, spot.position) or advice
            message = f"{spot.label} is {far_m / 1000:.0f} km from home; {meant}"
            findings.report(spot.keys, message, "far-from-home")
            far.add(spot.label)
    for area in (*placed.zones, *placed.fences):
        far_m = max(math.dist(corner, home) for corner in area.shape.corners)
        if area.crosses_fence:  # may be of any size, like zones of other files
            far_m = float(area.shape.polygon.distance(shapely.Point(home)))
        if far_m > FAR_M and area.source is None:
            label = _label(placed, area)
            reaches = "is" if area.crosses_fence else "reaches"
            meant = _meant(placed, area.shape.corners[0]) or advice
            message = f"{label} {reaches} {far_m / 1000:.0f} km from home; {meant}"
            findings.report(area.keys, message, "far-from-home", area.source)
            far.add(label)
    return far


def _meant(placed: PlacedForm, position: Point) -> str:
    """The correction that puts a far place near home, as text; empty if there is none."""
    if placed.form.in_metres or placed.frame is None or placed.home is None:
        return ""
    latitude_deg, longitude_deg = placed.frame.to_geodetic(position)
    for what, place in (
        ("latitude comes first", (longitude_deg, latitude_deg)),
        ("the sign of its longitude is wrong (west is negative)", (latitude_deg, -longitude_deg)),
        ("the sign of its latitude is wrong (south is negative)", (-latitude_deg, longitude_deg)),
    ):
        with contextlib.suppress(FrameError):
            if math.dist(placed.frame.to_local(*place), placed.home.position) <= FAR_M:
                return f"{what}: [{place[0]:.9g}, {place[1]:.9g}]"
    if all(abs(degrees - round(degrees)) < _WHOLE_DEG for degrees in (latitude_deg, longitude_deg)):
        return "correct it (latitude comes first; pairs in metres need 'coordinates: local')"
    return ""


def _check_units_of_places(placed: PlacedForm, findings: Findings) -> bool:
    """Report coordinates in the wrong unit: degrees as metres, or zeros.

    Returns whether degrees were read as metres; then nothing else is reported.
    """
    if placed.home is None or placed.frame is None:
        return False
    origin, home = placed.frame.origin, placed.home
    if max(abs(origin.latitude_deg), abs(origin.longitude_deg)) < _AT_ZERO_DEG:
        keys = ("frame", "origin") if placed.form.in_metres else home.keys
        message = (
            "latitude 0, longitude 0 is in the Atlantic; enter the place (a GPS without a fix "
            "shows zeros; metres need 'coordinates: local' and a frame)"
        )
        findings.note(keys, message, "place-at-zero")
    spread_m = max((math.dist(w.position, home.position) for w in placed.waypoints), default=0.0)
    if placed.form.in_metres and 0.0 < spread_m < _ALL_WITHIN_M:
        message = (
            f"all waypoints lie within {spread_m:.2g} m of home: 'local' pairs are metres east and "
            "north; for degrees leave 'coordinates' out"
        )
        findings.report(("coordinates",), message, "degrees-as-metres")
        return True
    return False


def _note_settings(form: MissionForm, findings: Findings) -> None:
    """Note pairs of settings in which one makes the other ineffective."""
    duration_s, endurance_s = form.duration_s, form.endurance_s
    if duration_s is not None and endurance_s is not None and duration_s > endurance_s:
        message = (
            f"'duration_s' is {duration_s:g} s, and a full battery lasts {endurance_s:g} s "
            "('endurance_s'): the battery ends the mission first; lower it"
        )
        findings.note(("duration_s",), message, "settings-contradict")
    init_s = form.timers.init_s
    if form.team is not None and duration_s is not None and init_s >= duration_s:
        message = (
            f"no robot is ever sought: the first exploration takes {init_s:g} s ('timers.init_s') "
            f"and the mission {duration_s:g} s ('duration_s'); shorten the first"
        )
        findings.note(("duration_s",), message, "settings-contradict")
    altitudes_m = form.altitudes_m or ()
    if altitudes_m and not altitudes_m[0] <= form.altitude_m <= altitudes_m[1]:
        message = (
            f"'altitude_m' is {form.altitude_m:g} m, beside 'altitudes_m' "
            f"({altitudes_m[0]:g} to {altitudes_m[1]:g} m): a vehicle that was sent "
            "elsewhere cannot be sent back to it; widen them"
        )
        findings.note(("altitudes_m",), message, "settings-contradict")


def _label(placed: PlacedForm, area: Area) -> str:
    return "the fence" if area in placed.fences else f"no-fly zone '{area.name}'"


def _check_fence_crossings(placed: PlacedForm, findings: Findings) -> None:
    if not placed.fences:
        return
    inside = shapely.intersection_all([area.shape.polygon for area in placed.fences])
    shapely.prepare(inside)
    zones = np.array([_within(area.shape) for area in placed.zones], dtype=object)
    across = np.flatnonzero(~shapely.covers(inside, zones) & shapely.intersects(inside, zones))
    for area, zone in zip(map(placed.zones.__getitem__, across), zones[across], strict=True):
        beyond = zone.difference(inside).area > _SLIVER_M2
        within = zone.intersection(inside).area > _SLIVER_M2
        if beyond and within and not area.crosses_fence:
            message = (
                f"no-fly zone '{area.name}' crosses the fence; move its corners inside, "
                "or confirm that it is meant with 'crosses_fence: true'"
            )
            findings.report(area.keys, message, "zone-crosses-fence", area.source)


def _within(shape: Shape) -> Polygon:
    if isinstance(shape, Circle):
        return Polygon(circle_ring(shape.centre, shape.radius_m, outward=False))
    return shape.polygon


def _check_same_places(placed: PlacedForm, findings: Findings) -> None:
    if not placed.waypoints:
        return
    places = shapely.points([spot.position for spot in placed.waypoints])
    later, earlier = STRtree(places).query(places, predicate="dwithin", distance=_SAME_PLACE_M)
    on: dict[int, int] = {}
    for number, other in zip(later.tolist(), earlier.tolist(), strict=True):
        if other < number:
            on[number] = min(other, on.get(number, other))
    for number, other in sorted(on.items()):
        spot, before = placed.waypoints[number], placed.waypoints[other]
        message = f"{spot.label} lies on {before.label}; remove one of them"
        findings.report(spot.keys, message, "same-place")


def _check_spots(
    placed: PlacedForm, areas: MissionAreas, far: Collection[str], findings: Findings
) -> bool:
    """Report places that are too near; return whether there are none."""
    cruise = areas.planning_airspace
    climb = cruise
    if areas.climb_airspace is not areas.airspace:
        climb = areas.climb_airspace.with_margin(_margin_m(placed))
    if "planner" in placed.form.unread:
        cruise, climb = areas.airspace.as_drawn(), areas.climb_airspace.as_drawn()
    landings = [*([placed.home] if placed.home else []), *placed.rally_points]
    wrong = []
    for spots, airspace in ((landings, climb), (placed.waypoints, cruise)):
        clear = airspace.points_clear([spot.position for spot in spots])
        wrong += [(spot, airspace) for spot, ok in zip(spots, clear, strict=True) if not ok]
    wrong = [(spot, airspace) for spot, airspace in wrong if spot.label not in far]
    for spot, airspace in wrong:
        _report_spot(spot, airspace, placed, findings)
    return not wrong


def _report_spot(
    spot: MissionPoint, airspace: Airspace, placed: PlacedForm, findings: Findings
) -> None:
    holders = airspace.zones_at(spot.position)
    outside, inside, near = _CODES[spot.label.rstrip(" 0123456789")]
    if FENCE in holders:
        findings.report(
            spot.keys, f"{spot.label} lies outside of the fence; move it inside", outside
        )
    elif holders:
        zones = " and ".join(f"'{name}'" for name in holders)
        kept_m = max(airspace.required_m(name) for name in holders)
        to = f", to {_needs(placed, kept_m)}" if "planner" not in placed.form.unread else ""
        message = f"{spot.label} lies inside no-fly zone {zones}; move it out{to}"
        findings.report(spot.keys, message, inside)
    else:
        left_m, name = airspace.clearance_left_m(spot.position)
        kept_m = airspace.required_m(name)
        what = "the fence" if name == FENCE else f"no-fly zone '{name}'"
        own = any(area.name == name and area.terms.clearance_m is not None for area in placed.zones)
        setting = "its clearance_m" if own else "planner.clearance_m"
        message = (
            f"{spot.label} is {_metres(kept_m + left_m)} from {what}, it needs "
            f"{_needs(placed, kept_m)}; move it by {_metres(-left_m)} or lower {setting}"
        )
        findings.report(spot.keys, message, near)


def _margin_m(placed: PlacedForm) -> float:
    return TrackingMargin.of(placed.form.planner, placed.form.speed_m_s).planned_m


def _needs(placed: PlacedForm, kept_m: float) -> str:
    margin_m = _margin_m(placed)
    return f"{kept_m:g} m (clearance {kept_m - margin_m:g} m + tracking margin {margin_m:g} m)"


def _metres(distance_m: float) -> str:
    return f"{distance_m:.2f} m" if distance_m < 1 else f"{distance_m:.1f} m"


def _check_ways(placed: PlacedForm, areas: MissionAreas, findings: Findings) -> None:
    """Report waypoints without a clear way from home (and so from the other waypoints)."""
    if placed.home is None:
        return
    home, airspace = placed.home.position, areas.planning_airspace
    paths = shortest_paths(airspace)
    obstacles: dict[int | None, str] = {}
    needs = _needs(placed, placed.form.planner.clearance_m + _margin_m(placed))
    around_home = paths.part_of(home)
    parts = paths.parts_of([spot.position for spot in placed.waypoints])
    for spot, part in zip(placed.waypoints, parts, strict=True):
        if part == around_home is not None or paths.connected(home, spot.position):
            continue
        if part not in obstacles:
            obstacles[part] = _walls(barriers(airspace, home, spot.position))
        message = (
            f"no clear way leads from home to {spot.label}: {obstacles[part]} at {needs}; open a "
            "gap, or move or remove the waypoint"
        )
        findings.report(spot.keys, message, "waypoint-unreachable")


def _walls(names: Sequence[str]) -> str:
    labels = ["the fence" if name == FENCE else f"'{name}'" for name in names]
    if not labels:
        return "what lies between leaves no room"
    return f"{' and '.join(labels)} {'leaves' if len(labels) == 1 else 'leave'} no room"


# Faults, for pictures


@dataclass(frozen=True, slots=True)
class Faults:
    """The faults to draw in red.

    Attributes:
        count: Number of problems.
        spots: Wrong places: home, waypoints, rally points.
        legs: Straight legs between consecutive waypoints that touch a forbidden area.
        shapes: Wrong fences and zones.
        refused: Rings that do not form an area.
        off_sheet: Labels of places too far away to be drawn.
    """

    count: int
    spots: tuple[MissionPoint, ...]
    legs: tuple[tuple[Point, Point], ...]
    shapes: tuple[Shape, ...]
    refused: tuple[RefusedRing, ...]
    off_sheet: tuple[str, ...] = ()


def faults_of(placed: PlacedForm, findings: Findings, mission: Mission) -> Faults:
    """The faults of a validated mission."""
    spots = [*placed.waypoints, *placed.rally_points, *([placed.home] if placed.home else [])]
    wrong = [spot for spot in spots if _blamed(findings.problems, spot.keys)]
    ends = {spot.position for spot in wrong if spot not in placed.rally_points}
    areas = [area for area in (*placed.fences, *placed.zones) if area.source is None]
    return Faults(
        count=len(set(findings.problems)),
        spots=tuple(wrong),
        legs=tuple(
            (start, end)
            for start, end in blocked_legs(mission)
            if {start, end} & ends and not (far(start, mission) or far(end, mission))
        ),
        shapes=tuple(area.shape for area in areas if _blamed(findings.problems, area.keys)),
        refused=tuple(findings.refused),
        off_sheet=tuple(spot.label for spot in wrong if far(spot.position, mission)),
    )


def far(position: Point, mission: Mission) -> bool:
    """Whether a place is too far from home to be drawn."""
    return math.dist(position, mission.home) > FAR_M


def blocked_legs(mission: Mission) -> list[tuple[Point, Point]]:
    """The legs of the tour from home through all waypoints and back that are not clear."""
    stops = [mission.home, *(w.position for w in mission.waypoints), mission.home]
    legs = [(a, b) for a, b in pairwise(stops) if a != b]
    if not legs:
        return []
    ends = np.array(legs, dtype=float)
    clear = mission.planning_airspace.legs_clear_between(ends[:, 0], ends[:, 1])
    return [leg for leg, ok in zip(legs, clear, strict=True) if not ok]


def _blamed(problems: Sequence[Problem], keys: Sequence[str | int]) -> bool:
    """Whether a problem concerns the value at these keys, or a part of it."""
    length = len(keys)
    return any(problem.keys[:length] == tuple(keys) for problem in problems if problem.keys)
