"""The sheet that a map is drawn on: axes in metres, marks, title, legend, scale and north.

Needs matplotlib.
"""

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import shapely
from shapely import LineString, Polygon
from shapely import Point as ShapelyPoint
from shapely.geometry.base import BaseGeometry

from air_router.errors import PictureError
from air_router.files import write_whole
from air_router.report.svg import Labels, colours
from geo.airspace import Circle, Shape, polygons_of
from geo.frame import Point
from mocha_link.errors import needs_extra

with needs_extra("a picture", "plot", "air-router"):
    from matplotlib import patheffects
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline
    from matplotlib.transforms import blended_transform_factory

_NAMES: Final = ("fence", "zone", "graph", "route", "leg", "wrong", "around", "good")
_WIDTH_INCH: Final = 8.0
_FLATTEST, _TALLEST = 0.4, 1.8  # of a sheet: height by width
_DPI: Final = 130
_SMALL, _LETTER = 6.5, 0.6  # of words: their size in points, a letter's width by it


class Ink:
    """The colours of a sheet; what pages draw too has that of the light ones."""

    FENCE, ZONE, EDGE, ROUTE, TRACK, WRONG, ROBOT, HOME = (colours()[name] for name in _NAMES)
    RALLY = AROUND = ROBOT
    IDLE = "#9aa1a8"
    ZONE_FILL, ZONE_HATCH, ZONE_NAME = "#dfc9bd", "#c9a690", "#6b3d27"  # on white paper
    GROUND, BEYOND, TEXT, FAINT = "#fbfaf6", "#e9e6de", "#30363d", "#8b929a"


