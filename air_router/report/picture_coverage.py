"""Pictures of a coverage: the area, what is seen of it, and the rows. Needs matplotlib."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import shapely

from air_router.coverage.cover_area import Field
from air_router.report.picture import draw_home, draw_zones, save
from geo.coverage.coverage import Coverage
from geo.frame import Point
from mocha_link.sanitize import sanitize

from air_router.report.map_marks import (  # isort: skip - picture says what is missing
    AROUND,
    FENCE,
    ROUTE,
    TRACK,
    WRONG,
    draw_lines,
    draw_shape,
    drawn,
)
from air_router.report.map_sheet import GROUND, INK, label_sheet, sheet_of  # isort: skip


def draw_coverage(field: Field, plan: Coverage, path: Path, told: str) -> None:
    """Draw a coverage into a file; its name's ending (.png, .svg, .pdf) chooses the format.

    Raises:
        PictureError: the file cannot be written, or its ending is not a picture's.
    """
    corners = [Point(*corner) for corner in shapely.get_coordinates(field.area).tolist()]
    home = [] if field.home is None else [field.home]
    figure, axes = sheet_of([*corners, *plan.track, *home], ground=GROUND)
    for number, fence in enumerate(field.airspace.fences):
        style = {"fill": False, "edgecolor": FENCE, "linewidth": 1.4, "zorder": 4}
        draw_shape(axes, drawn(fence), label="_" if number else "fence", **style)
    border: dict[str, Any] = {"fill": False, "edgecolor": INK, "linewidth": 1.2}
    draw_shape(axes, field.area, zorder=4, label="area", **border)
    draw_shape(axes, plan.seen, facecolor="#cfe3f7", zorder=1.2, label="covered")
    missed = [part for missed in plan.missed for part in missed.parts]
    if missed:
        union = shapely.union_all(missed)
        draw_shape(axes, union, facecolor=WRONG, zorder=2.9, label="not covered")
    draw_zones(axes, field.airspace.zones, field.airspace.inflated(), "distance kept")
    rows = [(row.start, row.end) for row in plan.rows]
    draw_lines(axes, _lines([plan.track]), "white", 2.6, zorder=5)
    for lines, width, colour, label in (
        ([plan.way_out, plan.way_back], 1.0, TRACK, "from home and back"),
        ([plan.track], 1.0, AROUND, "on to the next row"),
        (rows, 1.6, ROUTE, f"{len(rows)} rows"),
    ):
        shown = _lines(lines)
        if shown:
            draw_lines(axes, shown, colour, width, zorder=5.2, label=label)
    if field.home is not None:
        draw_home(axes, field.home)
    first = plan.rows[0].start
    axes.scatter(*first, s=36, color=ROUTE, edgecolor="white", zorder=7, label="first row")
    label_sheet(figure, axes, sanitize(field.draft.name), told)
    save(figure, path)


def _lines(lines: Sequence[Sequence[Point]]) -> list[Sequence[Point]]:
    return [line for line in lines if len(line) > 1]
