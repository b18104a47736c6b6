"""A flight in the messages that Foxglove's panels draw by themselves, and Rerun's file is made of.

The names and fields are those of Foxglove's published schemas, in JSON. Nothing here is needed to
replay a flight: it is what is recorded anyway, said once more for the eye. In three dimensions
places are metres east, north and above home.
"""

import base64
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

from shapely import Polygon

from air_router.controller.model import (
    Announce,
    FlyToNode,
    FlyToPoint,
    MissionWaits,
    RobotPose,
    StateChanged,
)
from air_router.mission import Mission
from air_router.routing import WaypointGraph
from air_router.vehicle import Severity, Telemetry
from geo.airspace import Band
from geo.frame import FrameError, Point
from geo.grid import SemanticGrid
from mocha_link.links import LinkMetrics, Reading, Unit

EVERY_S: Final = 0.2
"""The vehicle's place is drawn so often; its telemetry is recorded at the full rate anyway."""

VEHICLE: Final = "vehicle"
FRAME: Final = "mission"
"""Metres east, north and up of the mission's origin; who has a place on the map is a frame too."""

LOCATION, POSE, LOG = "foxglove.LocationFix", "foxglove.PoseInFrame", "foxglove.Log"
GEOJSON, GRID, SCENE = "foxglove.GeoJSON", "foxglove.Grid", "foxglove.SceneUpdate"

Place = tuple[float, float, float]
Colour = tuple[float, float, float]
Plain = dict[str, Any]

_TYPES: Final = {str: "string", int: "integer"}
_INFO, _UINT8, _LOOP, _LIST = 2, 1, 1, 2  # of Foxglove's enumerations
_LEVELS: Final = {Severity.INFO: _INFO, Severity.WARNING: 3, Severity.ALARM: 4}  # WARNING, ERROR
_COLOURS: Final = {"fence": "#2e7d32", "zone": "#c62828", "waypoint": "#1565c0", "leg": "#f9a825"}
_FENCE, _ZONE, _IDLE = (0.18, 0.49, 0.2), (0.78, 0.16, 0.16), (0.5, 0.5, 0.5)
_GRAPH, _ROBOT, _TEXT = (0.4, 0.4, 0.4), (0.08, 0.4, 0.75), (0.9, 0.9, 0.9)
_SCALES: Final = {Unit.DBM: (-90.0, -50.0), Unit.SNR_DB: (0.0, 40.0)}  # weak and strong
_ABOVE_M: Final = 20.0
"""A zone without end is drawn this much higher than the flight."""


class Drawn(NamedTuple):
    """One message: its topic, the name of its schema and what it says."""

    topic: str
    schema: str
    message: Plain


