"""What stands in the 3D view of a flight: zones, fence, graph; robots and links as they change.

Plain data as Foxglove's `SceneUpdate` has them; metres east, north and above home.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

from shapely import Polygon

from air_router.mission.mission import Mission
from air_router.routing.graph import WaypointGraph
from geo.airspace.zone import Band
from geo.frame import Point
from mocha_link.links.metrics import LinkMetrics

FRAME: Final = "mission"
"""Metres east, north and up of the mission's origin; who has a place on the map is a frame too."""

Place = tuple[float, float, float]

_LOOP, _LIST = 1, 2
_ABOVE_M: Final = 20.0
"""A zone without end is drawn this much higher than the flight."""

_STRONG_DBM, _WEAK_DBM = -50.0, -90.0
_FENCE, _ZONE, _IDLE = (0.18, 0.49, 0.2), (0.78, 0.16, 0.16), (0.5, 0.5, 0.5)
_GRAPH, _ROBOT, _TEXT = (0.4, 0.4, 0.4), (0.08, 0.4, 0.75), (0.9, 0.9, 0.9)
_HERE: Final = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}


def mission_entities(mission: Mission, time: dict[str, int]) -> list[dict[str, Any]]:
    """Fence, zones (those that do not apply in grey), the waypoint graph and home."""
    top_m = max(
        [mission.altitude_above_home_m, *(w.altitude_above_home_m for w in mission.waypoints)]
    )
    entities = [
        _walls("fence", str(number), fence.polygon, Band(0.0, top_m), _FENCE, time)
        for number, fence in enumerate(mission.fences, start=1)
    ]
    applying = {zone.name for zone in mission.airspace.zones}
    for zone in mission.zones:
        band = zone.band or Band()
        lower_m, upper_m = max(band.lower_m, 0.0), min(band.upper_m, top_m + _ABOVE_M)
        drawn = Band(min(lower_m, upper_m), upper_m)
        colour = _ZONE if zone.name in applying else _IDLE
        entities.append(_walls("zone", zone.name, zone.shape.polygon, drawn, colour, time))
    graph = WaypointGraph(mission)
    legs = [
        (point.east_m, point.north_m, mission.altitude_above_home_m)
        for start, end in graph.graph.edges
        for point in (graph.position(start), graph.position(end))
    ]
    texts = [_text("home", (*mission.home, 0.0))]
    texts += [
        _text(str(spot.number), (*spot.position, spot.altitude_above_home_m))
        for spot in mission.waypoints
    ]
    lines = [_line(_LIST, legs, _GRAPH, 1.0)]
    graph_parts = {"lines": lines, "texts": texts, "spheres": [_ball((*mission.home, 0.0))]}
    return [*entities, _entity("graph", time, **graph_parts)]


def robot_entities(
    vehicle: Place | None,
    robots: Mapping[str, Point],
    links: Mapping[str, LinkMetrics],
    time: dict[str, int],
) -> list[dict[str, Any]]:
    """Robots where they were last heard of, and the links to those that are heard, by strength."""
    entities = []
    for name, position in robots.items():
        place = (*position, 0.0)
        link = links.get(name)
        signal_dbm = None if link is None else link.rssi_dbm
        words = name if signal_dbm is None else f"{name} {signal_dbm:.0f} dBm"
        lines = []
        if vehicle is not None and signal_dbm is not None:
            lines = [_line(_LIST, [vehicle, place], _by_strength(signal_dbm), 3.0)]
        text = _text(words, (*position, 3.0))
        entities.append(_entity(name, time, spheres=[_ball(place)], lines=lines, texts=[text]))
    return entities


def _walls(  # noqa: PLR0913, PLR0917 - what is drawn of an area
    kind: str,
    name: str,
    polygon: Polygon,
    band: Band,
    colour: tuple[float, float, float],
    time: dict[str, int],
) -> dict[str, Any]:
    lines, corners = [], []
    for ring in (polygon.exterior, *polygon.interiors):
        places = list(ring.coords)
        lines.append(_line(_LOOP, [(x, y, band.upper_m) for x, y in places[:-1]], colour, 2.0))
        for (x, y), (to_x, to_y) in pairwise(places):
            low, high = (x, y, band.lower_m), (x, y, band.upper_m)
            to_low, to_high = (to_x, to_y, band.lower_m), (to_x, to_y, band.upper_m)
            corners += [low, to_low, high, high, to_low, to_high]
    middle = polygon.representative_point()
    wall = {
        "pose": _HERE,
        "points": [_xyz(corner) for corner in corners],
        "color": _colour(colour, 0.25),
    }
    text = _text(name if kind == "zone" else kind, (middle.x, middle.y, band.upper_m))
    return _entity(f"{kind} {name}", time, lines=lines, triangles=[wall], texts=[text])


def _entity(name: str, time: dict[str, int], **parts: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "timestamp": time,
        "frame_id": FRAME,
        "id": name,
        **{part: parts.get(part, []) for part in ("spheres", "lines", "triangles", "texts")},
    }


def _line(
    kind: int, places: Sequence[Place], colour: tuple[float, float, float], pixels: float
) -> dict[str, Any]:
    return {
        "type": kind,
        "pose": _HERE,
        "thickness": pixels,
        "scale_invariant": True,
        "points": [_xyz(place) for place in places],
        "color": _colour(colour),
    }


def _ball(place: Place) -> dict[str, Any]:
    size = dict.fromkeys(("x", "y", "z"), 2.0)
    return {"pose": _at(place), "size": size, "color": _colour(_ROBOT)}


def _text(words: str, place: Place) -> dict[str, Any]:
    return {
        "pose": _at(place),
        "billboard": True,
        "font_size": 12.0,
        "scale_invariant": True,
        "color": _colour(_TEXT),
        "text": words,
    }


def _at(place: Place) -> dict[str, Any]:
    return {**_HERE, "position": _xyz(place)}


def _xyz(place: Iterable[float]) -> dict[str, float]:
    return {
        name: float(metres) if math.isfinite(metres) else 0.0
        for name, metres in zip("xyz", place, strict=True)
    }


def _colour(colour: tuple[float, float, float], alpha: float = 1.0) -> dict[str, float]:
    return dict(zip("rgba", (*colour, alpha), strict=True))


def _by_strength(signal_dbm: float) -> tuple[float, float, float]:
    """Green where it is strong, red where it is weak."""
    strength = (signal_dbm - _WEAK_DBM) / (_STRONG_DBM - _WEAK_DBM)
    strength = min(max(strength, 0.0), 1.0)
    return (1.0 - strength, strength, 0.1)
