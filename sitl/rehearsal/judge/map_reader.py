"""The judge's own reader of map files: zones of GeoJSON, OpenAir, KML and ED-269.

Written from docs/files.md. Each zone comes as a mission file would have it, with its name; limits
in feet and flight levels are metres then. What this reader does not know it refuses.
"""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from sitl.rehearsal.judge.evidence import EvidenceError

Zone = dict[str, Any]

_FOOT_M: Final = 0.3048
_NAUTICAL_MILE_M: Final = 1852.0
_COLD, _LOW_M = 0.9, 600.0
"""A flight level may lie so much lower than its number: a share of it, and metres."""

_UNITS: Final = MappingProxyType({"0": 1.0, "M": 1.0, "1": _FOOT_M, "FT": _FOOT_M, "F": _FOOT_M})
_LEVELS: Final = frozenset({"6", "FL"})
_DATUMS: Final = MappingProxyType(
    {
        **dict.fromkeys(("1", "MSL", "AMSL", "ALT"), "amsl"),
        **dict.fromkeys(("0", "GND", "SFC", "AGL", "ASFC"), "ground"),
    }
)
_KML: Final = "{http://www.opengis.net/kml/2.2}"
_LIMIT: Final = re.compile(r"(?:FL\s*(\d+)|([\d.]+)\s*(FT|F|M(?!SL))?\s*([A-Z]+)?)")
_ANGLE: Final = re.compile(r"(\d+):(\d+(?:\.\d+)?)(?::(\d+(?:\.\d+)?))?\s*([NSEW])")


def zones_of_map(path: Path, text: str) -> Iterator[tuple[str, Zone]]:
    """The zones of a map file and its text, each with its name. Raises EvidenceError."""
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise EvidenceError(f"{path}: the judge does not read such files")
    yield from reader(path, text)


def _limits(end: str, limit: tuple[float, str] | None) -> dict[str, Any]:
    return {} if limit is None else {f"{end}_m": limit[0], f"{end}_reference": limit[1]}


def _limit(path: Path, value: float, unit: str, datum: str, end: str) -> tuple[float, str] | None:
    """Metres, and above what; None: no limit that counts."""
    if unit in _LEVELS:
        return (value * 100 * _FOOT_M * _COLD - _LOW_M, "amsl") if end == "lower" else None
    if unit not in _UNITS or datum not in _DATUMS:
        raise EvidenceError(f"{path}: a limit of {value} {unit} {datum}")
    metres = value * _UNITS[unit]
    return None if end == "lower" and metres <= 0.0 else (metres, _DATUMS[datum])


# JSON


def _of_json(path: Path, text: str) -> Iterator[tuple[str, Zone]]:
    document = json.loads(text)
    features = document.get("features", [document]) if isinstance(document, dict) else document
    for number, feature in enumerate(features, 1):
        if "extendedProperties" in feature:
            raise EvidenceError(f"{path}: the judge does not read ED-318")
        if isinstance(feature.get("geometry"), list):
            yield from _of_ed269(path, feature)
        elif feature.get("type") == "Feature":
            yield from _of_feature(path, feature, number)
        else:
            raise EvidenceError(f"{path}: the judge reads GeoJSON features and ED-269 only")


def _of_feature(path: Path, feature: Mapping[str, Any], number: int) -> Iterator[tuple[str, Zone]]:
    given = feature.get("properties") or {}
    title = given.get("name") or given.get("title") or feature.get("id")
    kept = {key: given[key] for key in ("clearance_m", "active") if key in given}
    kept["altitude"] = {
        "lower_m": given.get("lower_m", given.get("lower")),
        "upper_m": given.get("upper_m", given.get("upper")),
        **{key: value for key, value in given.items() if key.endswith("reference")},
    }
    for end in ("lower", "upper"):
        name, faa = f"{end}Limit", f"{end.upper()}_VAL"
        if name in given:
            limit = given[name]
            parts = limit["value"], str(limit["unit"]), str(limit["referenceDatum"])
            kept["altitude"] |= _limits(end, _limit(path, *parts, end))
        elif faa in given:
            unit, datum = given[f"{end.upper()}_UOM"], given[f"{end.upper()}_CODE"]
            kept["altitude"] |= _limits(end, _limit(path, given[faa], unit, datum, end))
    radius_m = given.get("radius_m", given.get("radius"))
    for shape in _shapes(path, feature["geometry"], radius_m):
        if given.get("kind", "zone") == "zone":
            yield str(title or f"{path.stem} {number}"), kept | shape


