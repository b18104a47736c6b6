"""A reader of its own for mission files, for the judge: home, heights, zones and fences in metres.

Written from docs/mission-file.md and docs/files.md, not from the code that flies: what that code
misreads or drops is here all the same. What this reader cannot read it refuses; it leaves nothing
out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import shapely
import yaml
from pyproj import Proj
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from sitl.rehearsal.judge.evidence import EvidenceError

Pair = tuple[float, float]

_SIDE_M: Final = 50.0
_SIDE_DEG: Final = _SIDE_M / 111_000.0
"""Sides are straight in the file's coordinates: this far apart they get corners in metres."""

_KNOWN: Final = frozenset(
    {"name", "polygon", "holes", "circle", "clearance_m", "altitude", "active", "crosses_fence"}
)
_SPEED_M_S, _CLEARANCE_M, _MARGIN_M, _ACCEPTANCE_M, _RESERVE = 3.5, 5.0, 5.0, 2.0, 0.25


class Frame:
    """Metres east and north of a place, on the ellipsoid.

    Args:
        origin: Latitude and longitude in degrees.
    """

    def __init__(self, origin: Pair) -> None:
        self._project = Proj(proj="aeqd", lat_0=origin[0], lon_0=origin[1], datum="WGS84")

    def metres(self, latitude_deg: Any, longitude_deg: Any) -> tuple[Any, Any]:
        """East and north of places: numbers or arrays."""
        east, north = self._project(longitude_deg, latitude_deg)
        return east, north

    def item_place(self, fields: Mapping[str, Any]) -> Pair:
        """East and north of what has its latitude and longitude in `x` and `y`, as plans do."""
        east, north = self.metres(fields["x"] / 1e7, fields["y"] / 1e7)
        return float(east), float(north)

    def degrees(self, east_m: Any, north_m: Any) -> tuple[Any, Any]:
        """Latitude and longitude of places: numbers or arrays."""
        longitude, latitude = self._project(east_m, north_m, inverse=True)
        return latitude, longitude


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
        fence: Whether to stay inside of it, else outside.
    """

    name: str
    outline: BaseGeometry
    radius_m: float = 0.0
    clearance_m: float = _CLEARANCE_M
    lower_m: float = -math.inf
    upper_m: float = math.inf
    periods: tuple[Mapping[str, Any], ...] = ()
    fence: bool = False

    @property
    def polygon(self) -> BaseGeometry:
        """What it covers; a circle with many corners."""
        return self.outline.buffer(self.radius_m, quad_segs=64) if self.radius_m else self.outline

    @property
    def border(self) -> BaseGeometry:
        """What a vehicle must not come near to: a zone, or the edge of a fence."""
        return self.polygon.boundary if self.fence else self.polygon

    def same(self, other: Area) -> bool:
        """Whether two files draw the same, at the same heights, and want the same clearance."""
        limits = (
            (area.fence, area.radius_m, area.clearance_m, area.lower_m, area.upper_m)
            for area in (self, other)
        )
        return len(set(limits)) == 1 and bool(self.outline.equals(other.outline))


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
        duration_s: Come home so long after the take-off; infinite: when all is explored.
        endurance_s: How long a full battery lasts in cruise; infinite: the file does not say.
        seek: Whom to seek in turn; empty: the file has no plain list.
        layer_top_m: So high above home another UAV's layer is nearer than its own.
        goals_from: The robots whose goals count.
        timers_s: How long states last, by the names of the file; those that it leaves out are not
            known.
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
    duration_s: float = math.inf
    endurance_s: float = math.inf
    seek: tuple[str, ...] = ()
    layer_top_m: float = math.inf
    goals_from: tuple[str, ...] = ()
    timers_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def areas(self) -> tuple[Area, ...]:
        """Zones and fences."""
        return self.zones + self.fences


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
        EvidenceError: there is something in it that this reader does not know.
    """
    text = path.read_text(encoding="utf-8") if text is None else text
    data = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506
    return _YamlReader(path, data, uav, ground_amsl_m).read()


