"""Pictures of a mission: zones, waypoint graph, a route, a flown track, and what is wrong.

Needs matplotlib.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import shapely
from shapely.geometry.base import BaseGeometry

from air_router.counted import counted
from air_router.errors import PictureError
from air_router.mission.faults import Faults, far
from air_router.mission.mission import Mission
from air_router.routing.graph import WaypointGraph
from air_router.routing.router import Route
from geo.airspace.zone import Zone
from geo.frame import Point
from mocha_link.errors import needs_extra

with needs_extra("a picture", "plot", "air-router"):
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from air_router.report.map_marks import (
        AROUND,
        EDGE,
        FENCE,
        HOME,
        IDLE,
        RALLY,
        ROBOT,
        ROUTE,
        TRACK,
        WRONG,
        ZONE,
        ZONE_FILL,
        ZONE_HATCH,
        ZONE_NAME,
        draw_lines,
        draw_shape,
        drawn,
        quiet_direction,
        roomiest,
        write_name,
        write_number,
    )
    from air_router.report.map_sheet import GROUND, INK, label_sheet, new_sheet

__all__ = ["PictureError", "draw_airspace", "draw_home", "draw_mission", "draw_zones", "save"]

_DPI = 130
_MOST_NUMBERS = 150
"""With more waypoints their numbers would cover each other; so would legs that are no edges."""

_MOST_NAMES = 60
_MANY_EDGES = 2_000


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
    """Draw a mission into a file; its name's ending (.png, .svg, .pdf) chooses the format.

    Args:
        mission: fences, zones with their clearance, waypoints, home, rally points. Zones that do
            not apply at its altitudes and in its time are drawn faint.
        path: the file to write.
        graph: draw its edges too.
        route: a start and the route from there.
        track: where the vehicle flew.
        meetings: robots that it found, and where it was then.
        around: straight legs that are flown around something.
        faults: what is wrong with the mission, in red.

    Raises:
        PictureError: the file cannot be written, or its ending is not a picture's.
    """
    wrong = () if faults is None else [corner for r in faults.refused for corner in r.ring]
    figure, axes = new_sheet(mission, [*(track or ()), *wrong])
    draw_airspace(axes, mission)
    if graph is not None:
        _draw_graph(axes, graph)
    _draw_around(axes, around)
    if track:
        _draw_track(axes, track)
    if route is not None:
        _draw_route(axes, *route)
    if faults is not None:
        _draw_faults(axes, faults)
    _draw_places(axes, mission, graph, faults)
    _draw_meetings(axes, meetings)
    label_sheet(figure, axes, mission.name, _subtitle(mission), _verdict(faults))
    save(figure, path)


def save(figure: Figure, path: Path) -> None:
    """Write a picture.

    Raises:
        PictureError: the file cannot be written, or its ending is not a picture's.
    """
    try:
        figure.savefig(path, dpi=_DPI, facecolor="white", bbox_inches="tight", pad_inches=0.12)
    except (OSError, ValueError) as error:
        raise PictureError(f"cannot write the picture {path}: {error}") from None


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


def draw_airspace(axes: Axes, mission: Mission) -> None:
    """Fences and zones, with what is kept from the zones that apply."""
    if mission.fences:
        inside = shapely.intersection_all([drawn(fence) for fence in mission.fences])
        draw_shape(axes, inside, facecolor=GROUND, zorder=1)
        style: dict[str, Any] = {"fill": False, "edgecolor": FENCE, "linewidth": 1.6, "zorder": 4}
        for number, fence in enumerate(mission.fences):
            draw_shape(axes, drawn(fence), label="_" if number else "fence", **style)
    _draw_idle(axes, mission)
    own = any(zone.clearance_m is not None for zone in mission.airspace.zones)
    kept = "clearance" if own else f"clearance {mission.planner.clearance_m:g} m"
    draw_zones(axes, mission.airspace.zones, mission.airspace.inflated(), kept)


def draw_zones(axes: Axes, zones: Sequence[Zone], grown: Sequence[BaseGeometry], kept: str) -> None:
    """Zones that apply, and each grown by what is kept from it, with the name for that."""
    if not zones:
        return
    buffers = shapely.union_all(grown)
    draw_shape(axes, buffers, facecolor=ZONE, alpha=0.08, zorder=2)
    dashed: dict[str, Any] = {"fill": False, "linewidth": 0.8, "linestyle": (0, (3, 2))}
    draw_shape(axes, buffers, edgecolor=ZONE, zorder=3, label=kept, **dashed)
    hatched = {"facecolor": ZONE_FILL, "hatch": "////", "hatchcolor": ZONE_HATCH}
    areas = shapely.union_all([drawn(zone.shape) for zone in zones])
    label = "no-fly zone"
    draw_shape(axes, areas, edgecolor=ZONE, linewidth=1.0, zorder=3, label=label, **hatched)
    if len(zones) <= _MOST_NAMES:
        for zone in zones:
            write_name(axes, zone.name, roomiest(zone.polygon), (ZONE_NAME, ZONE_FILL))


def _draw_idle(axes: Axes, mission: Mission) -> None:
    for number, idle in enumerate(mission.idle_zones):
        style: dict[str, Any] = {"linewidth": 0.8, "linestyle": (0, (1, 2)), "edgecolor": IDLE}
        draw_shape(axes, drawn(idle.zone.shape), facecolor=IDLE, alpha=0.13, zorder=1.5)
        label = "_" if number else "zone that does not apply"
        draw_shape(axes, drawn(idle.zone.shape), fill=False, zorder=1.6, label=label, **style)
        if len(mission.idle_zones) <= _MOST_NAMES:
            place = roomiest(idle.zone.polygon)
            reach_m = math.sqrt(idle.zone.polygon.area) / 4
            below = any(math.dist(w.position, place) < reach_m for w in mission.waypoints)
            write_name(axes, idle.zone.name, place, ("#7a8188", GROUND), below=below)


def _draw_graph(axes: Axes, graph: WaypointGraph) -> None:
    lines = [[graph.position(a), *graph.via(a, b), graph.position(b)] for a, b in graph.edges]
    width, label = (
        0.6 if len(lines) < _MANY_EDGES else 0.25,
        counted(len(lines), "clear connections"),
    )
    draw_lines(axes, lines, EDGE, width, alpha=0.5, zorder=2.5, label=label)


def _draw_around(axes: Axes, legs: Sequence[tuple[Point, Point]]) -> None:
    if 0 < len(legs) <= _MOST_NUMBERS:
        style: dict[str, Any] = {"linestyles": (0, (4, 2)), "zorder": 4.5}
        draw_lines(axes, legs, AROUND, 1.1, label="leg flown around an obstacle", **style)


def _draw_track(axes: Axes, track: Sequence[Point]) -> None:
    east, north = zip(*track, strict=True)
    axes.plot(east, north, color="white", linewidth=3.2, zorder=5, solid_capstyle="round")
    axes.plot(
        east, north, color=TRACK, linewidth=1.6, zorder=5.1, label="flown", solid_capstyle="round"
    )


def _draw_meetings(axes: Axes, meetings: Sequence[tuple[str, Point]]) -> None:
    if not meetings:
        return
    names, places = zip(*meetings, strict=True)
    style: dict[str, Any] = {"marker": "s", "s": 34, "color": ROBOT, "edgecolor": "white"}
    axes.scatter(*zip(*places, strict=True), linewidth=1, zorder=8.2, label="robot found", **style)
    for name, place in zip(names, places, strict=True):
        write_name(axes, name, place, (ROBOT, "white"), below=True, zorder=8.3)


def _draw_route(axes: Axes, start: Point, route: Route) -> None:
    points = [start, *(leg.to for leg in route.legs)]
    east, north = zip(*points, strict=True)
    axes.plot(east, north, color="white", linewidth=5, zorder=6, solid_joinstyle="round")
    style: dict[str, Any] = {"color": ROUTE, "linewidth": 2.6, "solid_joinstyle": "round"}
    axes.plot(east, north, zorder=6.1, label=f"route, {route.length_m:.0f} m", **style)
    arrow = {"arrowstyle": "-|>", "color": ROUTE, "mutation_scale": 13}
    for before, after in pairwise(points):
        way = after[0] - before[0], after[1] - before[1]
        middle, ahead = (
            (before[0] + share * way[0], before[1] + share * way[1]) for share in (0.5, 0.51)
        )
        if math.dist(before, after) > 1:
            axes.annotate("", xy=ahead, xytext=middle, arrowprops=arrow, zorder=6.2)
    for point in (points[0], points[-1]):
        axes.scatter(*point, s=60, color=ROUTE, edgecolor="white", linewidth=1.2, zorder=6.9)


def _draw_faults(axes: Axes, faults: Faults) -> None:
    for number, shape in enumerate(faults.shapes):
        label = "_" if number else "wrong area"
        style: dict[str, Any] = {"fill": False, "edgecolor": WRONG, "linewidth": 2, "zorder": 4.6}
        draw_shape(axes, drawn(shape), label=label, **style)
    for number, refused in enumerate(faults.refused):
        east, north = zip(*refused.ring, refused.ring[0], strict=True)
        label = "_" if number else "no area"
        axes.plot(east, north, color=WRONG, linewidth=1.6, zorder=4.7, label=label)
        if refused.place is not None:
            axes.scatter(*refused.place, marker="x", s=90, color=WRONG, linewidth=2.2, zorder=9.2)
        place = Point(*refused.ring[0])
        write_number(axes, refused.name, place, math.pi / 2, wrong=True)
    if faults.legs:
        draw_lines(axes, faults.legs, WRONG, 1.8, zorder=4.8, label="illegal leg")


def _draw_places(
    axes: Axes, mission: Mission, graph: WaypointGraph | None, faults: Faults | None
) -> None:
    wrong = {spot.position for spot in (() if faults is None else faults.spots)}
    seen = [w for w in mission.waypoints if not far(w.position, mission)]
    dot = 15 if len(seen) <= _MOST_NUMBERS else 5
    for part, marker, size, colour, label in (
        ([w.position for w in seen if w.position not in wrong], "o", dot, "white", "waypoint"),
        ([p for p in mission.rally_points if p not in wrong], "D", 17, RALLY, "rally point"),
        ([p for p in wrong if not far(p, mission)], "o", 46, WRONG, "wrong place"),
    ):
        if part:
            east, north = zip(*part, strict=True)
            style: dict[str, Any] = {"marker": marker, "s": size, "color": colour, "edgecolor": INK}
            axes.scatter(east, north, linewidth=0.8, zorder=7, label=label, **style)
    draw_home(axes, mission.home)
    for waypoint in seen:
        bad = waypoint.position in wrong
        if bad or len(seen) <= _MOST_NUMBERS:
            angle = quiet_direction(waypoint.number, graph)
            write_number(axes, str(waypoint.number), waypoint.position, angle, wrong=bad)


def draw_home(axes: Axes, home: Point) -> None:
    """Where the vehicle takes off and lands."""
    style: dict[str, Any] = {"marker": "^", "s": 85, "color": HOME, "edgecolor": "white"}
    axes.scatter(*home, linewidth=1, zorder=8, label="home", **style)
