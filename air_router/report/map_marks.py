"""How things on a mission's picture look, and where their names are put."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import shapely
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from shapely import LineString, Polygon
from shapely import Point as ShapelyPoint
from shapely.geometry.base import BaseGeometry

from air_router.report.palette import colours
from air_router.routing.graph import WaypointGraph
from geo.airspace.zone import Circle, Shape, polygons_of
from geo.frame import Point

_NAMES = ("fence", "zone", "graph", "route", "leg", "wrong", "around", "good")
FENCE, ZONE, EDGE, ROUTE, TRACK, WRONG, ROBOT, HOME = (colours()[name] for name in _NAMES)
RALLY = AROUND = ROBOT
IDLE = "#9aa1a8"
ZONE_FILL, ZONE_HATCH, ZONE_NAME = "#dfc9bd", "#c9a690", "#6b3d27"
"""Those of zones on white paper: paler and darker."""


def draw_shape(axes: Axes, shape: BaseGeometry, **style: Any) -> None:
    """A polygon, or several, with holes."""
    rings = [ring for p in polygons_of(shape) for ring in (p.exterior, *p.interiors)]
    outline = Path.make_compound_path(
        *(Path(shapely.get_coordinates(ring), closed=True) for ring in rings)
    )
    axes.add_patch(PathPatch(outline, **({"edgecolor": "none"} | style)))


def draw_lines(
    axes: Axes, lines: Sequence[Sequence[Point]], colour: str, width: float, **style: Any
) -> None:
    """Lines of one colour."""
    axes.add_collection(LineCollection(lines, colors=colour, linewidths=width, **style))


def drawn(shape: Shape) -> BaseGeometry:
    """A shape as it looks: circles round."""
    if isinstance(shape, Circle):
        return ShapelyPoint(shape.centre).buffer(shape.radius_m, quad_segs=48)
    return shape.polygon


def write_name(  # noqa: PLR0913 - what, where, how
    axes: Axes,
    text: str,
    place: Point,
    colours: tuple[str, str],
    *,
    below: bool = False,
    zorder: float = 3.5,
) -> None:
    """A name in a colour and one around it, at a place or below what is there."""
    ink, halo = colours
    axes.annotate(
        text,
        place,
        xytext=(0, -10 if below else 0),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=6.5,
        color=ink,
        zorder=zorder,
        annotation_clip=True,
        path_effects=[patheffects.withStroke(linewidth=2.5, foreground=halo)],
    )


def write_number(axes: Axes, text: str, place: Point, angle: float, *, wrong: bool = False) -> None:
    """The number of a waypoint, beside it."""
    axes.annotate(
        text,
        place,
        xytext=(7.5 * math.cos(angle), 6.5 * math.sin(angle)),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=8 if wrong else 6.5,
        fontweight="bold" if wrong else "normal",
        color=WRONG if wrong else "#30363d",
        zorder=9.5 if wrong else 9,
        path_effects=[patheffects.withStroke(linewidth=2.2, foreground="white", alpha=0.9)],
    )


def roomiest(polygon: Polygon) -> Point:
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


def quiet_direction(node: int, graph: WaypointGraph | None) -> float:
    """The middle of the widest angle between a node's edges, where its number disturbs least."""
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
