"""A reader of its own for mission files, for the judge: home, heights, zones and fences in metres.

Written from docs/mission-file.md and docs/files.md, not from the code that flies: what that code
misreads or drops is here all the same. What this reader cannot read it refuses; it leaves nothing
out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import shapely
import yaml
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from sitl.rehearsal.judge.evidence import EvidenceError, Frame
from sitl.rehearsal.judge.hours import meets
from sitl.rehearsal.judge.map_reader import zones_of_map

Pair = tuple[float, float]

_SIDE_M: Final = 50.0
_SIDE_DEG: Final = _SIDE_M / 111_000.0
"""Sides are straight in the file's coordinates: this far apart they get corners in metres."""

_KNOWN: Final = frozenset(
    {"name", "polygon", "holes", "circle", "clearance_m", "altitude", "active", "crosses_fence"}
)
_SPEED_M_S, _CLEARANCE_M, _MARGIN_M, _ACCEPTANCE_M, _RESERVE = 3.5, 5.0, 5.0, 2.0, 0.25
_TRACKING_M: Final = 1.5
_WIND_M_S, _BREEZE_M_S, _ACCURACY_M = 5.0, 5.0, 1.0
_ESTIMATE, _STILL_M, _SWING_S2_M, _TURN_M, _GUST_S, _MORE_M = 0.63, 0.35, 0.0145, 0.3, 0.2, 0.04
"""How far a vehicle may be off its legs, as in docs/routes.md."""
_FAR_ABOVE_M: Final = 50.0
"""With the altitude in doubt zones count up to so far above the cruise."""

_LATER_S: Final = 4500.0
"""A flight may begin an hour later than it is to, and come home some minutes after its end."""

_PAST, _FUTURE = "2020", "2090"  # all rehearsals lie between


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

    def meets(self, low_m: float, high_m: float) -> bool:
        """Whether it applies anywhere between these altitudes, above mean sea level."""
        return self.lower_m <= high_m and low_m <= self.upper_m

    def same(self, other: Area) -> bool:
        """Whether two files draw the same, at the same heights, and want the same clearance."""
        rest = ((a.fence, a.radius_m, a.clearance_m, a.lower_m, a.upper_m) for a in (self, other))
        return len(set(rest)) == 1 and bool(self.outline.equals(other.outline))


@dataclass(frozen=True, slots=True)
class RawMission:
    """What the judge has to know of a mission; metres are east and north of home.

    Attributes:
        frame: Metres of home.
        ground_amsl_m: Of the ground at home; None: not in the file.
        altitude_m: That it cruises at where a waypoint has no other.
        altitudes_m: All that it cruises at, or may be sent to, above home.
        waypoints: Where to, in metres.
        heights_m: How high above home, of each of them.
        rally: Where it may land in need, in metres; of several UAVs none is put on board.
        zones: To stay outside of, but for those whose periods are over.
        fences: To stay inside of, all of them.
        clearance_m: To be kept from fences, and from zones without one of their own.
        vertical_margin_m: How far the vehicle may be off its altitudes.
        acceptance_m: So near to a place counts as there.
        speed_m_s: To cruise at.
        battery_reserve: Come home at this share of a full battery.
        duration_s: Come home so long after the take-off; infinite: when all is explored.
        endurance_s: How long a full battery lasts in cruise; infinite: not in the file.
        seek: Whom to seek in turn; empty: the file has no plain list.
        layer_top_m: So high above home another UAV's layer is nearer than its own.
        goals_from: The robots whose goals count.
        timers_s: How long states last, by the names of the file; those that it leaves out are not
            known.
        tracking_margin_m: Kept by ways on top of every clearance, at least.
        others: Of other UAVs: home, and how high above the level of this one's cruise they fly.
    """

    frame: Frame
    ground_amsl_m: float | None
    altitudes_m: tuple[float, ...]
    altitude_m: float
    waypoints: tuple[Pair, ...]
    zones: tuple[Area, ...]
    fences: tuple[Area, ...]
    heights_m: tuple[float, ...] = ()
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
    tracking_margin_m: float = _TRACKING_M
    others: tuple[tuple[Pair, float], ...] = ()

    @property
    def areas(self) -> tuple[Area, ...]:
        """Zones and fences."""
        return self.zones + self.fences

    @property
    def cruise_m(self) -> Pair:
        """From where to where it may fly between take-off and landing, above mean sea level."""
        low_m, high_m = (self.altitudes_m[end] + (self.ground_amsl_m or 0.0) for end in (0, -1))
        return low_m - self.vertical_margin_m, high_m + self.vertical_margin_m

    @property
    def at_every_height(self) -> RawMission:
        """With zones whatever their height, but for those far above, or above home."""
        top_m = self.cruise_m[1]

        def stays(zone: Area) -> bool:
            near_m = zone.clearance_m + self.tracking_margin_m + zone.radius_m
            home = zone.lower_m > top_m and zone.outline.distance(shapely.Point(0.0, 0.0)) < near_m
            return home or zone.lower_m > top_m + _FAR_ABOVE_M

        zones = (
            zone if stays(zone) else replace(zone, lower_m=-math.inf, upper_m=math.inf)
            for zone in self.zones
        )
        return replace(self, zones=tuple(zones))

    @property
    def cruised(self) -> tuple[Area, ...]:
        """The zones that apply there, and fences."""
        return tuple(area for area in self.areas if area.meets(*self.cruise_m))


