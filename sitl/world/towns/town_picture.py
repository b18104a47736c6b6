"""A picture of a town: what stands where, the vehicles to be found, where robots start.

Needs matplotlib.
"""

from collections.abc import Sequence
from pathlib import Path

import shapely

from air_router.counted import counted
from geo.frame import Point
from mocha_link.errors import needs_extra
from sitl.world.towns.town import Town

with needs_extra("a picture", "plot", "air-router"):
    from air_router.report.map_sheet import INK, MapSheet

OPEN, PAVED, ROAD, CROWN = "#e3dccb", "#eef0e4", "#aab4c4", "#8fb27c"
HOUSE, HOUSE_EDGE, GOAL, START = "#fdfdfb", "#b9b4a8", "#d1495b", "#30638e"


def draw_town(town: Town, path: Path, *, waypoints: Sequence[Point] = ()) -> None:
    """Draw a town into a file; its name's ending (.png, .svg, .pdf) chooses the format.

    Args:
        town: What to draw.
        path: The file to write.
        waypoints: Of a mission over it.

    Raises:
        PictureError: the file cannot be written, or its ending is not a picture's.
    """
    bounds = town.bounds
    corners = [Point(bounds.west_m, bounds.south_m), Point(bounds.east_m, bounds.north_m)]
    sheet = MapSheet(corners, OPEN)
    roads = shapely.union_all(
        [shapely.LineString(road.points).buffer(road.width_m / 2) for road in town.roads]
    )
    buildings = shapely.union_all([shapely.Polygon(ring) for ring in town.buildings])
    yards = shapely.union_all([shapely.Polygon(ring) for ring in town.yards])
    crowns = shapely.union_all([shapely.Polygon(ring) for ring in town.vegetation])
    for shape, label, colour, edge in (
        (shapely.Polygon(town.outline), "_", PAVED, "none"),
        (crowns, "vegetation", CROWN, "none"),
        (roads, "road", ROAD, "none"),
        (buildings.difference(yards), "building", HOUSE, HOUSE_EDGE),
        (yards, "_", OPEN, "none"),
    ):
        if not shape.is_empty:
            sheet.shape(shape, label, facecolor=colour, edgecolor=edge, linewidth=0.6)
    if waypoints:
        sheet.axes.plot(
            *zip(*waypoints, strict=True), ".", color=INK, markersize=2.5, label="waypoint"
        )
    sheet.axes.plot(
        *zip(*town.starts, strict=True),
        "o",
        color=START,
        markersize=2.2,
        markeredgewidth=0,
        label="start of a ground robot",
    )
    sheet.axes.plot(*town.home, "^", color=INK, markersize=6, label="home")
    if town.goals:
        sheet.axes.plot(
            *zip(*(goal.position for goal in town.goals), strict=True),
            "s",
            color=GOAL,
            markersize=5,
            markeredgecolor="white",
            markeredgewidth=0.6,
            label="vehicle to be found",
        )
    subtitle = f"{town.area_m2:,.0f} m², {counted(len(town.goals), 'vehicles')}"
    sheet.save(path, town.name, subtitle)