def _of_ed269(path: Path, zone: Mapping[str, Any]) -> Iterator[tuple[str, Zone]]:
    if zone["applicability"] != [{"permanent": "YES"}] or zone["restriction"] != "PROHIBITED":
        raise EvidenceError(f"{path}: the judge does not know when {zone['identifier']} applies")
    for volume in zone["geometry"]:
        altitude: dict[str, Any] = {}
        for end in ("lower", "upper"):
            parts = volume["uomDimensions"], volume[f"{end}VerticalReference"]
            altitude |= _limits(end, _limit(path, volume[f"{end}Limit"], *parts, end))
        shape = volume["horizontalProjection"]
        if shape["type"] == "Circle":
            circle = {"centre": shape["center"][1::-1], "radius_m": shape["radius"]}
            yield str(zone["name"]), {"circle": circle, "altitude": altitude}
        else:
            for drawn in _shapes(path, shape, None):
                yield str(zone["name"]), {**drawn, "altitude": altitude}


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


# OpenAir


def _of_openair(path: Path, text: str) -> Iterator[tuple[str, Zone]]:
    for number, entry in enumerate(re.split(r"^AC ", text, flags=re.MULTILINE)[1:], 1):
        name, altitude, ring = f"{path.stem} {number}", dict[str, Any](), list[Any]()
        centre, zone = None, dict[str, Any]()
        for line in entry.splitlines()[1:]:
            keyword, _, rest = line.partition(" ")
            if keyword == "AN":
                name = rest
            elif keyword in {"AL", "AH"}:
                end = "lower" if keyword == "AL" else "upper"
                altitude |= _limits(end, _openair_limit(path, rest, end))
            elif keyword == "DP":
                ring.append(_place(path, rest))
            elif keyword == "V" and rest.startswith("X="):
                centre = _place(path, rest[2:])
            elif keyword == "DC":
                zone["circle"] = {"centre": centre, "radius_m": float(rest) * _NAUTICAL_MILE_M}
            elif keyword:
                raise EvidenceError(f"{path}: the judge does not read {line!r}")
        yield name, {**(zone or {"polygon": ring}), "altitude": altitude}


def _openair_limit(path: Path, text: str, end: str) -> tuple[float, str] | None:
    match = _LIMIT.fullmatch(text.strip().upper())
    if match is None:
        raise EvidenceError(f"{path}: a limit {text!r}")
    if match[1]:
        return _limit(path, float(match[1]), "FL", "STD", end)
    return _limit(path, float(match[2]), match[3] or "FT", match[4] or "MSL", end)


def _place(path: Path, text: str) -> list[float]:
    found = _ANGLE.findall(text)
    if len(found) != 2:
        raise EvidenceError(f"{path}: a place {text!r}")
    angles = [float(d) + float(m) / 60.0 + float(s or 0) / 3600.0 for d, m, s, _ in found]
    return [a if side in "NE" else -a for a, (*_, side) in zip(angles, found, strict=True)]


# KML


def _of_kml(path: Path, text: str) -> Iterator[tuple[str, Zone]]:
    for mark in ET.fromstring(text).iter(f"{_KML}Placemark"):  # noqa: S314 - of the rehearsal
        name = mark.findtext(f"{_KML}name", path.stem)
        data = {d.get("name"): d.findtext(f"{_KML}value", "") for d in mark.iter(f"{_KML}Data")}
        known = {"radius_m", "lower_m", "upper_m", "reference"}
        if set(data) - known:
            raise EvidenceError(f"{path}: the judge does not know {set(data) - known} of {name}")
        altitude: dict[str, Any] = {
            end: float(data[end]) for end in ("lower_m", "upper_m") if end in data
        }
        altitude |= {"reference": data["reference"]} if "reference" in data else {}
        point, polygon = mark.find(f"{_KML}Point"), mark.find(f"{_KML}Polygon")
        if point is not None:
            (place,) = _corners(point)
            circle = {"centre": place[1::-1], "radius_m": float(data["radius_m"])}
            yield name, {"circle": circle, "altitude": altitude}
        elif polygon is not None:
            corners = _corners(polygon)
            top_m = max((float(c[2]) for c in corners if len(c) > 2), default=None)
            extruded = polygon.findtext(f"{_KML}extrude") == "1"
            if extruded and top_m is not None and "upper_m" not in altitude:
                altitude |= {"upper_m": top_m, "upper_reference": "amsl"}
            yield name, {"polygon": [c[1::-1] for c in corners[:-1]], "altitude": altitude}
        else:
            raise EvidenceError(f"{path}: {name} is neither a point nor a polygon")


def _corners(element: ET.Element) -> list[list[float]]:
    text = next(element.iter(f"{_KML}coordinates")).text or ""
    return [[float(part) for part in corner.split(",")] for corner in text.split()]


_READERS: Final[Mapping[str, Callable[[Path, str], Iterator[tuple[str, Zone]]]]] = MappingProxyType(
    {".geojson": _of_json, ".json": _of_json, ".txt": _of_openair, ".kml": _of_kml}
)
