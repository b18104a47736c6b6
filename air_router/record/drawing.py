"""A flight in the messages that Foxglove's panels draw by themselves, of its SDK's typed schemas.

Nothing here is needed to replay a flight: it is what is recorded anyway, said once more for the
eye. In three dimensions places are metres east, north and above home. Needs the extra `foxglove`.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import Any, Final, NamedTuple

from foxglove.messages import (
    Color,
    GeoJson,
    Grid,
    LinePrimitive,
    LinePrimitiveLineType,
    LocationFix,
    Log,
    LogLevel,
    PackedElementField,
    PackedElementFieldNumericType,
    Point3,
    Pose,
    PoseInFrame,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    TextPrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector2,
    Vector3,
)
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
from air_router.record.channels import RecordChannel
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

Place = tuple[float, float, float]
Colour = tuple[float, float, float]
Plain = dict[str, Any]

_LEVELS: Final = {
    Severity.INFO: LogLevel.Info,
    Severity.WARNING: LogLevel.Warning,
    Severity.ALARM: LogLevel.Error,
}
_COLOURS: Final = {"fence": "#2e7d32", "zone": "#c62828", "waypoint": "#1565c0", "leg": "#f9a825"}
_FENCE, _ZONE, _IDLE = (0.18, 0.49, 0.2), (0.78, 0.16, 0.16), (0.5, 0.5, 0.5)
_GRAPH, _ROBOT, _TEXT = (0.4, 0.4, 0.4), (0.08, 0.4, 0.75), (0.9, 0.9, 0.9)
_SCALES: Final = {Unit.DBM: (-90.0, -50.0), Unit.SNR_DB: (0.0, 40.0)}  # weak and strong
_ABOVE_M: Final = 20.0
"""A zone without end is drawn this much higher than the flight."""


class Drawn(NamedTuple):
    """One message as it is sent; `unix_s`: when, or None for any time."""

    channel: RecordChannel
    unix_s: float | None
    data: bytes


class FlightDrawing:
    """Draws one mission's flight. Times are Unix seconds on the vehicle's clock."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._frame = mission.frame  # of what is drawn in metres
        self._drawn_s = -math.inf  # vehicle, drawn last
        self._vehicle: Place | None = None  # newest; east, north, up in m
        self._robots: dict[str, Point] = {}  # newest positions

    def begin(self, unix_s: float) -> Iterator[Drawn]:
        """Fence, zones, waypoints and home: on a map, and with the graph in three dimensions."""
        mission = self._mission
        features = [self._area("fence", "fence", fence.corners) for fence in mission.fences]
        features += [self._area("zone", z.name, z.shape.corners) for z in mission.airspace.zones]
        features += [self._spot(f"waypoint {w.number}", w.position) for w in mission.waypoints]
        yield _geojson("/mission", [*features, self._spot("home", mission.home)], None)
        yield self._scene(unix_s)

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
                lines = [_line(LinePrimitiveLineType.LineList, ends, _by_strength(signal), 3.0)]
            texts, spheres = [_text(words, (*position, 3.0))], [_ball((*position, 0.0))]
            entities.append(_entity(name, unix_s, spheres=spheres, lines=lines, texts=texts))
        if entities:
            yield _drawn("/scene/robots", SceneUpdate(entities=entities), unix_s)

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
                    yield _geojson("/leg", [_feature("leg", "leg", leg)], unix_s)
            case Announce():
                yield _log(action.words, unix_s, _LEVELS[action.severity])
            case StateChanged(source=source, target=target, robot=robot):
                whom = "" if robot is None else f" ({robot})"
                yield _log(f"{source.name} -> {target.name}{whom}", unix_s)
            case MissionWaits(why=why):
                yield _log(f"waiting: {why}" if why else "going on", unix_s)

    @staticmethod
    def grid(semantic_map: SemanticGrid, unix_s: float) -> Iterator[Drawn]:
        """The semantic map; a cell is a byte, its class."""
        columns, side_m = semantic_map.cells.shape[1], semantic_map.resolution_m
        field = PackedElementField(name="class", offset=0, type=PackedElementFieldNumericType.Uint8)
        message = Grid(
            timestamp=_time(unix_s),
            frame_id=FRAME,
            pose=_pose((semantic_map.west_m, semantic_map.south_m, 0.0)),
            column_count=columns,
            cell_size=Vector2(x=side_m, y=side_m),
            row_stride=columns,
            cell_stride=1,
            fields=[field],
            data=semantic_map.cells.tobytes(),
        )
        yield _drawn("/map", message, unix_s)

    def _scene(self, unix_s: float) -> Drawn:
        """Fence, zones (those that do not apply in grey) and graph in three dimensions."""
        mission = self._mission
        heights_m = [w.altitude_above_home_m for w in mission.waypoints]
        top_m = max([mission.altitude_above_home_m, *heights_m])
        entities = [
            _walls(f"fence {number}", "fence", fence.polygon, Band(0.0, top_m), _FENCE, unix_s)
            for number, fence in enumerate(mission.fences, start=1)
        ]
        applying = {zone.name for zone in mission.airspace.zones}
        for zone in mission.zones:
            band = zone.band or Band()
            upper_m = min(band.upper_m, top_m + _ABOVE_M)
            drawn = Band(min(max(band.lower_m, 0.0), upper_m), upper_m)
            colour = _ZONE if zone.name in applying else _IDLE
            name, polygon = zone.name, zone.shape.polygon
            entities.append(_walls(f"zone {name}", name, polygon, drawn, colour, unix_s))
        entities.append(_graph(mission, unix_s))
        return _drawn("/scene", SceneUpdate(entities=entities), unix_s)

    def _location(
        self, frame: str, topic: str, place: Point, altitude_m: float, unix_s: float
    ) -> Drawn:
        ((longitude_deg, latitude_deg),) = self._coordinates((place,))
        message = LocationFix(
            timestamp=_time(unix_s),
            frame_id=frame,
            latitude=latitude_deg,
            longitude=longitude_deg,
            altitude=altitude_m,
        )
        return _drawn(f"{topic}/location", message, unix_s)

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