class _Pairs(NamedTuple):
    """What pairs of numbers mean.

    Attributes:
        home: Metres of home.
        source: Of local pairs, which are metres; None: they are degrees.
    """

    home: Frame
    source: Frame | None

    def metres(self, pair: Sequence[float]) -> Pair:
        """A place, in metres of home."""
        degrees = pair if self.source is None else self.source.degrees(*pair)
        east, north = self.home.metres(*map(float, degrees))
        return float(east), float(north)

    def ring(self, pairs: Sequence[Sequence[float]]) -> list[Pair]:
        """A ring with corners on its long sides, so that it keeps its form in any projection."""
        corners = [(float(p[0]), float(p[1])) for p in pairs]
        side = _SIDE_DEG if self.source is None else _SIDE_M
        dense = shapely.segmentize(LineString([*corners, corners[0]]), side)
        return [self.metres(pair) for pair in shapely.get_coordinates(dense)[:-1]]


class _YamlReader:
    def __init__(
        self, path: Path, data: dict[str, Any], uav: str | None, ground_amsl_m: float | None
    ) -> None:
        self._path = path
        flown = {name: _flown(data, own or {}) for name, own in (data.get("uavs") or {}).items()}
        uav = next(iter(flown), "") if uav is None else uav
        self._data = flown.pop(uav) if uav in flown else _flown(data, {})
        self._others = flown.values()
        self._planner = data.get("planner") or {}  # section of the file
        self._clearance_m = float(self._planner.get("clearance_m", _CLEARANCE_M))  # without another
        amsl = self._data["home"].get("altitude_amsl_m")
        self._ground_m = ground_amsl_m if amsl is None else float(amsl)  # AMSL, at home
        place, source = self._data["home"]["position"], None
        if data.get("coordinates", "degrees") == "local":
            origin = (data.get("frame") or {}).get("origin")
            if origin is None:
                raise EvidenceError(f"{path}: local coordinates without frame.origin")
            source = Frame(tuple(origin))
            place = source.degrees(*place)
        self._home: Pair = float(place[0]), float(place[1])
        self._pairs = _Pairs(Frame(self._home), source)

    def read(self) -> RawMission:
        data, planner, metres = self._data, self._planner, self._pairs.metres
        places = [p if isinstance(p, dict) else {"position": p} for p in data["waypoints"]]
        above = {u: o for o in self._others if (u := o["level_m"] - data["level_m"]) > 0.0}
        altitudes, alone = {float(data["altitude_m"])}, "uavs" not in data
        altitudes |= {float(p["altitude_m"]) for p in places if "altitude_m" in p}
        fences = data.get("fences") or ([data["fence"]] if data.get("fence") else [])
        zones = [self._area(z, f"zone {n}") for n, z in enumerate(data["no_fly_zones"], 1)]
        for entry in data.get("no_fly_files") or []:
            named = entry if isinstance(entry, dict) else {"file": entry}
            zones += self._zones_of_file(self._path.parent / named["file"])
        radius_m = float(planner.get("home_separation_m", 20.0)) / 2
        for other in above.values():  # it climbs and lands through this layer
            circle = {"centre": other["home"]["position"], "radius_m": radius_m}
            zones.append(self._area({"circle": circle}, "the climb corridor of another UAV"))
        return RawMission(
            frame=self._pairs.home,
            home=self._home,
            ground_amsl_m=self._ground_m,
            altitudes_m=tuple(sorted(altitudes)),
            waypoints=tuple(metres(p["position"]) for p in places),
            zones=tuple(zones),
            fences=tuple(
                self._area(area, f"fence {n}", fence=True) for n, area in enumerate(fences, 1)
            ),
            rally=tuple(metres(p) for p in data.get("rally_points") or () if alone),
            clearance_m=self._clearance_m,
            vertical_margin_m=float(planner.get("vertical_margin_m", _MARGIN_M)),
            acceptance_m=float(planner.get("acceptance_radius_m", _ACCEPTANCE_M)),
            speed_m_s=float(data.get("speed_m_s", _SPEED_M_S)),
            battery_reserve=float(data.get("battery_reserve", _RESERVE)),
            duration_s=float(data.get("duration_s", math.inf)),
            endurance_s=float(data.get("endurance_s", math.inf)),
            seek=tuple(seek if isinstance(seek := data.get("seek"), list) else ()),
            layer_top_m=max(altitudes) + min(above, default=math.inf) / 2,
            goals_from=tuple(data.get("goals_from") or ()),
            timers_s={name: float(at_s) for name, at_s in (data.get("timers") or {}).items()},
        )

    def _area(
        self, area: Any, name: str, *, fence: bool = False, pairs: _Pairs | None = None
    ) -> Area:
        pairs = pairs or self._pairs
        if not isinstance(area, dict):
            area = {"polygon": area}
        if set(area) - _KNOWN:
            raise EvidenceError(f"{self._path}: {name}: the judge does not know {set(area)}")
        if "circle" in area:
            shape: BaseGeometry = Point(pairs.metres(area["circle"]["centre"]))
        else:
            rings = [pairs.ring(hole) for hole in area.get("holes") or []]
            shape = Polygon(pairs.ring(area["polygon"]), rings)
        limits = area.get("altitude") or {}
        both = limits.get("reference", "home")
        return Area(
            name=str(area.get("name", name)),
            outline=shape,
            radius_m=float(area.get("circle", {}).get("radius_m", 0.0)),
            clearance_m=float(area.get("clearance_m", self._clearance_m)),
            lower_m=self._amsl(
                limits.get("lower_m"), limits.get("lower_reference", both), -math.inf
            ),
            upper_m=self._amsl(
                limits.get("upper_m"), limits.get("upper_reference", both), math.inf
            ),
            periods=tuple(area.get("active") or ()),
            fence=fence,
        )

    def _amsl(self, limit: float | None, reference: str, otherwise_m: float) -> float:
        """Above mean sea level; the ground is as high everywhere as at home."""
        if limit is None:
            return otherwise_m
        return float(limit) + (0.0 if reference == "amsl" else self._ground_m or 0.0)

    def _zones_of_file(self, path: Path) -> Iterator[Area]:
        document = json.loads(path.read_text(encoding="utf-8")) if path.suffix != ".kml" else None
        if document is None or document.get("type") not in {"FeatureCollection", "Feature"}:
            raise EvidenceError(f"{path}: the judge reads zones from GeoJSON features only")
        if any("extendedProperties" in f for f in document.get("features", [])):
            raise EvidenceError(f"{path}: the judge does not read geozones")
        pairs = self._pairs._replace(source=None)  # those of GeoJSON are degrees
        for number, feature in enumerate(document.get("features", [document]), 1):
            given = feature.get("properties") or {}
            title = given.get("name") or given.get("title") or feature.get("id")
            kept = {key: given[key] for key in ("clearance_m", "active") if key in given}
            kept["altitude"] = {
                "lower_m": given.get("lower_m", given.get("lower")),
                "upper_m": given.get("upper_m", given.get("upper")),
                **{key: value for key, value in given.items() if key.endswith("reference")},
            }
            radius_m = given.get("radius_m", given.get("radius"))
            for shape in _shapes(path, feature["geometry"], radius_m):
                if given.get("kind", "zone") == "zone":
                    yield self._area(
                        kept | shape, str(title or f"{path.stem} {number}"), pairs=pairs
                    )


