"""A flight in the messages that Foxglove's panels draw by themselves.

The names and fields are those of Foxglove's published schemas, in JSON. Nothing here is needed to
replay a flight: it is what is recorded anyway, said once more for the eye.
"""

import base64
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from air_router.controller.model.actions import Announce, FlyToNode, FlyToPoint, StateChanged
from air_router.controller.model.events import RobotPose
from air_router.mission.mission import Mission
from air_router.record.foxglove_scene import FRAME, Place, mission_entities, robot_entities
from air_router.vehicle.vehicle import Telemetry
from geo.frame import FrameError, Point
from geo.grid import SemanticGrid
from mocha_link.links.metrics import LinkMetrics

EVERY_S: Final = 0.2
"""The vehicle's place is drawn so often; its telemetry is recorded at the full rate anyway."""

VEHICLE: Final = "vehicle"

LOCATION, POSE, LOG = "foxglove.LocationFix", "foxglove.PoseInFrame", "foxglove.Log"
GEOJSON, GRID, SCENE = "foxglove.GeoJSON", "foxglove.Grid", "foxglove.SceneUpdate"

_TYPES: Final = {str: "string", int: "integer"}
_INFO: Final = 2
_UINT8: Final = 1
_COLOURS: Final = {"fence": "#2e7d32", "zone": "#c62828", "waypoint": "#1565c0", "leg": "#f9a825"}


class Drawn(NamedTuple):
    """One message: its topic, the name of its schema and what it says."""

    topic: str
    schema: str
    message: dict[str, Any]


