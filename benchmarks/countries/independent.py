"""A second reader of OpenAir and of zones in JSON, from the formats' public descriptions alone.

It shares no code with the reader that it judges, knows fewer forms, and gives up where it does not
understand. Areas come from equal-area projections, arcs from the ellipsoid's geodesics. What
docs/files.md promises of doubtful limits is written here once more.
"""

import json
import math
import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import shapely
from pyproj import Geod, Transformer
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

GEOD = Geod(ellps="WGS84")
STEP_DEG = 0.02
ARC_STEP_DEG = 0.5
FOOT_M, MILE_M = 0.3048, 1852.0
HIGHEST_M = 100_000.0

Ring = list[tuple[float, float]]  # longitude, latitude
Limit = tuple[float, str] | None  # metres above "ground" or "sea"


@dataclass
class Zone:
    """What a file states of one airspace or feature.

    Attributes:
        name: What the file calls it.
        polygons: Rings each: the outer one, then holes.
        circles: Longitude, latitude and radius in metres.
        limits: Lower and upper one of each volume.
    """

    name: str = ""
    polygons: list[list[Ring]] = field(default_factory=list)
    circles: list[tuple[float, float, float]] = field(default_factory=list)
    limits: list[tuple[Limit, Limit]] = field(default_factory=list)

    @property
    def first(self) -> tuple[float, float]:
        """A place of its border or centre: longitude, latitude."""
        return self.polygons[0][0][0] if self.polygons else self.circles[0][:2]


def read(path: Path) -> dict[int, Zone]:
    """The zones of a file, by the line of `AC` or by the number of the feature."""
    text = path.read_bytes().decode("utf-8-sig", "replace")
    zones = _json(json.loads(text)) if text.lstrip()[:1] in "[{" else _openair(text)
    return {key: zone for key, zone in zones.items() if zone.polygons or zone.circles}


def area_m2(zone: Zone) -> tuple[float, bool]:
    """The sum of a zone's areas, and whether a border of it crosses itself."""
    total, crossed = sum(math.pi * radius_m**2 for *_, radius_m in zone.circles), False
    for rings in zone.polygons:
        area, wrong = polygon_area_m2(rings)
        total, crossed = total + area, crossed or wrong
    return total, crossed


def polygon_area_m2(rings: list[Ring]) -> tuple[float, bool]:
    """The area of a polygon whose sides are straight in degrees; all it encloses, if it crosses."""
    lon, lat = rings[0][0]
    to_local = _equal_area(5 * round(lon / 5), 5 * round(lat / 5))
    local = [
        list(zip(*to_local.transform(*zip(*_dense(ring, lon), strict=True)), strict=True))
        for ring in rings
        if len(set(ring)) > 2
    ]
    if not local:
        return 0.0, True
    whole = Polygon(local[0], local[1:])
    if whole.is_valid:
        return whole.area, False
    return _enclosed(local[0]).area, True


@cache
def _equal_area(lon: float, lat: float) -> Transformer:
    projection = f"+proj=laea +lon_0={lon} +lat_0={lat} +ellps=WGS84"
    return Transformer.from_crs("OGC:CRS84", projection, always_xy=True)


def _enclosed(ring: list[tuple[float, float]]) -> BaseGeometry:
    lines = shapely.unary_union(LineString([*ring, ring[0]]))
    faces = shapely.polygonize([lines]).geoms
    return shapely.unary_union([Polygon(face.exterior) for face in faces])


def _dense(ring: Ring, near_lon: float) -> Ring:
    """Corners with others in between, longitudes without a jump."""
    places: Ring = []
    around = [(near_lon + (lon - near_lon + 180) % 360 - 180, lat) for lon, lat in ring]
    for (lon, lat), (to_lon, to_lat) in zip(around, around[1:] + around[:1], strict=True):
        steps = max(1, math.ceil(math.hypot(to_lon - lon, to_lat - lat) / STEP_DEG))
        places += [
            (lon + k / steps * (to_lon - lon), lat + k / steps * (to_lat - lat))
            for k in range(steps)
        ]
    return places


