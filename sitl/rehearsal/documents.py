"""Mission files of special scenes: zones from map files, other coordinates, hours, a second UAV.

Each takes a mission as its YAML has it, a folder for further files, and random numbers.
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import shapely
import yaml

from sitl.rehearsal.judge import Area, Frame, Pair, RawMission, leads_home, read_mission
from sitl.rehearsal.mission_file import ANOTHER, with_another_uav

Document = dict[str, Any]
Draw = Callable[[Document, Path, random.Random], Document]
"""Makes another mission file of one."""

_HOME_AMSL_M: Final = 550.0
_FOOT_M: Final = 0.3048
_MILE_M: Final = 1852.0
_RELIEF_M: Final = 20.0
_SITE_M: Final = 6.0
_TRIES: Final = 80
_CORNERS: Final = 34
_FROM_LANDINGS_M: Final = 18.0
_SPARE_M: Final = 2.0
_HOMES_M: Final = 12.0
_OFF_M, _REACHES_M = 5.0, 1.0
"""How far a vehicle may be off its layer, and by how much of that a zone holds for it."""

_FLOWN: Final = 8
"""So many waypoints surely are flown to."""


def _read(document: Document, uav: str | None = None) -> RawMission:
    return read_mission(Path(), yaml.safe_dump(document), uav)


def _at_home(document: Document) -> Document:
    """The mission with home high above the sea, and what zones may be off the ground."""
    place = document["home"]
    place = place["position"] if isinstance(place, dict) else place
    planner = {"terrain_relief_m": _RELIEF_M} | (document.get("planner") or {})
    home = {"position": place, "altitude_amsl_m": _HOME_AMSL_M}
    return {**document, "home": home, "planner": planner}


def clear_sites(mission: RawMission, rng: random.Random, radius_m: float) -> Iterator[Pair]:
    """Places for circles of such a radius that no waypoint is in, or cut off by."""
    places = [(0.0, 0.0), *mission.waypoints, *mission.rally]
    west, south, east, north = shapely.MultiPoint(places).bounds
    kept_m = radius_m + mission.clearance_m + mission.tracking_margin_m + _SPARE_M
    drawn = list(mission.zones)
    for _ in range(_TRIES):
        place = rng.uniform(west, east), rng.uniform(south, north)
        if min(math.dist(place, other) for other in places) < kept_m:
            continue
        outline = shapely.Point(place)
        if any(area.border.distance(outline) < radius_m for area in drawn):
            continue
        area = Area("site", outline, radius_m, mission.clearance_m)
        wider = [
            replace(zone, clearance_m=zone.clearance_m + mission.tracking_margin_m)
            for zone in (*drawn, area)
        ]
        among = replace(mission, zones=tuple(wider))
        if all(leads_home(among, waypoint) for waypoint in places):
            drawn.append(area)
            yield place


def as_it_is(document: Document, folder: Path, rng: random.Random) -> Document:
    """Among the zones of its file alone: far from these nothing is near at any height."""
    del folder, rng
    return document


# Units


def of_map_files(document: Document, folder: Path, rng: random.Random) -> Document:
    """Its zones in map files, limits in feet and flight levels, some of which it flies over.

    A flight that reads them right keeps from some, and goes over or under others: on these are
    waypoints.
    """
    document = _at_home(document)
    mission = _read(document)
    low_m, high_m = mission.cruise_m
    own = [z for z in document["no_fly_zones"] if "polygon" in z and not z.get("crosses_fence")]
    rings: list[Any] = []
    for zone in own:  # PX4 stores so many points
        if sum(map(len, rings)) + len(zone["polygon"]) <= _CORNERS:
            rings.append(zone["polygon"])
    writers = [*_WRITERS]
    rng.shuffle(writers)
    landings = shapely.MultiPoint([(0.0, 0.0), *mission.rally])
    over = [
        place
        for place in mission.waypoints
        if shapely.Point(place).distance(landings) > _FROM_LANDINGS_M
    ][:_FLOWN]
    sites = clear_sites(mission, rng, _SITE_M)
    files = []
    for number, ring in enumerate(rings):
        writer = writers[number % len(writers)]
        zones = [_Zone(f"zone {number}", ring, *_around(low_m, high_m, rng))]
        if number < len(writers):
            passed = _around(*_passed(low_m, high_m, rng), rng, wider_m=0.0)
            box = _box(mission, rng.choice(over), 4.0)
            zones.append(_Zone(f"passed {number}", box, *passed))
            site = next(sites, None)
            if site is not None:
                limits = _around(low_m, high_m, rng)
                zones.append(_Zone(f"site {number}", [_degrees(mission, site)], *limits))
        path = folder / f"zones {number}{writer[0]}"
        path.write_text(writer[1](zones, rng), encoding="utf-8")
        files.append(str(path))
    rest = [zone for zone in document["no_fly_zones"] if zone not in own]
    return {**document, "no_fly_zones": rest, "no_fly_files": files}


class _Zone:
    """A ring of degrees, or the centre of a circle, and limits above the sea."""

    def __init__(self, name: str, ring: list[Any], lower_m: float, upper_m: float) -> None:
        self.name, self.ring, self.lower_m, self.upper_m = name, ring, lower_m, upper_m

    @property
    def round(self) -> bool:
        return len(self.ring) == 1


def _around(
    low_m: float, high_m: float, rng: random.Random, wider_m: float = 1.0
) -> tuple[float, float]:
    return low_m - wider_m * rng.uniform(1.0, 4.0), high_m + wider_m * rng.uniform(2.0, 20.0)


def _passed(low_m: float, high_m: float, rng: random.Random) -> tuple[float, float]:
    """Limits under, or over, where it cruises, that are not so in metres if they are in feet."""
    if rng.randrange(2):
        return low_m - 25.0, low_m - rng.uniform(1.5, 6.0)
    return high_m + rng.uniform(1.5, 6.0), high_m + 60.0


def _degrees(mission: RawMission, place: Pair) -> list[float]:
    return [round(float(degrees), 8) for degrees in mission.frame.degrees(*place)]


def _box(mission: RawMission, middle: Pair, half_m: float) -> list[Any]:
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    places = [(middle[0] + e * half_m, middle[1] + n * half_m) for e, n in corners]
    return [_degrees(mission, place) for place in places]


def _geometry(zone: _Zone) -> dict[str, Any]:
    """As GeoJSON has it, longitude first."""
    corners = [[p[1], p[0]] for p in zone.ring]
    if zone.round:
        return {"type": "Point", "coordinates": corners[0]}
    return {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}


def _features(zones: list[_Zone], properties: Callable[[_Zone], Mapping[str, Any]]) -> str:
    features = [
        {
            "type": "Feature",
            "properties": {
                "name": z.name,
                **properties(z),
                **({"radius_m": _SITE_M} if z.round else {}),
            },
            "geometry": _geometry(z),
        }
        for z in zones
    ]
    return json.dumps({"type": "FeatureCollection", "features": features})


def _feet(metres: float) -> float:
    return round(metres / _FOOT_M, 1)


def _openaip(zones: list[_Zone], rng: random.Random) -> str:
    """GeoJSON with openAIP's limits: unit 1 is feet, datum 1 the sea."""
    del rng

    def limit(metres: float) -> dict[str, Any]:
        return {"value": _feet(metres), "unit": 1, "referenceDatum": 1}

    return _features(
        zones, lambda z: {"lowerLimit": limit(z.lower_m), "upperLimit": limit(z.upper_m)}
    )