# Messages, and their parts


@cache
def _channel(topic: str, kind: Any) -> RecordChannel:
    schema = kind.get_schema()
    return RecordChannel(topic, schema.name, schema.data, "protobuf")


def _drawn(topic: str, message: Any, unix_s: float | None) -> Drawn:
    kind: Any = type(message)
    return Drawn(_channel(topic, kind), unix_s, message.encode())


def _geojson(topic: str, features: list[Plain], unix_s: float | None) -> Drawn:
    collection = {"type": "FeatureCollection", "features": features}
    return _drawn(topic, GeoJson(geojson=json.dumps(collection)), unix_s)


def _feature(kind: str, name: str, geometry: Plain) -> Plain:
    style = {"color": _COLOURS[kind], "fillOpacity": 0.2 if kind == "zone" else 0.0}
    properties = {"kind": kind, "name": name, "style": style}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _log(text: str, unix_s: float, level: LogLevel = LogLevel.Info) -> Drawn:
    message = Log(timestamp=_time(unix_s), level=level, message=text, name="air_router")
    return _drawn("/log", message, unix_s)


def _vehicle_pose(telemetry: Telemetry, unix_s: float) -> Drawn:
    yaw_rad = math.radians(90.0 - (telemetry.heading_deg or 0.0))  # from east, to the left
    turned = Quaternion(x=0.0, y=0.0, z=math.sin(yaw_rad / 2), w=math.cos(yaw_rad / 2))
    pose = _pose((*telemetry.position, telemetry.altitude_m), turned)
    message = PoseInFrame(timestamp=_time(unix_s), frame_id=FRAME, pose=pose)
    return _drawn("/vehicle/pose", message, unix_s)


