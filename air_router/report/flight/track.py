"""The flown track over the mission, seen from above, as SVG in metres."""

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Final

from air_router.report.flight.charts import Figure, robot_css
from air_router.report.flight.flight_summary import FlightSummary
from air_router.report.flight.svg import NARROW, WIDE, clock, picture
from air_router.report.flight.ulog import UlogTrack
from geo.airspace.airspace import FENCE
from geo.airspace.zone import Circle, Shape
from geo.frame import Point

_MARGIN_M: Final = 25.0
_DOT_PX: Final = 4.0
_MOST_DOTS: Final = 250
"""So near to each other, and so many, are the places of one robot that are drawn."""

_SCALES_M: Final = (10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


class _Canvas:
    """Metres east and north onto a picture."""

    def __init__(self, places: Sequence[tuple[float, float]], width: int) -> None:
        self._west_m = min(p[0] for p in places) - _MARGIN_M  # the left edge
        self._north_m = max(p[1] for p in places) + _MARGIN_M  # the upper edge
        span_m = max(p[0] for p in places) + _MARGIN_M - self._west_m
        tall_m = self._north_m - min(p[1] for p in places) + _MARGIN_M
        # pixels per metre
        self.scale = min(width / span_m, (0.72 if width > NARROW else 1.3) * width / tall_m)
        self.width, self.height = width, tall_m * self.scale  # pixels
        self._left = (width - span_m * self.scale) / 2  # pixels of margin

    def at(self, place: Sequence[float]) -> tuple[float, float]:
        """Where a place (east, north) is drawn."""
        x = self._left + (place[0] - self._west_m) * self.scale
        return x, (self._north_m - place[1]) * self.scale

    def path(self, places: Iterable[Sequence[float]], close: str = "") -> str:
        """A line through places."""
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in map(self.at, places)) + close


def track_figure(summary: FlightSummary, ulog: UlogTrack | None = None) -> Figure | None:
    """Zones, fence, waypoints, the track and where it came closest; None without a mission."""
    if summary.mission is None:
        return None
    corners = _corners(summary, ulog)
    pictures = "".join(_draw(summary, ulog, _Canvas(corners, width)) for width in (WIDE, NARROW))
    legend = [("own", "flown track"), ("zonekey", "no-fly zone"), ("fencekey", "fence")]
    if ulog is not None:
        legend.append(("theirs", "PX4's own log"))
    legend += [
        (robot_css(summary, n), n) for n in summary.exchanges.names() if summary.robots.get(n)
    ]
    words = ""
    if summary.closest is not None:
        words = (
            f"Closest approach: {summary.closest[0]:.2f} m to {_named(summary.closest[1])} "
            f"(demanded: {summary.mission.planner.clearance_m:g} m). "
        )
    words += "Robots are drawn at their reported positions."
    return Figure("track", "Track", words, pictures, legend)


def _named(what: str) -> str:
    return "the fence" if what == FENCE else what


def _corners(summary: FlightSummary, ulog: UlogTrack | None) -> list[tuple[float, float]]:
    mission = summary.mission
    assert mission is not None  # noqa: S101 - the caller has looked
    places: list[tuple[float, float]] = [mission.home, *(w.position for w in mission.waypoints)]
    places += [corner for fence in mission.fences for corner in fence.corners]
    places += [(east_m, north_m) for _, east_m, north_m, _ in summary.track]
    places += [(e, n) for heard in summary.robots.values() for _, e, n, _ in heard]
    places += [] if ulog is None else [(e, n) for _, e, n in ulog.track]
    return places