def _faa(zones: list[_Zone], rng: random.Random) -> str:
    """GeoJSON with the FAA's properties."""
    del rng

    def limits(zone: _Zone) -> dict[str, Any]:
        ends = (("LOWER", zone.lower_m), ("UPPER", zone.upper_m))
        parts = (
            {f"{end}_VAL": _feet(metres), f"{end}_UOM": "FT", f"{end}_CODE": "MSL"}
            for end, metres in ends
        )
        return {key: value for part in parts for key, value in part.items()}

    return _features(zones, limits)


def _plain(zones: list[_Zone], rng: random.Random) -> str:
    """GeoJSON with the names of the mission file, in metres above home or the sea."""
    own = rng.randrange(2)
    above_m, reference = (_HOME_AMSL_M, "home") if own else (0.0, "amsl")
    return _features(
        zones,
        lambda z: {
            "lower_m": round(z.lower_m - above_m, 2),
            "upper_m": round(z.upper_m - above_m, 2),
            "reference": reference,
        },
    )


def _openair(zones: list[_Zone], rng: random.Random) -> str:
    """OpenAir: feet above the sea, degrees and minutes, nautical miles; a flight level below.

    Limits of circles are in metres, with the unit.
    """
    lines = []
    for zone in zones:
        lower = f"{_feet(zone.lower_m)} ft MSL"
        if zone.name.startswith("zone") and rng.randrange(2):
            lower = "FL40"  # 1219 m at most, 497 m where the pressure is low: it applies
        upper = f"{_feet(zone.upper_m)}ft MSL"
        if zone.round:
            lower, upper = (f"{metres:.1f}M MSL" for metres in (zone.lower_m, zone.upper_m))
        lines += ["AC R", f"AN {zone.name}", f"AL {lower}", f"AH {upper}"]
        places = [_angles(*place) for place in zone.ring]
        if zone.round:
            lines += [f"V X={places[0]}", f"DC {_SITE_M / _MILE_M:.9f}"]
        else:
            lines += [f"DP {place}" for place in places]
        lines.append("")
    return "\n".join(lines)