# OpenAir


_DEGREES = re.compile(r"([\d.:]+)\s*([NSEW])", re.IGNORECASE)


def _openair(document: str) -> dict[int, Zone]:
    reader = _OpenAir()
    for number, line in enumerate(re.split(r"\r\n?|\n", document), start=1):
        text = line.strip() if line[:2] == "AN" else re.sub(r"[*;].*", "", line).strip()
        command, _, rest = text.partition(" ")
        reader.line(number, command.upper(), rest.strip())
    reader.close()
    return reader.zones


class _OpenAir:
    def __init__(self) -> None:
        self.zones: dict[int, Zone] = {}
        self._zone = Zone()
        self._ring: Ring = []
        self._fields: dict[str, str] = {}
        self._centre, self._clockwise = (0.0, 0.0), True

    def line(self, number: int, command: str, rest: str) -> None:
        if command == "AC":
            self.close()
            self._zone, self._ring, self._fields, self._clockwise = Zone(), [], {}, True
            self.zones[number] = self._zone
        elif command in ("AN", "AL", "AH"):
            self._fields[command] = rest
        elif command == "V" and rest.upper().startswith("X"):
            self._centre = _places(rest)[0]
        elif command == "V" and rest.upper().startswith("D"):
            self._clockwise = "+" in rest
        elif command == "DP":
            self._ring += _places(rest)
        elif command == "DC":
            self._zone.circles.append((*self._centre, float(rest) * MILE_M))
        elif command in ("DA", "DB"):
            self._ring += _arc(self._centre, command, rest, clockwise=self._clockwise)

    def close(self) -> None:
        if self._ring:
            self._zone.polygons.append([self._ring])
        self._zone.name = self._fields.get("AN", "")
        low, high = self._fields.get("AL", ""), self._fields.get("AH", "")
        self._zone.limits = [(limit(low), limit(high, upper=True))]


def _arc(centre: tuple[float, float], command: str, rest: str, *, clockwise: bool) -> Ring:
    if command == "DA":
        radius, *angles = map(float, re.split(r"[,\s]+", rest))
        (begin, begin_m), (end, end_m) = ((angle, radius * MILE_M) for angle in angles)
        given: Ring = []
    else:
        given = _places(rest)
        (begin, begin_m), (end, end_m) = (
            (GEOD.inv(*centre, *place)[0], GEOD.inv(*centre, *place)[2]) for place in given
        )
    turn = (end - begin) % 360 if clockwise else -((begin - end) % 360)
    steps = max(2, math.ceil(abs(turn) / ARC_STEP_DEG))
    arc = [
        GEOD.fwd(*centre, begin + k / steps * turn, begin_m + k / steps * (end_m - begin_m))[:2]
        for k in range(steps + 1)
    ]
    return [given[0], *arc[1:-1], given[1]] if given else arc


def _places(text: str) -> Ring:
    numbers = []
    for digits, letter in _DEGREES.findall(text):
        value = sum(float(part) / 60**k for k, part in enumerate(digits.split(":")) if part)
        numbers.append(-value if letter.upper() in "SW" else value)
    return list(zip(numbers[1::2], numbers[::2], strict=True))


_GROUNDS, _SEAS = ("AGL", "GND", "ASFC", "SFC"), ("AMSL", "MSL", "ALT", "QNH")


def limit(text: str, *, upper: bool = False, unit: str = "FT", datum: str = "SEA") -> Limit:
    """A limit as text; None: none, or in doubt."""
    text = text.upper().strip(" \u00b7.,;")
    stated_datum = next((name for name in (*_GROUNDS, *_SEAS, "STD") if text.endswith(name)), "")
    text = text.removesuffix(stated_datum).strip()
    found = re.fullmatch(r"(FL)?\s*(-?\d+(?:\.\d+)?)\s*(FEET|FT|F|M)?", text)
    if found is None:
        return None
    level, digits, stated_unit = found.groups()
    unit = {"FEET": "FT", "F": "FT"}.get(stated_unit or unit, stated_unit or unit)
    if level or stated_datum == "STD":
        metres = float(digits) * FOOT_M * (100 if level else 1)
        return None if upper or metres * 0.9 - 600 <= 0 else (metres * 0.9 - 600, "sea")
    if stated_datum:
        datum = "GROUND" if stated_datum in _GROUNDS else "SEA"
    return _metres(float(digits), unit, datum, upper=upper)