def _flown(data: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """A mission with a UAV's own values, and the level of its layer, above the sea if known."""
    homes = [h if isinstance(h, dict) else {"position": h} for h in (data["home"], own.get("home"))]
    known = [float(h.get("altitude_amsl_m") or 0.0) for h in homes if "altitude_amsl_m" in h]
    both = {**data, **own, "home": homes["home" in own]}
    return {**both, "level_m": float(both["altitude_m"]) + [0.0, *known][-1]}


def _shapes(
    path: Path, geometry: Mapping[str, Any], radius_m: float | None
) -> Iterator[dict[str, Any]]:
    """The areas of a geometry of GeoJSON, as a mission file has them."""
    kind = geometry["type"]
    if kind == "GeometryCollection":
        for inner in geometry["geometries"]:
            yield from _shapes(path, inner, radius_m)
        return
    coordinates = geometry["coordinates"]
    if kind == "Point":
        yield {"circle": {"centre": coordinates[1::-1], "radius_m": radius_m}}
        return
    if kind not in {"Polygon", "MultiPolygon"}:
        raise EvidenceError(f"{path}: a zone of the type {kind}")
    for rings in [coordinates] if kind == "Polygon" else coordinates:
        outer, *holes = ([corner[1::-1] for corner in ring] for ring in rings)
        yield {"polygon": outer, "holes": holes}