def _angles(latitude_deg: float, longitude_deg: float) -> str:
    """As soaring writes a place: degrees and minutes of an angle."""
    parts = []
    for angle, letters in ((latitude_deg, "NS"), (longitude_deg, "EW")):
        whole, part = divmod(abs(angle), 1.0)
        parts.append(f"{int(whole)}:{part * 60:.8f} {letters[angle < 0]}")
    return " ".join(parts)


def _kml(zones: list[_Zone], rng: random.Random) -> str:
    """KML: polygons down to the ground, in metres above the sea; circles by their own data."""
    del rng
    marks = []
    for zone in zones:
        if zone.round:
            place, data = zone.ring[0], {"radius_m": _SITE_M, "reference": "amsl"}
            data |= {"lower_m": round(zone.lower_m, 2), "upper_m": round(zone.upper_m, 2)}
            shape = f"<Point><coordinates>{place[1]},{place[0]}</coordinates></Point>"
        else:
            data = {"lower_m": round(zone.lower_m, 2), "reference": "amsl"}
            corners = [*zone.ring, zone.ring[0]]
            text = " ".join(f"{p[1]},{p[0]},{zone.upper_m:.2f}" for p in corners)
            shape = (
                "<Polygon><extrude>1</extrude><altitudeMode>absolute</altitudeMode>"
                f"<outerBoundaryIs><LinearRing><coordinates>{text}</coordinates></LinearRing>"
                "</outerBoundaryIs></Polygon>"
            )
            if zone.name.startswith("passed"):  # else only the extrusion has it
                data |= {"upper_m": round(zone.upper_m, 2)}
            else:
                data = {}
        more = "".join(f'<Data name="{k}"><value>{v}</value></Data>' for k, v in data.items())
        extended = f"<ExtendedData>{more}</ExtendedData>"
        marks.append(f"<Placemark><name>{zone.name}</name>{extended}{shape}</Placemark>")
    head = '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2">'
    return f"{head}<Document>{''.join(marks)}</Document></kml>"


