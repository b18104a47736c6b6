"""Pictures of a mission: zones, waypoint graph, a route, a flown track, and faults.

Also of a coverage: the area, the covered part, and the rows. Needs matplotlib.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import shapely
from shapely.geometry.base import BaseGeometry

from air_router.coverage import Field
from air_router.mission import Faults, Mission, far
from air_router.report.figure_style import Ink, figure_style
from air_router.report.map_sheet import MapSheet, drawn, roomiest
from air_router.routing import Route, WaypointGraph
from air_router.words import counted
from geo.airspace import Zone
from geo.coverage import Coverage
from geo.frame import Point
from mocha_link.sanitize import sanitize

_MOST_NUMBERS: Final = 150
"""With more waypoints their numbers, and legs that are no edges, would overlap."""

_MOST_NAMES: Final = 60
_MANY_EDGES: Final = 2_000
_BORDER: Final[dict[str, Any]] = {
    "fill": False,
    "edgecolor": Ink.FENCE,
    "linewidth": 1.4,
    "zorder": 4,
}
_DASHED, _DOTTED = (0, (3, 2)), (0, (1, 2))


@figure_style()
def draw_mission(  # noqa: PLR0913 - the layers of a picture
    mission: Mission,
    path: Path,
    *,
    graph: WaypointGraph | None = None,
    route: tuple[Point, Route] | None = None,
    track: Sequence[Point] | None = None,
    meetings: Sequence[tuple[str, Point]] = (),
    around: Sequence[tuple[Point, Point]] = (),
    faults: Faults | None = None,
) -> None:
    """Draw a mission to a file; the suffix (.png, .svg, .pdf) chooses the format.

    Args:
        mission: Fences, zones with their clearance, waypoints, home, rally points. Zones that do
            not apply at its altitudes and times are drawn faint. Anything impossibly far from home
            is omitted.
        path: The file to write.
        graph: Also draw its edges.
        route: A start and the route from there.
        track: The flown track.
        meetings: Robots that the vehicle found, and its positions then.
        around: Straight legs that are flown around an obstacle.
        faults: The faults of the mission, in red.

    Raises:
        PictureError: The file cannot be written, or its suffix is not a picture's.
    """
    points = [mission.home, *(w.position for w in mission.waypoints), *(track or ())]
    points += [] if faults is None else [corner for r in faults.refused for corner in r.ring]
    shapes = mission.fences or [zone.shape for zone in mission.zones]
    points += [*mission.rally_points, *(corner for shape in shapes for corner in shape.corners)]
    near = [point for point in points if not far(point, mission)]
    sheet = MapSheet(near, Ink.GROUND if not mission.fences else Ink.BEYOND)
    draw_airspace(sheet, mission)
    if graph is not None:
        lines = [[graph.position(a), *graph.via(a, b), graph.position(b)] for a, b in graph.edges]
        width, label = 0.6 if len(lines) < _MANY_EDGES else 0.25, "clear connections"
        sheet.lines(lines, Ink.EDGE, width, counted(len(lines), label), alpha=0.5, zorder=2.5)
    if 0 < len(around) <= _MOST_NUMBERS:
        dashed: dict[str, Any] = {"linestyles": (0, (4, 2)), "zorder": 4.5}
        sheet.lines(around, Ink.AROUND, 1.1, "leg flown around an obstacle", **dashed)
    if track:
        sheet.way(track, Ink.TRACK, 1.6, "flown", 5)
    if route is not None:
        _draw_route(sheet, *route)
    if faults is not None:
        _draw_faults(sheet, faults)
    places = [place for _, place in meetings]
    sheet.marks(places, "s", 34, Ink.ROBOT, "robot found", zorder=8.2)
    _draw_places(sheet, mission, graph, faults)
    for name, place in meetings:
        sheet.name(name, place, (Ink.ROBOT, Ink.HALO), below=True, z=8.3)
    sheet.save(path, mission.name, _subtitle(mission), _verdict(faults))


@figure_style()
def draw_coverage(field: Field, plan: Coverage, path: Path, caption: str) -> None:
    """Draw a coverage to a file; the suffix (.png, .svg, .pdf) chooses the format.

    Raises:
        PictureError: The file cannot be written, or its suffix is not a picture's.
    """
    corners = [Point(*corner) for corner in shapely.get_coordinates(field.area).tolist()]
    home = [] if field.home is None else [field.home]
    sheet = MapSheet([*corners, *plan.track, *home], Ink.GROUND)
    for fence in field.airspace.fences:
        sheet.shape(drawn(fence), "fence", **_BORDER)
    sheet.shape(field.area, "area", **(_BORDER | {"edgecolor": Ink.TEXT, "linewidth": 1.2}))
    sheet.shape(plan.seen, "covered", facecolor=Ink.COVERED, zorder=1.2)
    missed = [part for missed in plan.missed for part in missed.parts]
    if missed:
        sheet.shape(shapely.union_all(missed), "not covered", facecolor=Ink.WRONG, zorder=2.9)
    _draw_zones(sheet, field.airspace.zones, field.airspace.inflated(), "distance kept")
    sheet.lines([plan.track], Ink.HALO, 2.6, zorder=5)
    rows = [(row.start, row.end) for row in plan.rows]
    for lines, width, colour, label in (
        ([plan.way_out, plan.way_back], 1.0, Ink.TRACK, "from home and back"),
        ([plan.track], 1.0, Ink.AROUND, "on to the next row"),
        (rows, 1.6, Ink.ROUTE, f"{len(rows)} rows"),
    ):
        if shown := [line for line in lines if len(line) > 1]:
            sheet.lines(shown, colour, width, label, zorder=5.2)
    for place in home:
        sheet.home(place)
    sheet.marks([plan.rows[0].start], "o", 36, Ink.ROUTE, "first row")
    caption = caption.replace(" m2", " m²").replace(" deg", "°")
    sheet.save(path, sanitize(field.placed.form.title), caption)


def _subtitle(mission: Mission) -> str:
    altitudes = [w.altitude_above_home_m for w in mission.waypoints]
    altitudes = altitudes or [mission.altitude_above_home_m]
    lowest, highest = f"{min(altitudes):g}", f"{max(altitudes):g}"
    height = lowest if lowest == highest else f"{lowest} to {highest}"
    idle = f" ({len(mission.idle_zones)} not in force)" if mission.idle_zones else ""
    return (
        f"{counted(len(mission.waypoints), 'waypoints')}, "
        f"{counted(len(mission.zones), 'no-fly zones')}{idle}, "
        f"{height} m above home"
    )


def _verdict(faults: Faults | None) -> str:
    if faults is None:
        return ""
    problems = counted(faults.count, "problems")
    if not faults.off_sheet:
        return f"cannot be flown: {problems}"
    return f"cannot be flown: {problems}; off this sheet: {', '.join(faults.off_sheet)}"


def draw_airspace(sheet: MapSheet, mission: Mission) -> None:
    """Fences and zones, with the clearance of the zones that apply."""
    if mission.fences:
        inside = shapely.intersection_all([drawn(fence) for fence in mission.fences])
        sheet.shape(inside, facecolor=Ink.GROUND, zorder=1)
    for fence in mission.fences:
        sheet.shape(drawn(fence), "fence", **(_BORDER | {"linewidth": 1.6}))
    _draw_idle(sheet, mission)
    own = any(zone.clearance_m is not None for zone in mission.airspace.zones)
    kept = "clearance" if own else f"clearance {mission.planner.clearance_m:g} m"
    _draw_zones(sheet, mission.airspace.zones, mission.airspace.inflated(), kept)


def _draw_zones(
    sheet: MapSheet, zones: Sequence[Zone], grown: Sequence[BaseGeometry], kept: str
) -> None:
    """Draw the zones that apply, each also grown by its clearance."""
    if not zones:
        return
    buffers = shapely.union_all(grown)
    sheet.shape(buffers, facecolor=Ink.ZONE, alpha=0.08, zorder=2)
    dashed: dict[str, Any] = {"fill": False, "linewidth": 0.8, "linestyle": _DASHED}
    sheet.shape(buffers, kept, edgecolor=Ink.ZONE, zorder=3, **dashed)
    hatched = {"facecolor": Ink.ZONE_FILL, "hatch": "////", "hatchcolor": Ink.ZONE_HATCH}
    areas = shapely.union_all([drawn(zone.shape) for zone in zones])
    sheet.shape(areas, "no-fly zone", edgecolor=Ink.ZONE, linewidth=1.0, zorder=3, **hatched)
    if len(zones) <= _MOST_NAMES:
        for zone in zones:
            sheet.name(zone.name, roomiest(zone.polygon), (Ink.ZONE_NAME, Ink.ZONE_FILL), z=3.5)


def _draw_idle(sheet: MapSheet, mission: Mission) -> None:
    dotted: dict[str, Any] = {"linewidth": 0.8, "linestyle": _DOTTED, "edgecolor": Ink.IDLE}
    for idle in mission.idle_zones:
        shape = drawn(idle.zone.shape)
        sheet.shape(shape, facecolor=Ink.IDLE, alpha=0.13, zorder=1.5)
        sheet.shape(shape, "zone that does not apply", fill=False, zorder=1.6, **dotted)
        if len(mission.idle_zones) <= _MOST_NAMES:
            place = roomiest(idle.zone.polygon)
            reach_m = math.sqrt(idle.zone.polygon.area) / 4
            below = any(math.dist(w.position, place) < reach_m for w in mission.waypoints)
            sheet.name(idle.zone.name, place, (Ink.FAINT, Ink.GROUND), below=below, z=3.5)


def _draw_route(sheet: MapSheet, start: Point, route: Route) -> None:
    points = [start, *(leg.to for leg in route.legs)]
    sheet.way(points, Ink.ROUTE, 2.6, f"route, {route.length_m:.0f} m", 6)
    arrow = {"arrowstyle": "-|>", "color": Ink.ROUTE, "mutation_scale": 13}
    for before, after in pairwise(points):
        if math.dist(before, after) > 1:
            way = after[0] - before[0], after[1] - before[1]
            middle, ahead = (
                (before[0] + share * way[0], before[1] + share * way[1]) for share in (0.5, 0.51)
            )
            sheet.axes.annotate("", xy=ahead, xytext=middle, arrowprops=arrow, zorder=6.2)
    sheet.marks([points[0], points[-1]], "o", 60, Ink.ROUTE, linewidth=1.2, zorder=6.9)


def _draw_faults(sheet: MapSheet, faults: Faults) -> None:
    for shape in faults.shapes:
        red = _BORDER | {"edgecolor": Ink.WRONG, "linewidth": 2, "zorder": 4.6}
        sheet.shape(drawn(shape), "wrong area", **red)
    for refused in faults.refused:
        ring = [Point(*corner) for corner in (*refused.ring, refused.ring[0])]
        sheet.lines([ring], Ink.WRONG, 1.6, "no area", zorder=4.7)
        if refused.place is not None:
            crossing = [Point(*refused.place)]
            sheet.marks(crossing, "x", 90, Ink.WRONG, edgecolor=None, linewidth=2.2, zorder=9.2)
        sheet.number(refused.name, ring[0], math.pi / 2, wrong=True)
    if faults.legs:
        sheet.lines(faults.legs, Ink.WRONG, 1.8, "illegal leg", zorder=4.8)


def _draw_places(
    sheet: MapSheet, mission: Mission, graph: WaypointGraph | None, faults: Faults | None
) -> None:
    wrong = {spot.position for spot in (() if faults is None else faults.spots)}
    seen = [w for w in mission.waypoints if not far(w.position, mission)]
    numbered = len(seen) <= _MOST_NUMBERS
    good = [w.position for w in seen if w.position not in wrong]
    rally = [place for place in mission.rally_points if place not in wrong]
    edge: dict[str, Any] = {"edgecolor": Ink.TEXT, "linewidth": 0.8}
    sheet.marks(good, "o", 15 if numbered else 5, Ink.HALO, "waypoint", **edge)
    sheet.marks(rally, "D", 17, Ink.RALLY, "rally point", **edge)
    bad = [place for place in wrong if not far(place, mission)]
    sheet.marks(bad, "o", 46, Ink.WRONG, "wrong place", **edge)
    sheet.home(mission.home)
    for waypoint in seen:
        is_wrong = waypoint.position in wrong
        if is_wrong or numbered:
            angle = _quiet_direction(waypoint.number, graph)
            sheet.number(str(waypoint.number), waypoint.position, angle, wrong=is_wrong)


def _quiet_direction(node: int, graph: WaypointGraph | None) -> float:
    """The middle of the widest angle between a node's edges, the best place for its number."""
    if graph is None or node not in graph.positions or not graph.neighbours[node]:
        return math.pi / 4
    here = graph.position(node)
    bearings = sorted(
        math.atan2(there.north_m - here.north_m, there.east_m - here.east_m)
        for there in (graph.position(other) for other, _ in graph.neighbours[node])
    )
    gaps = [
        (after - before, before)
        for before, after in pairwise([*bearings, bearings[0] + 2 * math.pi])
    ]
    width, begin = max(gaps)
    return begin + width / 2
