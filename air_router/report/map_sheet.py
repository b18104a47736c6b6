"""The sheet of a map: axes in meters, marks, title, legend, scale and north arrow.

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
from air_router.report.figure_style import Ink, embedded, keep_letters
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
    from matplotlib.text import Annotation
    from matplotlib.transforms import Bbox, blended_transform_factory

_WIDTH_INCH: Final = 8.0
_FLATTEST, _TALLEST = 0.4, 1.8  # of a sheet: height by width
_DPI: Final = 130
_SMALL: Final = 6.5  # points: the size of text
_TOUCH_PX: Final = 1.0  # smallest distance between texts


class MapSheet:
    """A picture with the proportions of its content, and plain axes in meters.

    The legend lists each label once. Marks with a higher `zorder` cover those with a lower one.

    Args:
        points: The sheet includes all of them.
        ground: Background color.
        width_inch: Width of the map; text keeps its size.
        tallest: Largest ratio of height to width.

    Attributes:
        axes: Matplotlib's axes; east and north in meters.
    """

    def __init__(
        self,
        points: Sequence[Point],
        ground: str,
        *,
        width_inch: float = _WIDTH_INCH,
        tallest: float = _TALLEST,
    ) -> None:
        west, south, east, north = (float(v) for v in shapely.MultiPoint(points).bounds)
        pad_m = 0.04 * max(east - west, north - south, 50.0)
        west, south, east, north = west - pad_m, south - pad_m, east + pad_m, north + pad_m
        missing_m = max(_FLATTEST * (east - west) - (north - south), 0.0)
        south, north = south - missing_m / 2, north + missing_m / 2
        missing_m = max((north - south) / tallest - (east - west), 0.0)
        west, east = west - missing_m / 2, east + missing_m / 2
        self._height_inch = width_inch * (north - south) / (east - west)
        self._figure = Figure(figsize=(width_inch, self._height_inch))
        self._labels: set[str] = set()  # in the legend
        self._taken: list[tuple[str, Bbox]] = []  # texts and their boxes; "": a mark
        self._names: list[Annotation] = []  # texts outlined in the background color
        self._columns = max(2, round(width_inch / 2))  # of the legend
        self.tooltips: dict[str, Sequence[str]] = {}  # in a page, by gid
        self.axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set(xlim=(west, east), ylim=(south, north), aspect="equal", facecolor=ground)
        self.axes.tick_params(colors=Ink.FAINT, labelsize=7, length=2.5, width=0.5, pad=2)
        self.axes.set_xlabel("metres east", color=Ink.FAINT, fontsize=7, labelpad=2)
        self.axes.set_ylabel("metres north", color=Ink.FAINT, fontsize=7, labelpad=1)
        for spine in self.axes.spines.values():
            spine.set(color=Ink.FAINT, linewidth=0.5)

    def shape(self, shape: BaseGeometry, label: str = "_", **style: Any) -> None:
        """Draw polygons with holes; without borders unless the style has them."""
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
        """Draw lines of one color."""
        drawn = LineCollection(
            lines, colors=colour, linewidths=width, label=self._once(label), **style
        )
        self.axes.add_collection(drawn)

    def way(self, points: Sequence[Point], colour: str, width: float, label: str, z: float) -> None:
        """Draw a line along points, with a white outline."""
        east, north = zip(*points, strict=True)
        round_ends: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}
        self.axes.plot(east, north, color=Ink.HALO, linewidth=2 * width, zorder=z, **round_ends)
        self.axes.plot(
            east, north, color=colour, linewidth=width, zorder=z + 0.1, label=label, **round_ends
        )

    def marks(  # noqa: PLR0913 - how marks differ
        self,
        places: Sequence[Point],
        marker: str,
        size: float,
        colour: str,
        label: str = "_",
        *,
        tooltips: Sequence[str] = (),
        **style: Any,
    ) -> None:
        """Draw marks of one kind at places.

        In a page each mark has its tooltip.
        """
        if places:
            whole: dict[str, Any] = {"edgecolor": Ink.HALO, "linewidth": 1, "zorder": 7} | style
            whole["gid"] = f"marks{len(self.tooltips)}"
            self.tooltips[whole["gid"]] = tooltips
            east, north = zip(*places, strict=True)
            self.axes.scatter(
                east, north, s=size, marker=marker, color=colour, label=self._once(label), **whole
            )
            for place in places:  # text may touch it
                x, y = self.axes.transData.transform(place)
                reach = math.sqrt(size) / 3 * self._figure.dpi / 72
                self._taken.append(
                    ("", Bbox.from_extents(x - reach, y - reach, x + reach, y + reach))
                )

    def home(self, home: Point) -> None:
        """Draw the place of take-off and landing."""
        self.marks([home], "^", 85, Ink.HOME, "home", zorder=8)

    def name(
        self, text: str, place: Point, colours: tuple[str, str], *, below: bool = False, z: float
    ) -> None:
        """Draw an outlined name at a place, or below or beside the marks there.

        Not drawn if it would overlap itself.
        """
        aside = 8 + 0.3 * _SMALL * len(text)
        offs = [(0, -10), (0, 10), (aside, 0), (-aside, 0)] if below else [(0, 0)]
        self._write(text, place, offs, *colours, zorder=z)

    def number(self, text: str, place: Point, angle: float, *, wrong: bool = False) -> None:
        """Draw the number beside a waypoint; in this direction if it is free."""
        turns = (math.radians(turn) for turn in (0, 45, -45, 90, -90, 135, -135, 180))
        offs = [(7.5 * math.cos(angle + turn), 6.5 * math.sin(angle + turn)) for turn in turns]
        style = {"fontsize": 8, "fontweight": "bold", "zorder": 9.5} if wrong else {"zorder": 9}
        self._write(text, place, offs, Ink.WRONG if wrong else Ink.TEXT, Ink.HALO, **style)

    def save(self, path: Path, title: str, subtitle: str, warning: str = "") -> None:
        """Add title, legend and scale, and write the picture to a file.

        Args:
            path: Its suffix (.png, .svg, .pdf) chooses the format.
            title: Above the map.
            subtitle: Below the title.
            warning: In red above the title.

        Raises:
            PictureError: The file cannot be written, or its suffix is not a picture's.
        """
        for text, rise, size, weight, colour in (
            (warning, 36, 9.5, "bold", Ink.WRONG),
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
        self._finish()
        keep_letters(self._figure)
        style: dict[str, Any] = {"bbox_inches": "tight", "pad_inches": 0.12, "dpi": _DPI}
        if path.suffix == ".svg":
            style["metadata"] = {"Date": None}  # the same mission, the same bytes
        try:
            picture = io.BytesIO()
            suffix = path.suffix.removeprefix(".") or None
            self._figure.savefig(picture, format=suffix, facecolor="white", **style)
            write_whole(path, picture.getvalue(), replace=True)
        except (OSError, ValueError) as error:
            raise PictureError(f"cannot write the picture {path}: {error}") from None

    def svg(self, kind: str, label: str) -> str:
        """The map as an element of an HTML page, with legend and scale; see `embedded`."""
        self._finish()
        for name in self._names:  # outlined by the style sheet
            name.set_path_effects([])
        style: dict[str, Any] = {"bbox_inches": "tight", "pad_inches": 0.03}
        return embedded(self._figure, kind, label, self.tooltips, **style)

    def _finish(self) -> None:
        """Draw the legend below the map, and the scale."""
        self.axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, -0.36 / self._height_inch),
            ncols=self._columns,
            frameon=False,
            fontsize=8,
            labelcolor=Ink.TEXT,
            handlelength=1.6,
            columnspacing=1.8,
        )
        self._draw_scale()

    def _once(self, label: str) -> str:
        """The label, unless the legend has it already."""
        known, self._labels = label in self._labels, self._labels | {label}
        return "_" if known else label

    def _write(
        self,
        text: str,
        place: Point,
        offs: Sequence[tuple[float, float]],
        ink: str,
        halo: str,
        **style: Any,
    ) -> None:
        """Draw a text near a place: where there is space, else where it overlaps least.

        Not repeated beside the same text.
        """
        whole: dict[str, Any] = {"fontsize": _SMALL, "ha": "center", "va": "center"} | style
        note = self.axes.annotate(
            text,
            place,
            gid="name" if halo == Ink.HALO else "name on-zone",
            xytext=offs[0],
            textcoords="offset points",
            color=ink,
            annotation_clip=True,
            path_effects=[patheffects.withStroke(linewidth=2.4, foreground=halo)],
            **whole,
        )
        box = note.get_window_extent().padded(_TOUCH_PX)
        if any(label == text and Bbox.intersection(box, other) for label, other in self._taken):
            note.remove()
            return
        scale = self._figure.dpi / 72
        (x, y), spots = offs[0], []
        for off in offs:
            spot = box.translated(scale * (off[0] - x), scale * (off[1] - y))
            spots.append((sum(_shared(spot, other) for _, other in self._taken), spot, off))
        _, spot, off = min(spots, key=lambda found: found[0])
        note.xyann = off
        self._names.append(note)
        self._taken.append((text, spot))

    def _draw_scale(self) -> None:
        """Draw a scale bar and a north arrow above the upper right corner."""
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
        style: dict[str, Any] = {"ha": "center", "color": Ink.TEXT}
        middle_m, arrow_m = east - bar_m / 2, east - bar_m - 0.03 * width_m
        self.axes.text(middle_m, high, f"{bar_m:g} m", transform=place, fontsize=7.5, **style)
        self.axes.annotate(
            "N",
            xy=(arrow_m, top),
            xytext=(arrow_m, foot),
            xycoords=place,
            textcoords=place,
            fontsize=8,
            arrowprops={"arrowstyle": "-|>", "color": Ink.TEXT, "linewidth": 1.1},
            annotation_clip=False,
            **style,
        )


def _shared(box: Bbox, other: Bbox) -> float:
    """The overlap of two boxes."""
    shared = Bbox.intersection(box, other)
    return 0.0 if shared is None else shared.width * shared.height


def drawn(shape: Shape) -> BaseGeometry:
    """The shape to draw, with round circles."""
    if isinstance(shape, Circle):
        return ShapelyPoint(shape.centre).buffer(shape.radius_m, quad_segs=48)
    return shape.polygon


def roomiest(polygon: Polygon) -> Point:
    """Where a line of text fits best: on a long west-east chord near the center."""
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