def _ed269(zones: list[_Zone], rng: random.Random) -> str:
    """The JSON of authorities, in feet or metres above the sea."""
    feet = rng.randrange(3) > 0
    features = []
    for zone in zones:
        limits_m = zone.lower_m, zone.upper_m
        lower, upper = map(_feet, limits_m) if feet else (round(m, 2) for m in limits_m)
        corners = [[p[1], p[0]] for p in zone.ring]
        shape: dict[str, Any] = {"type": "Polygon", "coordinates": [[*corners, corners[0]]]}
        if zone.round:
            shape = {"type": "Circle", "center": corners[0], "radius": _SITE_M}
        volume = {
            "uomDimensions": "FT" if feet else "M",
            "lowerLimit": lower,
            "lowerVerticalReference": "AMSL",
            "upperLimit": upper,
            "upperVerticalReference": "AMSL",
            "horizontalProjection": shape,
        }
        features.append(
            {
                "identifier": zone.name.replace(" ", ""),
                "country": "USA",
                "name": zone.name,
                "type": "COMMON",
                "restriction": "PROHIBITED",
                "applicability": [{"permanent": "YES"}],
                "zoneAuthority": [{"name": "city", "purpose": "INFORMATION"}],
                "geometry": [volume],
            }
        )
    return json.dumps({"title": "zones", "features": features})


_WRITERS: Final = (
    (".geojson", _openaip),
    (".geojson", _faa),
    (".geojson", _plain),
    (".txt", _openair),
    (".kml", _kml),
    (".json", _ed269),
)


def in_local_metres(document: Document, folder: Path, rng: random.Random) -> Document:
    """The same mission in metres east and north of an origin that is not home."""
    del folder
    mission = _read(document)
    off = rng.uniform(80.0, 300.0), rng.uniform(-700.0, -400.0)
    origin = _degrees(mission, off)
    frame = Frame((origin[0], origin[1]))

    def pair(degrees: list[float]) -> list[float]:
        return [round(float(metres), 3) for metres in frame.metres(*degrees)]

    def area(given: Any) -> Any:
        if not isinstance(given, dict):
            return list(map(pair, given))
        shape = dict(given)
        if "polygon" in shape:
            shape["polygon"] = list(map(pair, shape["polygon"]))
        if "holes" in shape:
            shape["holes"] = [list(map(pair, hole)) for hole in shape["holes"]]
        if "circle" in shape:
            circle = shape["circle"]
            shape["circle"] = {**circle, "centre": pair(circle["centre"])}
        return shape

    def place(given: Any) -> Any:
        if not isinstance(given, dict):
            return pair(given)
        return {**given, "position": pair(given["position"])}

    return {
        **document,
        "coordinates": "local",
        "frame": {"origin": origin},
        "home": place(document["home"]),
        "waypoints": list(map(place, document["waypoints"])),
        "rally_points": list(map(place, document.get("rally_points") or ())),
        "fence": area(document["fence"]),
        "no_fly_zones": list(map(area, document["no_fly_zones"])),
    }


# Hours: of a flight on Monday, 21 September 2026, from 14:13 on, which may begin until 15:13.

_APPLIES: Final[tuple[list[dict[str, Any]], ...]] = (
    [{"between": ["14:00", "16:00"]}],
    [{"days": ["monday"], "between": ["14:15", "14:16"]}],
    [{"days": ["sun"], "between": ["22:00", "15:00"]}],
    [{"between": ["22:00", "14:14"]}],
    [{"days": ["mon", "fri"], "between": ["14:00", "24:00"]}],
    [{"from": "2026-09-21T16:00:00+02:00", "between": ["14:00", "18:00"]}],
    [{"until": "2026-09-21T10:30:00-04:00", "days": ["monday"]}],
    [{"days": ["tuesday"]}, {"between": ["13:00", "15:00"]}],
)
_DOES_NOT: Final[tuple[list[dict[str, Any]], ...]] = (
    [{"days": ["tuesday", "sunday"]}],
    [{"between": ["16:00", "14:00"]}],
    [{"days": ["monday"], "between": ["22:00", "15:00"]}],
    [{"between": ["15:40", "23:30"]}],
    [{"from": "2026-09-21T16:00:00-02:00"}],
    [{"until": "2026-09-21T15:00:00+02:00", "days": ["monday"]}],
    [{"days": ["mon"], "between": ["08:00", "12:00"]}, {"days": ["sunday"]}],
)