class FlightDrawing:
    """Draws one mission's flight. Times are Unix seconds on the vehicle's clock."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._frame = mission.frame  # of what is drawn in metres
        self._drawn_s = -math.inf  # vehicle, drawn last
        self._vehicle: Place | None = None  # newest; east, north, up in m
        self._robots: dict[str, Point] = {}  # newest positions

    def mission(self) -> Drawn:
        """Fence, zones, waypoints and home, on a map."""
        mission = self._mission
        features = [self._area("fence", "fence", fence.corners) for fence in mission.fences]
        features += [self._area("zone", z.name, z.shape.corners) for z in mission.airspace.zones]
        features += [self._spot(f"waypoint {w.number}", w.position) for w in mission.waypoints]
        return _geojson("/mission", [*features, self._spot("home", mission.home)])

    def scene(self, unix_s: float) -> Drawn:
        """Fence, zones (those that do not apply in grey) and graph in three dimensions."""
        mission, time = self._mission, _time(unix_s)
        heights_m = [w.altitude_above_home_m for w in mission.waypoints]
        top_m = max([mission.altitude_above_home_m, *heights_m])
        entities = [
            _walls(f"fence {number}", "fence", fence.polygon, Band(0.0, top_m), _FENCE)
            for number, fence in enumerate(mission.fences, start=1)
        ]
        applying = {zone.name for zone in mission.airspace.zones}
        for zone in mission.zones:
            band = zone.band or Band()
            upper_m = min(band.upper_m, top_m + _ABOVE_M)
            drawn = Band(min(max(band.lower_m, 0.0), upper_m), upper_m)
            colour = _ZONE if zone.name in applying else _IDLE
            entities.append(
                _walls(f"zone {zone.name}", zone.name, zone.shape.polygon, drawn, colour)
            )
        entities.append(_graph(mission))
        return Drawn("/scene", SCENE, {"entities": [{"timestamp": time, **e} for e in entities]})

    def links(self, links: Mapping[str, LinkMetrics], unix_s: float) -> Iterator[Drawn]:
        """Where robots were heard of, and the links to those that are heard, by strength."""
        entities = []
        for name, position in self._robots.items():
            link = links.get(name)
            signal = None if link is None else link.signal
            words = name if signal is None else f"{name} {signal.words}"
            lines = []
            if self._vehicle is not None and signal is not None:
                ends = [self._vehicle, (*position, 0.0)]
                lines = [_line(_LIST, ends, _by_strength(signal), 3.0)]
            texts, spheres = [_text(words, (*position, 3.0))], [_ball((*position, 0.0))]
            drawn = _entity(name, spheres=spheres, lines=lines, texts=texts)
            entities.append({"timestamp": _time(unix_s), **drawn})
        if entities:
            yield Drawn("/scene/robots", SCENE, {"entities": entities})

    def event(self, event: object, unix_s: float) -> Iterator[Drawn]:
        """What is drawn of an event."""
        if isinstance(event, Telemetry):
            self._vehicle = (*event.position, event.altitude_m)
            if abs(unix_s - self._drawn_s) >= EVERY_S:
                self._drawn_s = unix_s
                above_m = (self._mission.home_altitude_amsl_m or 0.0) + event.altitude_m
                yield self._location(VEHICLE, "/vehicle", event.position, above_m, unix_s)
                yield _vehicle_pose(event, unix_s)
        elif isinstance(event, RobotPose):
            self._robots[event.robot] = event.position
            topic = f"/robots/{event.robot}"
            yield self._location(event.robot, topic, event.position, 0.0, unix_s)

    def action(self, action: object, unix_s: float) -> Iterator[Drawn]:
        """What is drawn of a decision."""
        match action:
            case FlyToNode(position=target) | FlyToPoint(position=target):
                if self._vehicle is not None:
                    here = Point(*self._vehicle[:2])
                    leg = {"type": "LineString", "coordinates": self._coordinates((here, target))}
                    yield _geojson("/leg", [_feature("leg", "leg", leg)])
            case Announce():
                yield _log(action.words, unix_s, _LEVELS[action.severity])
            case StateChanged(source=source, target=target, robot=robot):
                whom = "" if robot is None else f" ({robot})"
                yield _log(f"{source.name} -> {target.name}{whom}", unix_s)
            case MissionWaits(why=why):
                yield _log(f"waiting: {why}" if why else "going on", unix_s)

    def _location(
        self, frame: str, topic: str, place: Point, altitude_m: float, unix_s: float
    ) -> Drawn:
        ((longitude_deg, latitude_deg),) = self._coordinates((place,))
        message = {
            "timestamp": _time(unix_s),
            "frame_id": frame,
            "latitude": latitude_deg,
            "longitude": longitude_deg,
            "altitude": altitude_m,
            "position_covariance": [0.0] * 9,
            "position_covariance_type": 0,
        }
        return Drawn(f"{topic}/location", LOCATION, message)

    def _coordinates(self, points: Iterable[Point]) -> list[list[float]]:
        """Longitudes and latitudes, as GeoJSON has them."""
        try:
            return [[*reversed(self._frame.to_geodetic(point))] for point in points]
        except FrameError:  # a vehicle that has no position yet
            return [[0.0, 0.0] for _ in points]

    def _area(self, kind: str, name: str, corners: Sequence[Point]) -> Plain:
        ring = self._coordinates((*corners, corners[0]))
        return _feature(kind, name, {"type": "Polygon", "coordinates": [ring]})

    def _spot(self, name: str, place: Point) -> Plain:
        (coordinates,) = self._coordinates((place,))
        return _feature("waypoint", name, {"type": "Point", "coordinates": coordinates})


def grid(semantic_map: SemanticGrid, unix_s: float) -> Drawn:
    """The semantic map; a cell is a byte, its class."""
    columns = semantic_map.cells.shape[1]
    message = {
        "timestamp": _time(unix_s),
        "frame_id": FRAME,
        "pose": _pose((semantic_map.west_m, semantic_map.south_m, 0.0)),
        "column_count": columns,
        "cell_size": {"x": semantic_map.resolution_m, "y": semantic_map.resolution_m},
        "row_stride": columns,
        "cell_stride": 1,
        "fields": [{"name": "class", "offset": 0, "type": _UINT8}],
        "data": base64.b64encode(semantic_map.cells.tobytes()).decode("ascii"),
    }
    return Drawn("/map", GRID, message)


# JSON schemas


def schema_text(drawn: Drawn) -> str:
    """The JSON schema of a message, made from it; Foxglove knows it by its name."""
    schema = {"title": drawn.schema, **_schema_like(drawn.message)}
    if drawn.schema == GRID:
        schema["properties"]["data"]["contentEncoding"] = "base64"
    return json.dumps(schema)


def _schema_like(value: Any) -> Plain:
    if isinstance(value, dict):
        parts = {name: _schema_like(part) for name, part in value.items()}
        return {"type": "object", "properties": parts}
    if isinstance(value, list):
        return {"type": "array", "items": _schema_like(_merged(value))}
    return {"type": _TYPES.get(type(value), "number")}


def _merged(values: list[Any]) -> Any:
    """One value like all of them: of objects with every field, of their lists with every entry."""
    if not all(isinstance(value, dict) for value in values):
        return values[0]
    merged: Plain = {}
    for value in values:
        for name, part in value.items():
            merged[name] = [*merged.get(name, []), *part] if isinstance(part, list) else part
    return merged


# Parts of messages


def _geojson(topic: str, features: list[Plain]) -> Drawn:
    collection = {"type": "FeatureCollection", "features": features}
    return Drawn(topic, GEOJSON, {"geojson": json.dumps(collection)})


def _feature(kind: str, name: str, geometry: Plain) -> Plain:
    style = {"color": _COLOURS[kind], "fillOpacity": 0.2 if kind == "zone" else 0.0}
    properties = {"kind": kind, "name": name, "style": style}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _log(text: str, unix_s: float, level: int = _INFO) -> Drawn:
    where = {"name": "air_router", "file": "", "line": 0}
    message = {"timestamp": _time(unix_s), "level": level, "message": text, **where}
    return Drawn("/log", LOG, message)


def _vehicle_pose(telemetry: Telemetry, unix_s: float) -> Drawn:
    yaw_rad = math.radians(90.0 - (telemetry.heading_deg or 0.0))  # from east, to the left
    east_m, north_m = telemetry.position
    pose = {
        "position": {"x": east_m, "y": north_m, "z": telemetry.altitude_m},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(yaw_rad / 2), "w": math.cos(yaw_rad / 2)},
    }
    return Drawn(
        "/vehicle/pose", POSE, {"timestamp": _time(unix_s), "frame_id": FRAME, "pose": pose}
    )


def _graph(mission: Mission) -> Plain:
    """The waypoint graph and home."""
    graph = WaypointGraph(mission)
    legs = [
        (*graph.position(node), mission.altitude_above_home_m)
        for edge in graph.graph.edges
        for node in edge
    ]
    home: Place = (*mission.home, 0.0)
    texts = [_text("home", home)]
    texts += [
        _text(str(spot.number), (*spot.position, spot.altitude_above_home_m))
        for spot in mission.waypoints
    ]
    lines = [_line(_LIST, legs, _GRAPH, 1.0)]
    return _entity("graph", lines=lines, texts=texts, spheres=[_ball(home)])


def _walls(name: str, words: str, polygon: Polygon, band: Band, colour: Colour) -> Plain:
    """An area as its border at the top, and what hangs down from it."""
    lines, corners = [], []
    for ring in (polygon.exterior, *polygon.interiors):
        places = list(ring.coords)
        lines.append(_line(_LOOP, [(x, y, band.upper_m) for x, y in places[:-1]], colour, 2.0))
        for (x, y), (to_x, to_y) in pairwise(places):
            low, high = (x, y, band.lower_m), (x, y, band.upper_m)
            to_low, to_high = (to_x, to_y, band.lower_m), (to_x, to_y, band.upper_m)
            corners += [low, to_low, high, high, to_low, to_high]
    middle = polygon.representative_point()
    points = [_xyz(corner) for corner in corners]
    wall = {"pose": _pose(), "points": points, "color": _colour(colour, 0.25)}
    text = _text(words, (middle.x, middle.y, band.upper_m))
    return _entity(name, lines=lines, triangles=[wall], texts=[text])


def _entity(name: str, **parts: list[Plain]) -> Plain:
    kinds = ("spheres", "lines", "triangles", "texts")
    return {"frame_id": FRAME, "id": name, **{kind: parts.get(kind, []) for kind in kinds}}


def _line(kind: int, places: Sequence[Place], colour: Colour, pixels: float) -> Plain:
    return {
        "type": kind,
        "pose": _pose(),
        "thickness": pixels,
        "scale_invariant": True,
        "points": [_xyz(place) for place in places],
        "color": _colour(colour),
    }


def _ball(place: Place) -> Plain:
    size = dict.fromkeys(("x", "y", "z"), 2.0)
    return {"pose": _pose(place), "size": size, "color": _colour(_ROBOT)}


def _text(words: str, place: Place) -> Plain:
    return {
        "pose": _pose(place),
        "billboard": True,
        "font_size": 12.0,
        "scale_invariant": True,
        "color": _colour(_TEXT),
        "text": words,
    }


def _pose(place: Place = (0.0, 0.0, 0.0)) -> Plain:
    return {"position": _xyz(place), "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


def _xyz(place: Place) -> dict[str, float]:
    finite = (float(metres) if math.isfinite(metres) else 0.0 for metres in place)
    return dict(zip("xyz", finite, strict=True))


def _colour(colour: Colour, alpha: float = 1.0) -> dict[str, float]:
    return dict(zip("rgba", (*colour, alpha), strict=True))


def _by_strength(signal: Reading) -> Colour:
    """Green where it is strong, red where it is weak; blue on a scale of the device's own."""
    if signal.unit not in _SCALES:
        return _ROBOT
    weak, strong = _SCALES[signal.unit]
    strength = min(max((signal.value - weak) / (strong - weak), 0.0), 1.0)
    return (1.0 - strength, strength, 0.1)


def _time(unix_s: float) -> dict[str, int]:
    seconds = max(0, math.floor(unix_s))
    return {"sec": seconds, "nsec": min(max(0, int((unix_s - seconds) * 1e9)), 999_999_999)}
