"""Pictures of a mission: zones, waypoint graph, a route, a flown track. Needs matplotlib."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from air_router.errors import PictureError
from air_router.graph import WaypointGraph
from air_router.mission import Mission
from air_router.router import Route
from geo.frame import Point
from geo.zone import polygons_of

try:
    from matplotlib import patheffects
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    from air_router.map_sheet import GROUND, INK, label_sheet, new_sheet
except ImportError as error:
    raise PictureError(
        "pictures need matplotlib, which is not installed; pip install 'air-router[plot]'"
    ) from error

__all__ = ["PictureError", "draw_mission"]

_FENCE, _ZONE, _EDGE = "#2f7d4f", "#c8383b", "#b9c0c8"
_ROUTE, _TRACK = "#1565c0", "#7b3fa0"
_DPI = 130


def draw_mission(
    mission: Mission,
    path: Path,
    *,
    graph: WaypointGraph | None = None,
    route: tuple[Point, Route] | None = None,
    track: Sequence[Point] | None = None,
) -> None:
    """Draw a mission into a file; its name's ending (.png, .svg, .pdf) chooses the format.

    Args:
        mission: fence, zones with their clearance, waypoints, home, rally points.
        path: the file to write.
        graph: draw its edges too.
        route: a start and the route from there.
        track: where the vehicle flew.

    Raises:
        PictureError: the file cannot be written, or its ending is not a picture's.
    """
    figure, axes = new_sheet(mission, track or ())
    _draw_airspace(axes, mission)
    if graph is not None:
        _draw_graph(axes, graph)
    if track:
        _draw_track(axes, track)
    if route is not None:
        _draw_route(axes, *route)
    _name_zones(axes, mission)
    _draw_places(axes, mission, graph)
    label_sheet(figure, axes, mission)
    try:
        figure.savefig(path, dpi=_DPI, facecolor="white", bbox_inches="tight", pad_inches=0.12)
    except (OSError, ValueError) as error:
        raise PictureError(f"cannot write the picture {path}: {error}") from None


def _draw_airspace(axes: Axes, mission: Mission) -> None:
    if mission.fences:
        inside = shapely.intersection_all([fence.polygon for fence in mission.fences])
        axes.add_patch(_patch(inside, facecolor=GROUND, zorder=1))
        axes.add_patch(
            _patch(
                inside,
                fill=False,
                edgecolor=_FENCE,
                linewidth=1.6,
                zorder=4,
                label="fence",
            )
        )
    zones = shapely.union_all([zone.polygon for zone in mission.airspace.zones])
    if zones.is_empty:
        return
    buffers = shapely.union_all(mission.airspace.inflated())
    clearance = f"clearance {mission.planner.clearance_m:g} m"
    axes.add_patch(_patch(buffers, facecolor=_ZONE, alpha=0.08, zorder=2))
    axes.add_patch(
        _patch(
            buffers,
            fill=False,
            edgecolor=_ZONE,
            linewidth=0.8,
            linestyle=(0, (3, 2)),
            zorder=3,
            label=clearance,
        )
    )
    axes.add_patch(
        _patch(
            zones,
            facecolor="#eeb4ae",
            edgecolor=_ZONE,
            linewidth=1.0,
            hatch="////",
            hatchcolor="#dd8f8a",
            zorder=3,
            label="no-fly zone",
        )
    )


def _name_zones(axes: Axes, mission: Mission) -> None:
    for zone in mission.zones:
        middle = _roomiest(zone.polygon)
        axes.text(
            middle.east_m,
            middle.north_m,
            zone.name,
            ha="center",
            va="center",
            fontsize=6.5,
            color="#8d2124",
            zorder=3.5,
            path_effects=[patheffects.withStroke(linewidth=2.5, foreground="#eeb4ae")],
        )


def _roomiest(polygon: Polygon) -> Point:
    """Where a line of text fits best: on a long chord from west to east, near the middle."""
    west, south, east, north = polygon.bounds
    chords = []
    for step in range(1, 16):
        level = south + (north - south) * step / 16
        line = LineString([(west, level), (east, level)]).intersection(polygon)
        for chord in shapely.get_parts(line):
            off_middle = abs(level - (south + north) / 2)
            chords.append((chord.length - off_middle, chord.centroid.x, level))
    _, east_m, north_m = max(chords)
    return Point(east_m, north_m)


def _draw_graph(axes: Axes, graph: WaypointGraph) -> None:
    lines = [[graph.position(a), *graph.via(a, b), graph.position(b)] for a, b in graph.graph.edges]
    axes.add_collection(
        LineCollection(
            lines, colors=_EDGE, linewidths=0.6, zorder=2.5, label=f"{len(lines)} clear connections"
        )
    )


def _draw_track(axes: Axes, track: Sequence[Point]) -> None:
    east, north = zip(*track, strict=True)
    axes.plot(east, north, color="white", linewidth=3.2, zorder=5, solid_capstyle="round")
    axes.plot(
        east, north, color=_TRACK, linewidth=1.6, zorder=5.1, label="flown", solid_capstyle="round"
    )


def _draw_route(axes: Axes, start: Point, route: Route) -> None:
    points = [start, *(leg.to for leg in route.legs)]
    east, north = zip(*points, strict=True)
    axes.plot(east, north, color="white", linewidth=5, zorder=6, solid_joinstyle="round")
    axes.plot(
        east,
        north,
        color=_ROUTE,
        linewidth=2.6,
        zorder=6.1,
        solid_joinstyle="round",
        label=f"route, {route.length_m:.0f} m",
    )
    for before, after in pairwise(points):
        middle = ((before[0] + after[0]) / 2, (before[1] + after[1]) / 2)
        ahead = (
            middle[0] + 0.01 * (after[0] - before[0]),
            middle[1] + 0.01 * (after[1] - before[1]),
        )
        if math.dist(before, after) > 1:
            axes.annotate(
                "",
                xy=ahead,
                xytext=middle,
                arrowprops={"arrowstyle": "-|>", "color": _ROUTE, "mutation_scale": 13},
                zorder=6.2,
            )
    for point in (points[0], points[-1]):
        axes.scatter(*point, s=60, color=_ROUTE, edgecolor="white", linewidth=1.2, zorder=6.9)


def _draw_places(axes: Axes, mission: Mission, graph: WaypointGraph | None) -> None:
    east, north = zip(*(w.position for w in mission.waypoints), strict=True)
    axes.scatter(
        east, north, s=15, color="white", edgecolor=INK, linewidth=0.9, zorder=7, label="waypoint"
    )
    if mission.rally_points:
        east, north = zip(*mission.rally_points, strict=True)
        axes.scatter(
            east,
            north,
            marker="D",
            s=17,
            color="#f0a92e",
            edgecolor=INK,
            linewidth=0.6,
            zorder=6.9,
            label="rally point",
        )
    axes.scatter(
        *mission.home,
        marker="^",
        s=85,
        color=INK,
        edgecolor="white",
        linewidth=1,
        zorder=8,
        label="home",
    )
    for waypoint in mission.waypoints:
        angle = _quiet_direction(waypoint.number, graph)
        axes.annotate(
            str(waypoint.number),
            waypoint.position,
            xytext=(7.5 * math.cos(angle), 6.5 * math.sin(angle)),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=6.5,
            color=INK,
            zorder=9,
            path_effects=[patheffects.withStroke(linewidth=2.2, foreground="white", alpha=0.9)],
        )


def _quiet_direction(node: int, graph: WaypointGraph | None) -> float:
    """The middle of the widest angle between a node's edges, where its number disturbs least."""
    if graph is None or graph.graph.degree(node) == 0:
        return math.pi / 4
    here = graph.position(node)
    bearings = sorted(
        math.atan2(there.north_m - here.north_m, there.east_m - here.east_m)
        for there in (graph.position(other) for other in graph.graph.neighbors(node))
    )
    gaps = [
        (after - before, before)
        for before, after in pairwise([*bearings, bearings[0] + 2 * math.pi])
    ]
    width, begin = max(gaps)
    return begin + width / 2


def _patch(shape: BaseGeometry, **style: Any) -> PathPatch:
    """A polygon, or several, with holes."""
    rings = [ring for p in polygons_of(shape) for ring in (p.exterior, *p.interiors)]
    outline = Outline.make_compound_path(
        *(Outline(shapely.get_coordinates(ring), closed=True) for ring in rings)
    )
    return PathPatch(outline, **({"edgecolor": "none"} | style))