def _graph(mission: Mission, unix_s: float) -> SceneEntity:
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
    lines = [_line(LinePrimitiveLineType.LineList, legs, _GRAPH, 1.0)]
    return _entity("graph", unix_s, lines=lines, texts=texts, spheres=[_ball(home)])


def _walls(  # noqa: PLR0913, PLR0917 - all that is seen of an area
    name: str, words: str, polygon: Polygon, band: Band, colour: Colour, unix_s: float
) -> SceneEntity:
    """An area as its border at the top, and what hangs down from it."""
    lines, corners = [], []
    for ring in (polygon.exterior, *polygon.interiors):
        places = list(ring.coords)
        border = [(x, y, band.upper_m) for x, y in places[:-1]]
        lines.append(_line(LinePrimitiveLineType.LineLoop, border, colour, 2.0))
        for (x, y), (to_x, to_y) in pairwise(places):
            low, high = (x, y, band.lower_m), (x, y, band.upper_m)
            to_low, to_high = (to_x, to_y, band.lower_m), (to_x, to_y, band.upper_m)
            corners += [low, to_low, high, high, to_low, to_high]
    middle = polygon.representative_point()
    points = [_point(corner) for corner in corners]
    wall = TriangleListPrimitive(pose=_pose(), points=points, color=_colour(colour, 0.25))
    text = _text(words, (middle.x, middle.y, band.upper_m))
    return _entity(name, unix_s, lines=lines, triangles=[wall], texts=[text])


def _entity(name: str, unix_s: float, **parts: list[Any]) -> SceneEntity:
    return SceneEntity(timestamp=_time(unix_s), frame_id=FRAME, id=name, **parts)


def _line(
    kind: LinePrimitiveLineType, places: Sequence[Place], colour: Colour, pixels: float
) -> LinePrimitive:
    return LinePrimitive(
        type=kind,
        pose=_pose(),
        thickness=pixels,
        scale_invariant=True,
        points=[_point(place) for place in places],
        color=_colour(colour),
    )


def _ball(place: Place) -> SpherePrimitive:
    size = Vector3(x=2.0, y=2.0, z=2.0)
    return SpherePrimitive(pose=_pose(place), size=size, color=_colour(_ROBOT))


def _text(words: str, place: Place) -> TextPrimitive:
    return TextPrimitive(
        pose=_pose(place),
        billboard=True,
        font_size=12.0,
        scale_invariant=True,
        color=_colour(_TEXT),
        text=words,
    )


def _pose(place: Place = (0.0, 0.0, 0.0), turned: Quaternion | None = None) -> Pose:
    position = Vector3(**dict(zip("xyz", _finite(place), strict=True)))
    return Pose(position=position, orientation=turned or Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))


def _point(place: Place) -> Point3:
    return Point3(**dict(zip("xyz", _finite(place), strict=True)))


def _finite(place: Place) -> Iterator[float]:
    return (float(metres) if math.isfinite(metres) else 0.0 for metres in place)


def _colour(colour: Colour, alpha: float = 1.0) -> Color:
    return Color(**dict(zip("rgb", colour, strict=True)), a=alpha)


def _by_strength(signal: Reading) -> Colour:
    """Green where it is strong, red where it is weak; blue on a scale of the device's own."""
    if signal.unit not in _SCALES:
        return _ROBOT
    weak, strong = _SCALES[signal.unit]
    strength = min(max((signal.value - weak) / (strong - weak), 0.0), 1.0)
    return (1.0 - strength, strength, 0.1)


def _time(unix_s: float) -> Timestamp:
    """A time as the SDK can hold it, its seconds in 32 bits: a vehicle may say any date."""
    seconds = min(max(0, math.floor(unix_s)), 2**32 - 1)
    return Timestamp(sec=seconds, nsec=min(max(0, int((unix_s - seconds) * 1e9)), 999_999_999))