def with_daily_hours(document: Document, folder: Path, rng: random.Random) -> Document:
    """Its zones in hours that the flight is in; over waypoints such as it is not in."""
    del folder
    document = _at_home(document)
    mission = _read(document)
    begin = rng.randrange(len(_APPLIES))
    zones = [
        {**zone, "active": _APPLIES[(begin + number) % len(_APPLIES)]}
        for number, zone in enumerate(document["no_fly_zones"])
    ]
    first = [place for place in mission.waypoints if math.hypot(*place) > _HOMES_M][:_FLOWN]
    for number, hours in enumerate(rng.sample(_DOES_NOT, 4)):
        circle = {"centre": _degrees(mission, first[number]), "radius_m": 4.0}
        zones.append({"name": f"closed {number}", "circle": circle, "active": hours})
    return {**document, "no_fly_zones": zones}


# Heights


def over_low_zones(document: Document, folder: Path, rng: random.Random) -> Document:
    """It may be sent to other altitudes; under waypoints are zones that end below all of them."""
    del folder
    document = {**_at_home(document), "altitudes_m": [30, 60]}
    mission = _read(document)
    below_m = mission.cruise_m[0] - _HOME_AMSL_M
    zones = list(document["no_fly_zones"])
    first = [place for place in mission.waypoints if math.hypot(*place) > 3 * _HOMES_M][:10]
    landings = shapely.MultiPoint([(0.0, 0.0), *mission.rally])
    for number, place in enumerate(first):
        if number % 3 == 2 or shapely.Point(place).distance(landings) < _FROM_LANDINGS_M:
            continue
        circle = {"centre": _degrees(mission, place), "radius_m": rng.uniform(2.0, 9.0)}
        upper_m = rng.uniform(3.0, below_m - 1.0)
        zones.append({"name": f"low {number}", "circle": circle, "altitude": {"upper_m": upper_m}})
    return {**document, "no_fly_zones": zones}


def of_second_uav(document: Document, folder: Path, rng: random.Random) -> Document:
    """A mission of two UAVs, of which the second is judged: above or below, from a higher home.

    Zones have limits above the sea, that hold for its layer by a metre: counted from the home of
    the first, as much higher or lower as they are, one or the other would not.
    """
    uav = document["uav"]
    document = with_another_uav(document, folder, rng)
    higher_m = rng.choice((7.0, 12.0, -7.0))
    homes = {uav: document["home"], ANOTHER: document["uavs"][ANOTHER]["home"]}
    places = {name: h["position"] if isinstance(h, dict) else h for name, h in homes.items()}
    second = document["uavs"][ANOTHER]
    second["home"] = {"position": places[ANOTHER], "altitude_amsl_m": _HOME_AMSL_M + higher_m}
    document = _in_layer(document, _HOME_AMSL_M + second["altitude_m"])
    second["altitude_m"] -= higher_m
    team = yaml.safe_load(Path(document["team"]).read_text(encoding="utf-8"))
    met = team["robots"][uav]["clients"]
    team["robots"][ANOTHER]["clients"] = list(met)
    for robot in met:
        team["robots"][robot]["clients"].append(ANOTHER)
    Path(document["team"]).write_text(yaml.safe_dump(team), encoding="utf-8")
    return _at_home(document)


def _in_layer(document: Document, level_m: float) -> Document:
    """Its zones up to a layer, or from there on, above the sea: by a metre of what it may be off.

    Every third is as it was.
    """
    off_m = (document.get("planner") or {}).get("vertical_margin_m", _OFF_M) - _REACHES_M
    limits: tuple[Document, ...] = (
        {"altitude": {"upper_m": level_m - off_m, "reference": "amsl"}},
        {"altitude": {"lower_m": level_m + off_m, "reference": "amsl"}},
        {},
    )
    zones = [
        {**limits[number % len(limits)], **zone}
        for number, zone in enumerate(document["no_fly_zones"])
    ]
    return {**document, "no_fly_zones": zones}


def with_way_home(document: Document, folder: Path, rng: random.Random) -> Document:
    """A mission whose battery lasts for the way home and not for much more."""
    del folder, rng
    return {**_at_home(document), "endurance_s": 400}