def read_mission(  # noqa: PLR0913, PLR0917 - all that a file is read with
    path: Path,
    text: str | None = None,
    uav: str | None = None,
    ground_amsl_m: float | None = None,
    flown: tuple[float, float] | None = None,
    map_files: Mapping[str, str] | None = None,
) -> RawMission:
    """Read a mission file.

    Args:
        path: Of the file; files that it names are searched for beside it.
        text: Its text, if that is not what is in the file now.
        uav: Which of several it is flown by.
        ground_amsl_m: Height of the ground at home, where the file has none.
        flown: From when to when, Unix seconds: zones whose hours are not then are left out, those
            whose hours are then apply; None: they may apply.
        map_files: Texts of files that it names, by their paths.

    Raises:
        EvidenceError: there is something in it that this reader does not know.
    """
    text = path.read_text(encoding="utf-8") if text is None else text
    data = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506
    return _YamlReader(path, data, uav, ground_amsl_m, flown, map_files or {}).read()


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
    def __init__(  # noqa: PLR0913, PLR0917 - all that a file is read with
        self,
        path: Path,
        data: dict[str, Any],
        uav: str | None,
        ground_amsl_m: float | None,
        flown_s: tuple[float, float] | None,
        map_files: Mapping[str, str],
    ) -> None:
        self._path, self._map_files = path, map_files
        self._flown_s = flown_s
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
        self._pairs = _Pairs(Frame((float(place[0]), float(place[1]))), source)

    def read(self) -> RawMission:
        data, planner, metres = self._data, self._planner, self._pairs.metres
        places = [p if isinstance(p, dict) else {"position": p} for p in data["waypoints"]]
        above = {u: o for o in self._others if (u := o["level_m"] - data["level_m"]) > 0.0}
        altitudes, alone = {float(data["altitude_m"])}, "uavs" not in data
        altitudes |= {float(p["altitude_m"]) for p in places if "altitude_m" in p}
        altitudes |= {float(altitude_m) for altitude_m in data.get("altitudes_m") or ()}
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
            ground_amsl_m=self._ground_m,
            altitudes_m=tuple(sorted(altitudes)),
            altitude_m=float(data["altitude_m"]),
            waypoints=tuple(metres(p["position"]) for p in places),
            heights_m=tuple(float(p.get("altitude_m", data["altitude_m"])) for p in places),
            zones=tuple(map(self._timed, filter(self._may_apply, zones))),
            fences=tuple(self._area(a, f"fence {n}", fence=True) for n, a in enumerate(fences, 1)),
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
            tracking_margin_m=_tracking_m(planner, float(data.get("speed_m_s", _SPEED_M_S))),
            others=tuple(
                (metres(other["home"]["position"]), other["level_m"] - data["level_m"])
                for other in self._others
            ),
        )

    def _may_apply(self, zone: Area) -> bool:
        """Whether a zone's hours may be those of the flight, or of one up to an hour later."""
        if self._flown_s is None or not zone.periods:
            return not _over(zone.periods)
        begin_s, end_s = self._flown_s
        return any(meets(period, begin_s, end_s + _LATER_S) for period in zone.periods)

    def _timed(self, zone: Area) -> Area:
        """A zone without its hours if the flight is in them."""
        if self._flown_s is None or not zone.periods:
            return zone
        applies = any(meets(period, *self._flown_s) for period in zone.periods)
        return replace(zone, periods=()) if applies else zone

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
            shape = Polygon(
                pairs.ring(area["polygon"]), [*map(pairs.ring, area.get("holes") or ())]
            )
        limits, periods = area.get("altitude") or {}, tuple(area.get("active") or ())
        return Area(
            name=str(area.get("name", name)),
            outline=shape,
            radius_m=float(area.get("circle", {}).get("radius_m", 0.0)),
            clearance_m=float(area.get("clearance_m", self._clearance_m)),
            lower_m=self._amsl(limits, "lower", -math.inf),
            upper_m=self._amsl(limits, "upper", math.inf),
            periods=() if any(map(_always, periods)) else periods,
            fence=fence,
        )

    def _amsl(self, limits: Mapping[str, Any], end: str, otherwise_m: float) -> float:
        """Above mean sea level; the ground may be higher or lower by the file's figure."""
        limit = limits.get(f"{end}_m")
        reference = limits.get(f"{end}_reference", limits.get("reference", "home"))
        if limit is None or reference == "amsl":
            return otherwise_m if limit is None else float(limit)
        relief_m = self._planner.get("terrain_relief_m", 20.0) if reference == "ground" else 0.0
        return float(limit) + math.copysign(relief_m, otherwise_m) + (self._ground_m or 0.0)

    def _zones_of_file(self, path: Path) -> Iterator[Area]:
        pairs = self._pairs._replace(source=None)  # those of map files are degrees
        text = self._map_files.get(str(path)) or path.read_text(encoding="utf-8")
        for name, zone in zones_of_map(path, text):
            yield self._area(zone, name, pairs=pairs)