def _draw(summary: FlightSummary, ulog: UlogTrack | None, canvas: _Canvas) -> str:
    mission = summary.mission
    assert mission is not None  # noqa: S101 - the caller has looked
    parts = [_area(canvas, fence, "fence", "fence") for fence in mission.fences]
    active = {id(zone) for zone in mission.airspace.zones}
    for zone in mission.zones:
        css = "zone" if id(zone) in active or zone in mission.airspace.zones else "zone idle"
        parts.append(_area(canvas, zone.shape, css, zone.name))
    for waypoint in mission.waypoints:
        x, y = canvas.at(waypoint.position)
        parts.append(_circle("waypoint", x, y, "2.5", f"waypoint {waypoint.number}"))
    dots, names = _robots(summary, canvas)
    parts += dots
    parts.append(_line(canvas, [(e, n) for _, e, n, _ in summary.track], "own"))
    if ulog is not None:
        parts.append(_line(canvas, [(e, n) for _, e, n in ulog.track], "theirs"))
    parts += names
    x, y = canvas.at(mission.home)
    parts.append(f'<path class="home" d="M{x - 6:.1f} {y:.1f}h12M{x:.1f} {y - 6:.1f}v12"/>')
    parts.append(f'<text x="{x + 8:.1f}" y="{y - 6:.1f}">home</text>')
    if summary.closest_at is not None:
        away_m, *place = summary.closest_at
        x, y = canvas.at(place)
        parts.append(_circle("closest", x, y, "8", f"closest approach, about {away_m:.1f} m"))
    parts.append(_scale(canvas))
    return picture(canvas.width, round(canvas.height), "the flown track", parts)


def _robots(summary: FlightSummary, canvas: _Canvas) -> tuple[list[str], list[str]]:
    """Where robots were, for below the track, and their names, for above it."""
    dots, names = [], []
    for name, heard in sorted(summary.robots.items()):
        if name not in summary.exchanges.names():
            continue
        css = robot_css(summary, name)
        spots: dict[tuple[int, int], tuple[float, float, float]] = {}
        for t, east_m, north_m, _ in heard:
            x, y = canvas.at((east_m, north_m))
            spots.setdefault((int(x / _DOT_PX), int(y / _DOT_PX)), (t, x, y))
        step = -(-len(spots) // _MOST_DOTS)
        for t, dot_x, dot_y in list(spots.values())[::step]:
            title = f"{name}, heard at {clock(t - summary.from_s)}"
            dots.append(_circle(f"robot {css}", dot_x, dot_y, "3", title))
        names.append(f'<text class="name" x="{x + 6:.1f}" y="{y + 4:.1f}">{escape(name)}</text>')
    return dots, names


def _area(canvas: _Canvas, shape: Shape, css: str, name: str) -> str:
    if isinstance(shape, Circle):
        x, y = canvas.at(shape.centre)
        return _circle(css, x, y, f"{shape.radius_m * canvas.scale:.1f}", name)
    rings: list[Sequence[Point]] = [shape.ring, *shape.holes]
    path = "".join(canvas.path(ring, "Z") for ring in rings)
    title = f"<title>{escape(name)}</title>"
    return f'<path class="{css}" fill-rule="evenodd" d="{path}">{title}</path>'


def _circle(css: str, x: float, y: float, radius: str, title: str) -> str:
    at = f'cx="{x:.1f}" cy="{y:.1f}" r="{radius}"'
    return f'<circle class="{css}" {at}><title>{escape(title)}</title></circle>'


def _line(canvas: _Canvas, places: Sequence[tuple[float, float]], css: str) -> str:
    """A line without points that would lie on the same pixel."""
    kept: list[tuple[float, float]] = []
    for place in places:
        if not kept or math.dist(kept[-1], place) * canvas.scale >= 1:
            kept.append(place)
    return f'<path class="line {css}" d="{canvas.path(kept)}"/>' if len(kept) > 1 else ""


def _scale(canvas: _Canvas) -> str:
    """How long some metres are."""
    length_m = max(
        (m for m in _SCALES_M if m * canvas.scale <= canvas.width / 4), default=_SCALES_M[0]
    )
    x, y = 12, canvas.height - 12
    return (
        f'<path class="scale" d="M{x} {y - 5:.1f}v5h{length_m * canvas.scale:.1f}v-5"/>'
        f'<text x="{x + 6}" y="{y - 6:.1f}">{length_m} m</text>'
    )
