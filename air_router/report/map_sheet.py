"""The sheet that a mission is drawn on: axes in metres, title, legend, scale and north."""

import math
from collections.abc import Sequence

import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import blended_transform_factory

from air_router.mission.faults import far
from air_router.mission.mission import Mission
from geo.frame import Point

GROUND, BEYOND, INK, FAINT = "#fbfaf6", "#e9e6de", "#30363d", "#8b929a"
WIDTH_INCH = 8.0
_FLATTEST, _TALLEST = 0.4, 1.8


def new_sheet(mission: Mission, more: Sequence[Point]) -> tuple[Figure, Axes]:
    """A figure in the proportions of what it shows, with quiet axes in metres.

    Args:
        mission: its places and fences (without these, its zones) are on the sheet, as far as they
            are not impossibly far from home.
        more: what else is.
    """
    points = [mission.home, *(w.position for w in mission.waypoints), *more, *mission.rally_points]
    shapes = mission.fences or [zone.shape for zone in mission.zones]
    points += [corner for shape in shapes for corner in shape.corners]
    points = [point for point in points if not far(point, mission)]
    return sheet_of(points, ground=GROUND if not mission.fences else BEYOND)


def sheet_of(points: Sequence[Point], ground: str) -> tuple[Figure, Axes]:
    """A sheet with room for all points."""
    west, south, east, north = (float(v) for v in shapely.MultiPoint(points).bounds)
    pad_m = 0.04 * max(east - west, north - south, 50.0)
    west, south, east, north = west - pad_m, south - pad_m, east + pad_m, north + pad_m
    missing_m = _FLATTEST * (east - west) - (north - south)
    if missing_m > 0:
        south, north = south - missing_m / 2, north + missing_m / 2
    missing_m = (north - south) / _TALLEST - (east - west)
    if missing_m > 0:
        west, east = west - missing_m / 2, east + missing_m / 2
    figure = Figure(figsize=(WIDTH_INCH, WIDTH_INCH * (north - south) / (east - west)))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)
    axes.set_aspect("equal")
    axes.set_facecolor(ground)
    axes.tick_params(colors=FAINT, labelsize=7, length=2.5, width=0.5, pad=2)
    axes.set_xlabel("metres east", color=FAINT, fontsize=7, labelpad=2)
    axes.set_ylabel("metres north", color=FAINT, fontsize=7, labelpad=1)
    for spine in axes.spines.values():
        spine.set(color=FAINT, linewidth=0.5)
    return figure, axes


def label_sheet(figure: Figure, axes: Axes, title: str, subtitle: str, warning: str = "") -> None:
    """Write what the picture shows around it; a warning stands in red above the title."""
    for text, rise, size, weight, colour in (
        (warning, 36, 9.5, "bold", "#e00010"),
        (title, 18, 13, "bold", INK),
        (subtitle, 6, 8.5, "normal", FAINT),
    ):
        axes.annotate(
            text,
            xy=(0, 1),
            xytext=(0, rise),
            xycoords="axes fraction",
            textcoords="offset points",
            fontsize=size,
            fontweight=weight,
            color=colour,
        )
    height_inch = float(figure.get_size_inches()[1])
    axes.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.36 / height_inch),
        ncols=4,
        frameon=False,
        fontsize=8,
        labelcolor=INK,
        handlelength=1.6,
        columnspacing=1.8,
    )
    _draw_scale(axes, height_inch)


def _draw_scale(axes: Axes, height_inch: float) -> None:
    """A scale bar and an arrow to the north, above the upper right corner."""
    west, east = axes.get_xlim()
    width_m = east - west
    power = 10 ** math.floor(math.log10(width_m / 5))
    bar_m = max(step * power for step in (1, 2, 5) if step * power <= width_m / 5)
    place = blended_transform_factory(axes.transData, axes.transAxes)
    high, low = (1 + points / 72 / height_inch for points in (12, 8))
    corners = ((east - bar_m, high), (east - bar_m, low), (east, low), (east, high))
    bar = Line2D(*zip(*corners, strict=True), transform=place, color=INK, linewidth=1.0)
    bar.set_clip_on(False)
    axes.add_line(bar)
    axes.text(
        east - bar_m / 2,
        high,
        f"{bar_m:g} m",
        transform=place,
        ha="center",
        fontsize=7.5,
        color=INK,
    )
    axes.annotate(
        "N",
        xy=(east - bar_m - 0.03 * width_m, 1 + 30 / 72 / height_inch),
        xytext=(east - bar_m - 0.03 * width_m, 1 + 5 / 72 / height_inch),
        xycoords=place,
        textcoords=place,
        ha="center",
        fontsize=8,
        color=INK,
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.1},
        annotation_clip=False,
    )