class MapSheet:
    """A picture in the proportions of what it shows, with quiet axes in metres.

    Of several things with one label the legend names one. What is drawn with a higher `zorder`
    covers what has a lower one.

    Args:
        points: There is room for all of them.
        ground: The colour below everything.

    Attributes:
        axes: Matplotlib's; east and north in metres.
    """

    def __init__(self, points: Sequence[Point], ground: str) -> None:
        west, south, east, north = (float(v) for v in shapely.MultiPoint(points).bounds)
        pad_m = 0.04 * max(east - west, north - south, 50.0)
        west, south, east, north = west - pad_m, south - pad_m, east + pad_m, north + pad_m
        missing_m = max(_FLATTEST * (east - west) - (north - south), 0.0)
        south, north = south - missing_m / 2, north + missing_m / 2
        missing_m = max((north - south) / _TALLEST - (east - west), 0.0)
        west, east = west - missing_m / 2, east + missing_m / 2
        self._height_inch = _WIDTH_INCH * (north - south) / (east - west)
        self._figure = Figure(figsize=(_WIDTH_INCH, self._height_inch))
        self._labels: set[str] = set()  # in the legend
        self._words = Labels()  # on the map, in points
        self._points_per_m = 72 * _WIDTH_INCH / (east - west)
        self.axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set(xlim=(west, east), ylim=(south, north), aspect="equal", facecolor=ground)
        self.axes.tick_params(colors=Ink.FAINT, labelsize=7, length=2.5, width=0.5, pad=2)
        self.axes.set_xlabel("metres east", color=Ink.FAINT, fontsize=7, labelpad=2)
        self.axes.set_ylabel("metres north", color=Ink.FAINT, fontsize=7, labelpad=1)
        for spine in self.axes.spines.values():
            spine.set(color=Ink.FAINT, linewidth=0.5)

    def shape(self, shape: BaseGeometry, label: str = "_", **style: Any) -> None:
        """A polygon, or several, with holes; without borders unless the style has them."""
        rings = [ring for p in polygons_of(shape) for ring in (p.exterior, *p.interiors)]
        outline = Outline.make_compound_path(
            *(Outline(shapely.get_coordinates(ring), closed=True) for ring in rings)
        )
        self.axes.add_patch(
            PathPatch(outline, label=self._once(label), **({"edgecolor": "none"} | style))
        )

    def lines(
        self,
        lines: Sequence[Sequence[Point]],
        colour: str,
        width: float,
        label: str = "_",
        **style: Any,
    ) -> None:
        """Lines of one colour."""
        drawn = LineCollection(
            lines, colors=colour, linewidths=width, label=self._once(label), **style
        )
        self.axes.add_collection(drawn)

    def way(self, points: Sequence[Point], colour: str, width: float, label: str, z: float) -> None:
        """A line along points, in white where it lies over others."""
        east, north = zip(*points, strict=True)
        round_ends: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}
        self.axes.plot(east, north, color="white", linewidth=2 * width, zorder=z, **round_ends)
        self.axes.plot(
            east, north, color=colour, linewidth=width, zorder=z + 0.1, label=label, **round_ends
        )

    def marks(
        self,
        places: Sequence[Point],
        marker: str,
        size: float,
        colour: str,
        label: str = "_",
        **style: Any,
    ) -> None:
        """Marks of one kind at places; nothing without any."""
        if places:
            look: dict[str, Any] = {"edgecolor": "white", "linewidth": 1, "zorder": 7} | style
            east, north = zip(*places, strict=True)
            self.axes.scatter(
                east, north, s=size, marker=marker, color=colour, label=self._once(label), **look
            )
            for place in places:  # words may touch it
                self._words.mark(*self._in_points(place), math.sqrt(size) / 3)

    def home(self, home: Point) -> None:
        """Where the vehicle takes off and lands."""
        self.marks([home], "^", 85, Ink.HOME, "home", zorder=8)

    def name(
        self, text: str, place: Point, colours: tuple[str, str], *, below: bool = False, z: float
    ) -> None:
        """A name in a colour and one around it, at a place, or below or beside what is there.

        Not once more where it would cover itself.
        """
        aside = 6 + _LETTER * _SMALL * len(text) / 2
        offs = [(0, -10), (0, 10), (aside, 0), (-aside, 0)] if below else [(0, 0)]
        self._write(text, place, offs, *colours, zorder=z)

    def number(self, text: str, place: Point, angle: float, *, wrong: bool = False) -> None:
        """The number of a waypoint, beside it; in this direction, if nothing is there."""
        turns = (math.radians(turn) for turn in (0, 45, -45, 90, -90, 135, -135, 180))
        offs = [(7.5 * math.cos(angle + turn), 6.5 * math.sin(angle + turn)) for turn in turns]
        look = {"fontsize": 8, "fontweight": "bold", "zorder": 9.5} if wrong else {"zorder": 9}
        self._write(text, place, offs, Ink.WRONG if wrong else Ink.TEXT, "white", **look)

    def save(self, path: Path, title: str, subtitle: str, warning: str = "") -> None:
        """Write what the picture shows around it, and the whole into a file.

        Args:
            path: Its ending (.png, .svg, .pdf) chooses the format.
            title: Stands above the map.
            subtitle: Stands below the title.
            warning: Stands in red above the title.

        Raises:
            PictureError: the file cannot be written, or its ending is not a picture's.
        """
        for text, rise, size, weight, colour in (
            (warning, 36, 9.5, "bold", "#e00010"),
            (title, 18, 13, "bold", Ink.TEXT),
            (subtitle, 6, 8.5, "normal", Ink.FAINT),
        ):
            self.axes.annotate(
                text,
                xy=(0, 1),
                xytext=(0, rise),
                xycoords="axes fraction",
                textcoords="offset points",
                fontsize=size,
                fontweight=weight,
                color=colour,
            )
        self.axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, -0.36 / self._height_inch),
            ncols=4,
            frameon=False,
            fontsize=8,
            labelcolor=Ink.TEXT,
            handlelength=1.6,
            columnspacing=1.8,
        )
        self._draw_scale()
        look: dict[str, Any] = {"bbox_inches": "tight", "pad_inches": 0.12, "dpi": _DPI}
        try:
            picture = io.BytesIO()
            suffix = path.suffix.removeprefix(".") or None
            self._figure.savefig(picture, format=suffix, facecolor="white", **look)
            write_whole(path, picture.getvalue(), replace=True)
        except (OSError, ValueError) as error:
            raise PictureError(f"cannot write the picture {path}: {error}") from None

    def _once(self, label: str) -> str:
        """A label, unless the legend has it already."""
        known, self._labels = label in self._labels, self._labels | {label}
        return "_" if known else label

    def _in_points(self, place: Point) -> tuple[float, float]:
        return place[0] * self._points_per_m, place[1] * self._points_per_m

    def _write(
        self,
        text: str,
        place: Point,
        offs: Sequence[tuple[float, float]],
        ink: str,
        halo: str,
        **style: Any,
    ) -> None:
        """Words at so many points off a place, where they cover least."""
        look: dict[str, Any] = {"fontsize": _SMALL, "ha": "center", "va": "center"} | style
        size = _LETTER * look["fontsize"] * len(text), look["fontsize"]
        off = self._words.place(text, self._in_points(place), size, offs)
        if off is None:
            return
        self.axes.annotate(
            text,
            place,
            xytext=off,
            textcoords="offset points",
            color=ink,
            annotation_clip=True,
            path_effects=[patheffects.withStroke(linewidth=2.4, foreground=halo)],
            **look,
        )

    def _draw_scale(self) -> None:
        """A scale bar and an arrow to the north, above the upper right corner."""
        west, east = self.axes.get_xlim()
        width_m = east - west
        power = 10 ** math.floor(math.log10(width_m / 5))
        bar_m = max(step * power for step in (1, 2, 5) if step * power <= width_m / 5)
        place = blended_transform_factory(self.axes.transData, self.axes.transAxes)
        low, high, foot, top = (1 + pt / 72 / self._height_inch for pt in (8, 12, 5, 30))
        corners = ((east - bar_m, high), (east - bar_m, low), (east, low), (east, high))
        bar = Line2D(*zip(*corners, strict=True), transform=place, color=Ink.TEXT, linewidth=1.0)
        bar.set_clip_on(False)
        self.axes.add_line(bar)
        look: dict[str, Any] = {"ha": "center", "color": Ink.TEXT}
        middle_m, arrow_m = east - bar_m / 2, east - bar_m - 0.03 * width_m
        self.axes.text(middle_m, high, f"{bar_m:g} m", transform=place, fontsize=7.5, **look)
        self.axes.annotate(
            "N",
            xy=(arrow_m, top),
            xytext=(arrow_m, foot),
            xycoords=place,
            textcoords=place,
            fontsize=8,
            arrowprops={"arrowstyle": "-|>", "color": Ink.TEXT, "linewidth": 1.1},
            annotation_clip=False,
            **look,
        )


def drawn(shape: Shape) -> BaseGeometry:
    """A shape as it looks: circles round."""
    if isinstance(shape, Circle):
        return ShapelyPoint(shape.centre).buffer(shape.radius_m, quad_segs=48)
    return shape.polygon


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
