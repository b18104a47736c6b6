"""Geometries of GeoJSON, as all files of zones in JSON have them."""

from collections.abc import Mapping
from typing import Any, Final

from air_router.files import JsonDocument, JsonValues, Keys, is_number
from air_router.files.maps.map_area import (
    MapCircle,
    MapOutline,
    MapRing,
    outline_of_rings,
    place_of,
)
from air_router.files.maps.zone_format import MAX_RADIUS_M, Shapes, ZoneFeature
from geo.frame import Geodetic

_WITHOUT_AREA: Final = frozenset({"MultiPoint", "LineString", "MultiLineString"})
_TWO_COMMAS: Final = 4  # numbers that a place becomes by two decimal commas


class GeometryReader(JsonValues):
    """Reads values and geometries of a JSON document, noting their problems.

    Attributes:
        feature: The one that is read: takes problems and notes.
        advice: What to do where nothing in the file has an area; "": that is no problem.
    """

    advice = ""

    def __init__(self, document: JsonDocument) -> None:
        super().__init__(document.data, self.report)
        self.feature = ZoneFeature(document)

    def report(self, keys: Keys, message: str, code: str) -> None:
        """Note a problem with the feature that is read."""
        self.feature.report(keys, message, code)

    def number_within(
        self, keys: Keys, what: str, lowest: float, highest: float, *, in_text: bool = False
    ) -> float | None:
        """A number in a range; None, with a problem noted, if it is something else."""
        value = self.number(keys, what, in_text=in_text)
        if value is None or lowest <= value <= highest:
            return value
        message = f"{what} must be from {lowest:g} to {highest:g}, found {value:.10g}"
        self.feature.report(keys, f"{message}; correct it", "out-of-range")
        return None

    def choice(self, keys: Keys, what: str, choices: Mapping[str, Any]) -> Any:
        """The meaning of one of these keywords (in any case); None, with a problem noted."""
        value = self.at(*keys)
        if isinstance(value, str) and value.upper() in choices:
            return choices[value.upper()]
        self.wrong(keys, f"{what} must be one of {', '.join(choices)}")
        return None

    def position(self, keys: Keys) -> Geodetic | None:
        """A place given as [longitude, latitude], perhaps with an altitude behind."""
        value = self.at(*keys)
        place = _place(value)
        if place is not None:
            return place
        if not isinstance(value, list) or len(value) < 2:
            self.wrong(keys, "a place must be [longitude, latitude]")
        elif not (is_number(value[0]) and is_number(value[1])):
            self.wrong(keys, "a place must be two numbers, [longitude, latitude]")
        elif len(value) == _TWO_COMMAS and (meant := _decimal_commas(value)):
            advice = f"decimals stand behind a point: {meant}"
            self.feature.report(keys, f"a place of four whole numbers; {advice}", "wrong-length")
        else:
            message = f"there is no longitude {value[0]:.10g}, latitude {value[1]:.10g}"
            self.feature.report_place(keys, message, float(value[0]), float(value[1]))
        return None

    def circle(self, keys: Keys, radius_keys: Keys) -> MapCircle | None:
        """A place and a radius in metres."""
        centre = self.position(keys)
        radius_m = self.number_within(radius_keys, "the radius in metres", 0.001, MAX_RADIUS_M)
        if centre is None or radius_m is None:
            self.feature.saw([] if centre is None else [centre])
            return None
        return MapCircle(centre, radius_m)

    def shapes(self, keys: Keys) -> Shapes:
        """The areas of a geometry; other shapes are noted."""
        kind = self.at(*keys, "type")
        places: Keys = (*keys, "coordinates")
        shape: MapOutline | MapCircle | None = None
        if kind == "MultiPolygon":
            parts = self.pieces(places, "the coordinates")
            outlines = [(part, self._outline(part)) for part in parts]
            return [(part, outline) for part, outline in outlines if outline is not None]
        if kind == "GeometryCollection":
            inner = self.pieces((*keys, "geometries"), "the geometries")
            return [shape for piece in inner for shape in self.shapes(piece)]
        if kind == "Polygon":
            shape = self._outline(places)
        elif kind == "Point":
            shape = self.point(keys)
        elif isinstance(kind, str) and kind in _WITHOUT_AREA:
            self.feature.without_area((*keys, "type"), f"a {kind} has no area", self.advice)
        else:
            self.wrong((*keys, "type"), "the type of a geometry is Polygon, MultiPolygon or Point")
        return [] if shape is None else [(keys, shape)]

    def pieces(self, keys: Keys, what: str) -> list[Keys]:
        """Where the pieces of a geometry stand; that there are none is noted."""
        pieces = self.entries(keys, what)
        if not pieces and self.at(*keys) == []:
            self.feature.note(keys, "a geometry without pieces: left out", "no-area")
        return pieces

    def point(self, keys: Keys) -> MapCircle | None:
        """A point as a circle, if it has a radius."""
        message = "a point without a radius (radius_m) has no area"
        self.feature.without_area(keys, message, self.advice)
        return None

    def _outline(self, keys: Keys) -> MapOutline | None:
        """A polygon's rings, the first around it, the others around its holes."""
        rings = self.entries(keys, "a polygon's coordinates")
        if not rings and self.at(*keys) == []:
            message = "a polygon without a ring; draw it again"
            self.feature.report(keys, message, "zone-too-few-corners")
        return outline_of_rings([*map(self._ring, rings)])

    def _ring(self, keys: Keys) -> MapRing | None:
        values = self.at(*keys)
        places = map(_place, values if isinstance(values, list) else [])
        ring = [place for place in places if place is not None]
        if not isinstance(values, list) or len(ring) < len(values):
            self.feature.saw(ring)
            for corner in self.entries(keys, "a polygon's ring"):  # to find the problem
                self.position(corner)
            return None
        return self.feature.ring(ring, keys)


def _place(value: Any) -> Geodetic | None:
    """[longitude, latitude] as a place; None if it is none."""
    if not isinstance(value, list) or len(value) < 2 or not all(map(is_number, value[:2])):
        return None
    if len(value) == _TWO_COMMAS and _decimal_commas(value):
        return None
    return place_of(value[1], value[0])


def _decimal_commas(value: list[Any]) -> str:
    """The place that [8,5, 47,3] means; "" where four numbers are a place, height and measure."""
    whole = all(isinstance(each, int) and is_number(each) for each in value)
    if not whole or value[1] < 0 or value[3] < 0 or value[2:] == [0, 0]:
        return ""
    return "[{}.{}, {}.{}]".format(*value)