def _metres(value: float, unit: str, datum: str, *, upper: bool) -> Limit:
    if unit not in ("M", "FT") or datum not in ("GROUND", "SEA"):
        return None
    metres = value * (FOOT_M if unit == "FT" else 1)
    if abs(metres) > HIGHEST_M or (metres <= 0 and (not upper or datum == "GROUND")):
        return None
    return metres, datum.lower()


# JSON


_NO_ZONES = "NO_RESTRICTION"
_DATUMS = {"AGL": "GROUND", "AMSL": "SEA", "MSL": "SEA"}


def _json(document: Any) -> dict[int, Zone]:
    features = document if isinstance(document, list) else document.get("features", [document])
    zones = {}
    for number, feature in enumerate(features):
        about = feature.get("properties", feature)
        flat = _flat({**about, "geometry": None} if feature is about else about)
        if _NO_ZONES in (flat.get("restriction"), flat.get("type")):
            continue
        zones[number] = zone = Zone(str(flat.get("name")))
        for volume in _volumes(feature.get("geometry")):
            shape = volume.get("horizontalProjection", volume)
            _shapes(shape, zone)
            layer = _flat({k: v for k, v in volume.items() if k != "horizontalProjection"})
            zone.limits.append(_limits({**flat, **layer}))
    return zones


def _volumes(geometry: Any) -> list[dict[str, Any]]:
    """Those of ED-269 are a list; in a collection of ED-318 each piece has its own layer."""
    if isinstance(geometry, list):
        return geometry
    return list(geometry["geometries"]) if "geometries" in geometry else [geometry]


def _flat(properties: dict[str, Any]) -> dict[str, Any]:
    """All names of objects and of objects in them, without capitals and underscores."""
    flat: dict[str, Any] = {}
    for name, value in properties.items():
        if isinstance(value, dict):
            flat = {**_flat(value), **flat}
        elif value not in (None, "") and not isinstance(value, list):
            flat[name.lower().replace("_", "")] = value
    return flat


def _limits(flat: dict[str, Any]) -> tuple[Limit, Limit]:
    unit = str(flat.get("uom", flat.get("uomdimensions", flat.get("unit", "")))).upper()
    both: list[Limit] = []
    for side in ("lower", "upper"):
        value = flat.get(side + "limit", flat.get(side))
        names = ("reference", "verticalreference", "ref")
        datum = next((_DATUMS.get(flat[side + n], "") for n in names if side + n in flat), "")
        if isinstance(value, str) and not re.fullmatch(r"-?\d+(\.\d+)?", value):
            both.append(limit(value, upper=side == "upper", unit="", datum=""))
        else:
            number = math.nan if value is None else float(value)
            unit = unit or ("M" if datum else "")
            limited = None if value is None else _metres(number, unit, datum, upper=side == "upper")
            both.append(limited)
    return both[0], both[1]


def _shapes(geometry: dict[str, Any], zone: Zone) -> None:
    kind, places = geometry["type"], geometry.get("coordinates")
    if kind == "Circle":
        zone.circles.append((*geometry["center"][:2], float(geometry["radius"])))
    elif kind == "Point":
        zone.circles.append((*places[:2], float(geometry["extent"]["radius"])))
    elif kind in ("Polygon", "MultiPolygon"):
        polygons = [places] if kind == "Polygon" else places
        zone.polygons += [[[tuple(p[:2]) for p in ring] for ring in rings] for rings in polygons]
