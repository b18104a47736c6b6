"""The flown track on the mission's map, for wide pages and phones."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from air_router.mission import far
from air_router.report.charts import Figure, in_both_widths, robot_colour
from air_router.report.figure_style import Ink, colours, figure_style
from air_router.report.flight_history import FlightHistory, RobotFix
from air_router.report.flight_table import clock
from air_router.report.map_sheet import MapSheet
from air_router.report.picture import draw_airspace
from geo.airspace import FENCE
from geo.frame import Point

_SIZES: Final = {"wide": (6.6, 0.8), "narrow": (2.8, 1.4)}
"""Width of a map in inches, and its largest ratio of height to width: pages show it about 1.8 times
as large, phones 1.5 times."""

_DOTS: Final = 90
"""Number of distinct places of one robot across the map; only the first at each place is drawn."""


def track_figure(history: FlightHistory) -> Figure:
    """The figure with zones, fence, waypoints, track, robots, and the closest approach."""
    mission = history.mission
    track = [Point(at.east_m, at.north_m) for at in history.track]
    reports = {name: fixes for name, fixes in history.robots.items() if name in history.links.names}
    places = [mission.home, *(w.position for w in mission.waypoints), *track]
    shapes = mission.fences or [zone.shape for zone in mission.zones]
    places += [corner for shape in shapes for corner in shape.corners]
    places += [Point(fix.east_m, fix.north_m) for fixes in reports.values() for fix in fixes]
    near = [place for place in places if not far(place, mission)]

    def draw(kind: str) -> str:
        with figure_style(f"track-{kind}"):
            width_inch, tallest = _SIZES[kind]
            ground = Ink.BEYOND if mission.fences else Ink.GROUND
            sheet = MapSheet(near, ground, width_inch=width_inch, tallest=tallest)
            draw_airspace(sheet, mission)
            _waypoints(sheet, history)
            _robots(sheet, history, reports)
            if len(track) > 1:
                sheet.way(track, Ink.TRACK, 1.2, "flown track", 5)
            sheet.home(mission.home)
            _closest(sheet, history)
            for name, fixes in reports.items():
                colour = colours()[robot_colour(history, name)]
                last = Point(fixes[-1].east_m, fixes[-1].north_m)
                sheet.name(name, last, (colour, Ink.HALO), below=True, z=9.5)
            return sheet.svg(kind, "the flown track")

    caption = "Robots are drawn at the positions they reported." if reports else ""
    if history.closest is not None:
        closest_m, what = history.closest
        caption = (
            f"Closest approach: {closest_m:.2f} m to {'the fence' if what == FENCE else what} "
            f"(required: {mission.planner.clearance_m:g} m). {caption}"
        ).strip()
    return Figure("track", "Track", caption, in_both_widths(draw))


def _waypoints(sheet: MapSheet, history: FlightHistory) -> None:
    seen = [w for w in history.mission.waypoints if not far(w.position, history.mission)]
    tooltips = [f"waypoint {waypoint.number}" for waypoint in seen]
    style = {"edgecolor": Ink.TEXT, "linewidth": 0.6}
    places = [waypoint.position for waypoint in seen]
    sheet.marks(places, "o", 6, Ink.HALO, "waypoint", tooltips=tooltips, **style)


def _robots(
    sheet: MapSheet, history: FlightHistory, reports: dict[str, tuple[RobotFix, ...]]
) -> None:
    """Draw the reported positions of robots, once per distinguishable place."""
    west, east = sheet.axes.get_xlim()
    for name, fixes in sorted(reports.items()):
        spots = np.array([(fix.east_m, fix.north_m) for fix in fixes]) // ((east - west) / _DOTS)
        _, first = np.unique(spots, axis=0, return_index=True)
        kept: Sequence[RobotFix] = [fixes[i] for i in sorted(first.tolist())]
        places = [Point(fix.east_m, fix.north_m) for fix in kept]
        colour = colours()[robot_colour(history, name)]
        tooltips = [f"{name}, reported at {clock(fix.t - history.from_s)}" for fix in kept]
        sheet.marks(places, "o", 9, colour, name, linewidth=0, zorder=5.5, tooltips=tooltips)


def _closest(sheet: MapSheet, history: FlightHistory) -> None:
    if history.closest_at is None:
        return
    away_m, *place = history.closest_at
    ring = {"facecolor": "none", "edgecolor": Ink.WRONG, "linewidth": 1.4, "zorder": 9}
    tooltip = f"closest approach, about {away_m:.1f} m"
    sheet.marks([Point(*place)], "o", 55, Ink.WRONG, "closest approach", tooltips=[tooltip], **ring)
