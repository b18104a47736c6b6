"""The flown track over the mission, seen from above, as SVG in metres."""

import math
from collections.abc import Iterable, Sequence
from typing import Final

from air_router.mission import Mission
from air_router.report.charts import Figure, robot_css
from air_router.report.flight_summary import FlightSummary
from air_router.report.svg import NARROW, Labels, clock, element, in_both_widths, picture, text
from geo.airspace import FENCE, Circle, Shape

_MARGIN_M: Final = 25.0
_DOT_PX: Final = 4.0
_LETTER_PX, _LINE_PX = 7.5, 13.0  # of a name
_MOST_DOTS: Final = 250
"""So near to each other, and so many, are the places of one robot that are drawn."""

_SCALES_M: Final = (10, 20, 50, 100, 200, 500, 1000, 2000, 5000)

Places = Iterable[Sequence[float]]
"""East and north in metres."""


class _Canvas:
    """Metres east and north onto a picture."""

    def __init__(self, places: list[Sequence[float]], width: int) -> None:
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

    def path(self, places: Places, close: str = "") -> str:
        """A line through places."""
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in map(self.at, places)) + close

    def circle(self, css: str, place: Sequence[float], radius_px: float, title: str) -> str:
        """A round mark."""
        x, y = self.at(place)
        return element("circle", css, title, cx=x, cy=y, r=radius_px)

    def area(self, css: str, shape: Shape, title: str) -> str:
        """A fence or a zone."""
        if isinstance(shape, Circle):
            return self.circle(css, shape.centre, shape.radius_m * self.scale, title)
        path = "".join(self.path(ring, "Z") for ring in (shape.ring, *shape.holes))
        return element("path", css, title, fill_rule="evenodd", d=path)

    def line(self, css: str, places: Places) -> str:
        """A line without points that would lie on the same pixel."""
        kept: list[Sequence[float]] = []
        for place in places:
            if not kept or math.dist(kept[-1], place) * self.scale >= 1:
                kept.append(place)
        return element("path", f"line {css}", d=self.path(kept)) if len(kept) > 1 else ""


def track_figure(summary: FlightSummary) -> Figure:
    """Zones, fence, waypoints, the track and where it came closest."""
    mission = summary.mission
    track = [(east_m, north_m) for _, east_m, north_m, _ in summary.track]
    places: list[Sequence[float]] = [mission.home, *(w.position for w in mission.waypoints)]
    places += [corner for fence in mission.fences for corner in fence.corners]
    places += track
    places += [(e, n) for heard in summary.robots.values() for _, e, n, _ in heard]

    def draw(width: int) -> str:
        canvas = _Canvas(places, width)
        dots, names = _robots(summary, canvas)
        line = canvas.line("own", track)
        parts = [*_mission(mission, canvas), *dots, line, *names, *_marks(summary, canvas)]
        return picture(canvas.width, round(canvas.height), "the flown track", parts)

    legend = [("own", "flown track")]
    legend += [("zonekey", "no-fly zone")] if mission.zones else []
    legend += [("fencekey", "fence")] if mission.fences else []
    named = [name for name in summary.exchanges.names if summary.robots.get(name)]
    legend += [(robot_css(summary, name), name) for name in named]
    words = "Robots are drawn at their reported positions."
    if summary.closest is not None:
        closest_m, what = summary.closest
        words = (
            f"Closest approach: {closest_m:.2f} m to {'the fence' if what == FENCE else what} "
            f"(demanded: {mission.planner.clearance_m:g} m). {words}"
        )
    return Figure("track", "Track", words, in_both_widths(draw), legend)


def _mission(mission: Mission, canvas: _Canvas) -> list[str]:
    parts = [canvas.area("fence", fence, "fence") for fence in mission.fences]
    for zone in mission.zones:
        css = "zone" if zone in mission.airspace.zones else "zone idle"
        parts.append(canvas.area(css, zone.shape, zone.name))
    for waypoint in mission.waypoints:
        title = f"waypoint {waypoint.number}"
        parts.append(canvas.circle("waypoint", waypoint.position, 2.5, title))
    return parts


def _marks(summary: FlightSummary, canvas: _Canvas) -> list[str]:
    """Home, the closest approach, and how long some metres are."""
    x, y = canvas.at(summary.mission.home)
    parts = [canvas.circle("home", summary.mission.home, 6.0, "home")]
    parts.append(text(x + 8, y - 6, "home", css="name"))
    if summary.closest_at is not None:
        away_m, *place = summary.closest_at
        parts.append(
            canvas.circle("closest", place, 8.0, f"closest approach, about {away_m:.1f} m")
        )
    fitting = (m for m in _SCALES_M if m * canvas.scale <= canvas.width / 4)
    length_m, bottom = max(fitting, default=_SCALES_M[0]), canvas.height - 12
    bar = f"M12 {bottom - 5:.1f}v5h{length_m * canvas.scale:.1f}v-5"
    return [*parts, element("path", "scale", d=bar), text(18, bottom - 6, f"{length_m} m")]


def _robots(summary: FlightSummary, canvas: _Canvas) -> tuple[list[str], list[str]]:
    """Where robots were, for below the track, and their names, for above it."""
    dots, names, words = [], [], Labels()
    ends: dict[str, tuple[float, float]] = {}
    for name, heard in sorted(summary.robots.items()):
        if name not in summary.exchanges.names:
            continue
        css = f"robot {robot_css(summary, name)}"
        spots: dict[tuple[int, int], tuple[float, Sequence[float]]] = {}
        for t, *place, _ in heard:
            x, y = canvas.at(place)
            spots.setdefault((int(x / _DOT_PX), int(y / _DOT_PX)), (t, place))
        step = -(-len(spots) // _MOST_DOTS)
        for t, spot in list(spots.values())[::step]:
            title = f"{name}, heard at {clock(t - summary.from_s)}"
            dots.append(canvas.circle(css, spot, 3.0, title))
            words.mark(*canvas.at(spot), 3.0)
        ends[name] = x, y
    for name, (x, y) in ends.items():
        width = _LETTER_PX * len(name)
        aside = 6 + width / 2
        offs = [(aside, 0.0), (-aside, 0.0), (0.0, -14.0), (0.0, 14.0)]
        dx, dy = words.place(name, (x, y), (width, _LINE_PX), offs) or offs[0]
        names.append(text(x + dx, y + dy + 4, name, "middle", "name"))
    return dots, names
