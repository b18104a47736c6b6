"""A reader of its own for mission files, for the judge: home, heights, zones and fences in metres.

Written from docs/mission-file.md and docs/files.md, not from the code that flies: what that code
misreads or drops is here all the same. What this reader cannot read it refuses; it leaves nothing
out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import shapely
import yaml
from pyproj import Transformer
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

Pair = tuple[float, float]

_SIDE_M: Final = 50.0
"""Sides are straight in degrees: this far apart they get corners in metres."""

_METRES_PER_DEGREE: Final = 111_000.0
_SPEED_M_S, _CLEARANCE_M, _MARGIN_M, _ACCEPTANCE_M, _RESERVE = 3.5, 5.0, 5.0, 2.0, 0.25


class MissionFileError(Exception):
    """The judge cannot read this mission file; the message says what and where."""


class Frame:
    """Metres east and north of a place, on the ellipsoid.

    Args:
        origin: Latitude and longitude in degrees.
    """

    def __init__(self, origin: Pair) -> None:
        self._to_metres, self._to_degrees = _transformers(*origin)

    def metres(self, latitude_deg: Any, longitude_deg: Any) -> tuple[Any, Any]:
        """East and north of places: numbers or arrays."""
        east, north = self._to_metres.transform(longitude_deg, latitude_deg)
        return east, north

    def degrees(self, east_m: float, north_m: float) -> Pair:
        """Latitude and longitude of a place."""
        longitude, latitude = self._to_degrees.transform(east_m, north_m)
        return latitude, longitude


@cache  # a tenth of a second each, and every file of a flight has the same home
def _transformers(latitude: float, longitude: float) -> tuple[Transformer, Transformer]:
    """From degrees to metres of a place, and back."""
    projection = f"+proj=aeqd +lat_0={latitude!r} +lon_0={longitude!r} +datum=WGS84 +units=m"
    return (
        Transformer.from_crs("EPSG:4326", projection, always_xy=True),
        Transformer.from_crs(projection, "EPSG:4326", always_xy=True),
    )


@dataclass(frozen=True, slots=True)
class Area:
    """A fence or a zone.

    Attributes:
        name: As in the file.
        outline: What it covers, in metres; of a circle only its centre.
        radius_m: Of a circle; 0 for a polygon.
        clearance_m: What is to be kept from it.
        lower_m: Lowest altitude that it applies to, above mean sea level.
        upper_m: Highest one.
        periods: When it applies, as in the file; none: always. The judge lets it apply always.
    """

    name: str
    outline: BaseGeometry
    radius_m: float = 0.0
    clearance_m: float = _CLEARANCE_M
    lower_m: float = -math.inf
    upper_m: float = math.inf
    periods: tuple[Mapping[str, Any], ...] = ()

    @property
    def polygon(self) -> BaseGeometry:
        """What it covers; a circle with many corners."""
        return self.outline.buffer(self.radius_m, quad_segs=64) if self.radius_m else self.outline


@dataclass(frozen=True, slots=True)
class RawMission:
    """What the judge has to know of a mission; metres are east and north of home.

    Attributes:
        frame: Metres of home.
        home: Latitude and longitude in degrees.
        ground_amsl_m: Of the ground at home; None: the file does not say.
        altitudes_m: All that it cruises at, above home.
        waypoints: Where to, in metres.
        rally: Where it may land in need, in metres; of several UAVs none is put on board.
        zones: To stay outside of.
        fences: To stay inside of, all of them.
        clearance_m: To be kept from fences, and from zones without one of their own.
        vertical_margin_m: How far the vehicle may be off its altitudes.
        acceptance_m: So near to a place counts as there.
        speed_m_s: To cruise at.
        battery_reserve: Come home at this share of a full battery.
    """

    frame: Frame
    home: Pair
    ground_amsl_m: float | None
    altitudes_m: tuple[float, ...]
    waypoints: tuple[Pair, ...]
    zones: tuple[Area, ...]
    fences: tuple[Area, ...]
    rally: tuple[Pair, ...] = ()
    clearance_m: float = _CLEARANCE_M
    vertical_margin_m: float = _MARGIN_M
    acceptance_m: float = _ACCEPTANCE_M
    speed_m_s: float = _SPEED_M_S
    battery_reserve: float = _RESERVE


def read_mission(
    path: Path, text: str | None = None, uav: str | None = None, ground_amsl_m: float | None = None
) -> RawMission:
    """Read a mission file.

    Args:
        path: Of the file; those that it names are looked for beside it.
        text: Its text, if that is not what is in the file now.
        uav: Which of several it is flown by.
        ground_amsl_m: Height of the ground at home, where the file does not say.

    Raises:
        MissionFileError: there is something in it that this reader does not know.
    """
    text = path.read_text(encoding="utf-8") if text is None else text
    data = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506
    return _YamlReader(path, data, uav, ground_amsl_m).read()


class _YamlReader:
    def __init__(
        self, path: Path, data: dict[str, Any], uav: str | None, ground_amsl_m: float | None
    ) -> None:
        self._path = path
        own = (data.get("uavs") or {}).get(uav) or {}
        if data.get("uavs") and uav is None:
            own = next(iter(data["uavs"].values())) or {}
        self._data = {**data, **own}  # the UAV's own values come first
        self._local = data.get("coordinates", "degrees") == "local"  # pairs are metres, not degrees
        planner = data.get("planner") or {}
        self._planner = planner  # section of the file
        self._clearance_m = float(planner.get("clearance_m", _CLEARANCE_M))  # of areas without one
        origin = (data.get("frame") or {}).get("origin")
        self._source = Frame(tuple(origin)) if origin is not None else None  # of local pairs
        home = self._data["home"]
        amsl = home.get("altitude_amsl_m") if isinstance(home, dict) else None
        self._ground_m = ground_amsl_m if amsl is None else float(amsl)  # AMSL, at home
        self._home = self._degrees(home["position"] if isinstance(home, dict) else home)
        self._frame = Frame(self._home)

    def read(self) -> RawMission:
        data, planner = self._data, self._planner
        places = [p if isinstance(p, dict) else {"position": p} for p in data["waypoints"]]
        altitudes, alone = {float(data["altitude_m"])}, "uavs" not in data
        altitudes |= {float(p["altitude_m"]) for p in places if "altitude_m" in p}
        fences = data.get("fences") or ([data["fence"]] if data.get("fence") else [])
        zones = [self._area(zone, f"zone {n}") for n, zone in enumerate(data["no_fly_zones"], 1)]
        for entry in data.get("no_fly_files") or []:
            named = entry if isinstance(entry, dict) else {"file": entry}
            zones += self._zones_of_file(self._path.parent / named["file"])
        return RawMission(
            frame=self._frame,
            home=self._home,
            ground_amsl_m=self._ground_m,
            altitudes_m=tuple(sorted(altitudes)),
            waypoints=tuple(self._metres(p["position"]) for p in places),
            zones=tuple(zones),
            fences=tuple(self._area(fence, f"fence {n}") for n, fence in enumerate(fences, 1)),
            rally=tuple(self._metres(p) for p in data.get("rally_points") or () if alone),
            clearance_m=self._clearance_m,
            vertical_margin_m=float(planner.get("vertical_margin_m", _MARGIN_M)),
            acceptance_m=float(planner.get("acceptance_radius_m", _ACCEPTANCE_M)),
            speed_m_s=float(data.get("speed_m_s", _SPEED_M_S)),
            battery_reserve=float(data.get("battery_reserve", _RESERVE)),
        )

    def _degrees(self, pair: Sequence[float]) -> Pair:
        if not self._local:
            return float(pair[0]), float(pair[1])
        if self._source is None:
            raise MissionFileError(f"{self._path}: local coordinates without frame.origin")
        return self._source.degrees(float(pair[0]), float(pair[1]))

    def _metres(self, pair: Sequence[float]) -> Pair:
        east, north = self._frame.metres(*self._degrees(pair))
        return float(east), float(north)

    def _ring(self, pairs: Sequence[Sequence[float]]) -> list[Pair]:
        return [self._metres(pair) for pair in _dense(pairs, 1.0 if self._local else None)]

    def _area(self, area: Any, name: str) -> Area:
        if not isinstance(area, dict):
            area = {"polygon": area}
        known = {"name", "polygon", "holes", "circle", "clearance_m", "altitude", "active"}
        if set(area) - known - {"crosses_fence"}:
            raise MissionFileError(f"{self._path}: {name}: the judge does not know {set(area)}")
        name = str(area.get("name", name))
        if "circle" in area:
            circle = area["circle"]
            shape: BaseGeometry = Point(self._metres(circle["centre"]))
            radius_m = float(circle["radius_m"])
        else:
            rings = [self._ring(hole) for hole in area.get("holes") or []]
            shape, radius_m = Polygon(self._ring(area["polygon"]), rings), 0.0
        return self._limited(name, shape, radius_m, area)

    def _limited(
        self, name: str, shape: BaseGeometry, radius_m: float, area: Mapping[str, Any]
    ) -> Area:
        limits = area.get("altitude") or {}
        both = limits.get("reference", "home")
        lower = self._amsl(limits.get("lower_m"), limits.get("lower_reference", both), -math.inf)
        upper = self._amsl(limits.get("upper_m"), limits.get("upper_reference", both), math.inf)
        clearance_m = float(area.get("clearance_m", self._clearance_m))
        return Area(
            name, shape, radius_m, clearance_m, lower, upper, tuple(area.get("active") or ())
        )

    def _amsl(self, limit: float | None, reference: str, otherwise_m: float) -> float:
        """Above mean sea level; the ground is as high everywhere as at home."""
        if limit is None:
            return otherwise_m
        return float(limit) + (0.0 if reference == "amsl" else self._ground_m or 0.0)

    def _zones_of_file(self, path: Path) -> Iterator[Area]:
        document = json.loads(path.read_text(encoding="utf-8")) if path.suffix != ".kml" else None
        if document is None or document.get("type") not in {"FeatureCollection", "Feature"}:
            raise MissionFileError(f"{path}: the judge reads zones from GeoJSON features only")
        if any("extendedProperties" in f for f in document.get("features", [])):
            raise MissionFileError(f"{path}: the judge does not read geozones")
        for number, feature in enumerate(document.get("features", [document]), 1):
            properties = feature.get("properties") or {}
            if properties.get("kind", "zone") == "zone":
                yield from self._zones_of_feature(feature, properties, f"{path.stem} {number}")

    def _zones_of_feature(
        self, feature: Mapping[str, Any], properties: Mapping[str, Any], name: str
    ) -> Iterator[Area]:
        name = str(properties.get("name") or properties.get("title") or feature.get("id") or name)
        given = {
            **{key: properties[key] for key in ("clearance_m", "active") if key in properties},
            "altitude": {
                "lower_m": properties.get("lower_m", properties.get("lower")),
                "upper_m": properties.get("upper_m", properties.get("upper")),
                **{k: v for k, v in properties.items() if k.endswith("reference")},
            },
        }
        for shape, radius_m in self._shapes(feature["geometry"], properties):
            yield self._limited(name, shape, radius_m, given)

    def _shapes(
        self, geometry: Mapping[str, Any], properties: Mapping[str, Any]
    ) -> Iterator[tuple[BaseGeometry, float]]:
        kind = geometry["type"]
        if kind == "GeometryCollection":
            for inner in geometry["geometries"]:
                yield from self._shapes(inner, properties)
            return
        coordinates = geometry["coordinates"]
        if kind == "Point":
            radius_m = float(properties.get("radius_m", properties.get("radius")))
            east, north = self._frame.metres(coordinates[1], coordinates[0])
            yield Point(east, north), radius_m
            return
        if kind not in {"Polygon", "MultiPolygon"}:
            raise MissionFileError(f"{self._path}: a zone of the type {kind}")
        for rings in [coordinates] if kind == "Polygon" else coordinates:
            outer, *holes = (_ring_of(self._frame, [c[1::-1] for c in ring]) for ring in rings)
            yield Polygon(outer, holes), 0.0


def _ring_of(frame: Frame, pairs: Sequence[Sequence[float]]) -> list[Pair]:
    """A ring of latitude and longitude whose sides are straight in degrees, in metres."""
    return [(float(e), float(n)) for e, n in (frame.metres(*pair) for pair in _dense(pairs, None))]


def _dense(pairs: Sequence[Sequence[float]], metres: float | None) -> list[Pair]:
    """A ring with corners on its long sides, so that it keeps its form in any projection."""
    corners = [(float(p[0]), float(p[1])) for p in pairs]
    scale = _METRES_PER_DEGREE if metres is None else metres
    ring = LineString([*corners, corners[0]])
    dense = shapely.segmentize(ring, _SIDE_M / scale)
    return [(float(a), float(b)) for a, b in shapely.get_coordinates(dense)[:-1]]