class FoxgloveDrawing:
    """Draws one mission's flight. Times are Unix seconds on the vehicle's clock."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._frame = mission.frame  # of what is drawn in metres
        self._drawn_s = -math.inf  # vehicle, drawn last
        self._position: Point | None = None  # of the vehicle, newest
        self._vehicle: Place | None = None  # east, north, up in m
        self._robots: dict[str, Point] = {}  # newest positions

    def scene(self, unix_s: float) -> Drawn:
        """Fence, zones and graph in three dimensions."""
        entities = mission_entities(self._mission, _time(unix_s))
        return Drawn("/scene", SCENE, {"entities": entities})

    def links(self, links: Mapping[str, LinkMetrics], unix_s: float) -> Iterator[Drawn]:
        """Where robots were heard of, and how well they are heard now."""
        if self._robots:
            entities = robot_entities(self._vehicle, self._robots, links, _time(unix_s))
            yield Drawn("/scene/robots", SCENE, {"entities": entities})

    def mission(self) -> Drawn:
        """Fence, zones, waypoints and home."""
        mission = self._mission
        features = [self._area("fence", "fence", fence.corners) for fence in mission.fences]
        features += [self._area("zone", z.name, z.shape.corners) for z in mission.airspace.zones]
        for waypoint in mission.waypoints:
            features.append(self._spot(f"waypoint {waypoint.number}", waypoint.position))
        features.append(self._spot("home", mission.home))
        return _geojson("/mission", features)

    def event(self, event: object, unix_s: float) -> Iterator[Drawn]:
        """What is drawn of an event."""
        if isinstance(event, Telemetry):
            self._position = event.position
            self._vehicle = (*event.position, event.altitude_m)
            if abs(unix_s - self._drawn_s) >= EVERY_S:
                self._drawn_s = unix_s
                above_m = self._mission.home_altitude_amsl_m or 0.0
                above_m += event.altitude_m
                yield self._location(VEHICLE, "/vehicle", event.position, above_m, unix_s)
                yield self._pose(event, unix_s)
        elif isinstance(event, RobotPose):
            self._robots[event.robot] = event.position
            topic = f"/robots/{event.robot}"
            yield self._location(event.robot, topic, event.position, 0.0, unix_s)

    def action(self, action: object, unix_s: float) -> Iterator[Drawn]:
        """What is drawn of a decision."""
        match action:
            case FlyToNode(position=target) | FlyToPoint(position=target):
                if self._position is not None:
                    line = self._line("leg", (self._position, target))
                    yield _geojson("/leg", [line])
            case Announce(text=text):
                yield _log(text, unix_s)
            case StateChanged(source=source, target=target, robot=robot):
                whom = "" if robot is None else f" ({robot})"
                yield _log(f"{source.name} -> {target.name}{whom}", unix_s)

    def _location(
        self, frame: str, topic: str, place: Point, altitude_m: float, unix_s: float
    ) -> Drawn:
        latitude_deg, longitude_deg = self._degrees((place,))[0]
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

    def _pose(self, telemetry: Telemetry, unix_s: float) -> Drawn:
        yaw_rad = math.radians(90.0 - (telemetry.heading_deg or 0.0))  # from east, to the left
        east_m, north_m = telemetry.position
        pose = {
            "position": {"x": east_m, "y": north_m, "z": telemetry.altitude_m},
            "orientation": {
                "x": 0.0,
                "y": 0.0,
                "z": math.sin(yaw_rad / 2),
                "w": math.cos(yaw_rad / 2),
            },
        }
        message = {"timestamp": _time(unix_s), "frame_id": FRAME, "pose": pose}
        return Drawn("/vehicle/pose", POSE, message)

    def _degrees(self, points: Iterable[Point]) -> list[tuple[float, float]]:
        try:
            return [self._frame.to_geodetic(point) for point in points]
        except FrameError:  # a vehicle that has no position yet
            return [(0.0, 0.0)]

    def _coordinates(self, points: Iterable[Point]) -> list[list[float]]:
        return [[longitude, latitude] for latitude, longitude in self._degrees(points)]

    def _area(self, kind: str, name: str, corners: Sequence[Point]) -> dict[str, Any]:
        ring = self._coordinates((*corners, corners[0]))
        return _feature(kind, name, {"type": "Polygon", "coordinates": [ring]})

    def _line(self, kind: str, points: Sequence[Point]) -> dict[str, Any]:
        line = {"type": "LineString", "coordinates": self._coordinates(points)}
        return _feature(kind, kind, line)

    def _spot(self, name: str, place: Point) -> dict[str, Any]:
        point = {"type": "Point", "coordinates": self._coordinates((place,))[0]}
        return _feature("waypoint", name, point)


def grid(semantic_map: SemanticGrid, unix_s: float) -> Drawn:
    """The semantic map; a cell is a byte, its class."""
    origin = {
        "position": {"x": semantic_map.west_m, "y": semantic_map.south_m, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }
    columns = semantic_map.cells.shape[1]
    message = {
        "timestamp": _time(unix_s),
        "frame_id": FRAME,
        "pose": origin,
        "column_count": columns,
        "cell_size": {"x": semantic_map.resolution_m, "y": semantic_map.resolution_m},
        "row_stride": columns,
        "cell_stride": 1,
        "fields": [{"name": "class", "offset": 0, "type": _UINT8}],
        "data": base64.b64encode(semantic_map.cells.tobytes()).decode("ascii"),
    }
    return Drawn("/map", GRID, message)


def schema_text(drawn: Drawn) -> str:
    """The JSON schema of a message, made from it; Foxglove knows it by its name."""
    schema = {"title": drawn.schema, **_schema_like(drawn.message)}
    if drawn.schema == GRID:
        schema["properties"]["data"]["contentEncoding"] = "base64"
    return json.dumps(schema)


def _schema_like(value: Any) -> dict[str, Any]:
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
    merged: dict[str, Any] = {}
    for value in values:
        for name, part in value.items():
            merged[name] = [*merged.get(name, []), *part] if isinstance(part, list) else part
    return merged


def _geojson(topic: str, features: list[dict[str, Any]]) -> Drawn:
    collection = {"type": "FeatureCollection", "features": features}
    return Drawn(topic, GEOJSON, {"geojson": json.dumps(collection)})


def _feature(kind: str, name: str, geometry: dict[str, Any]) -> dict[str, Any]:
    style = {"color": _COLOURS[kind], "fillOpacity": 0.2 if kind == "zone" else 0.0}
    properties = {"kind": kind, "name": name, "style": style}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _log(text: str, unix_s: float) -> Drawn:
    where = {"name": "air_router", "file": "", "line": 0}
    return Drawn(
        "/log", LOG, {"timestamp": _time(unix_s), "level": _INFO, "message": text, **where}
    )


def _time(unix_s: float) -> dict[str, int]:
    seconds = max(0, math.floor(unix_s))
    return {"sec": seconds, "nsec": min(max(0, int((unix_s - seconds) * 1e9)), 999_999_999)}