def _over(periods: Sequence[Mapping[str, Any]]) -> bool:
    return bool(periods) and all(str(each.get("until", "9")) < _PAST for each in periods)


def _always(period: Mapping[str, Any]) -> bool:
    begins, ends = str(period.get("from", "9")), str(period.get("until", "9"))
    return set(period) <= {"from", "until"} and begins < _PAST < _FUTURE < ends


def _flown(data: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """A mission with a UAV's own values, and the level of its layer, above the sea if known."""
    homes = [h if isinstance(h, dict) else {"position": h} for h in (data["home"], own.get("home"))]
    known = [float(h.get("altitude_amsl_m") or 0.0) for h in homes if "altitude_amsl_m" in h]
    both = {**data, **own, "home": homes["home" in own]}
    return {**both, "level_m": float(both["altitude_m"]) + [0.0, *known][-1]}


def _tracking_m(planner: Mapping[str, Any], speed_m_s: float) -> float:
    """What routes keep on top of a clearance, by the formula of docs/routes.md."""
    gusts_m_s = max(float(planner.get("wind_m_s", _WIND_M_S)) - _BREEZE_M_S, 0.0)
    accuracy_m = float(planner.get("position_accuracy_m", _ACCURACY_M))
    off_m = _ESTIMATE * accuracy_m + _STILL_M + _SWING_S2_M * speed_m_s**2
    off_m += _TURN_M + _GUST_S * gusts_m_s
    return max(float(planner.get("tracking_margin_m", _TRACKING_M)), round(off_m, 2) + _MORE_M)
