"""A flight as messages with Foxglove's typed schemas, which its panels draw without settings.

A replay does not need them: they only visualize recorded values. 3D positions are meters east,
north and above home. Needs the extra `foxglove`.
"""

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from functools import cache, singledispatchmethod
from itertools import pairwise
from typing import Any, Final

from foxglove import messages as fg
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

VEHICLE_S, LINKS_S, GRID_S = 0.2, 1.0, 30.0
"""Intervals of drawing the vehicle's position, the links, and the growing map. Telemetry is
recorded at the full rate in any case."""

VEHICLE: Final = "vehicle"
FRAME: Final = "mission"
"""Meters east, north and up of the mission's origin; everything on the map also has a frame."""

Place = tuple[float, float, float]
Colour = tuple[float, float, float]
Plain = dict[str, Any]

_LEVELS: Final = {
    Severity.INFO: fg.LogLevel.Info,
    Severity.WARNING: fg.LogLevel.Warning,
    Severity.ALARM: fg.LogLevel.Error,
}
_LIST, _LOOP = fg.LinePrimitiveLineType.LineList, fg.LinePrimitiveLineType.LineLoop
_COLOURS: Final = {"fence": "#2e7d32", "zone": "#c62828", "waypoint": "#1565c0", "leg": "#f9a825"}
_FENCE, _ZONE, _IDLE = (0.18, 0.49, 0.2), (0.78, 0.16, 0.16), (0.5, 0.5, 0.5)
_GRAPH, _ROBOT, _TEXT = (0.4, 0.4, 0.4), (0.08, 0.4, 0.75), (0.9, 0.9, 0.9)
_SCALES: Final = {Unit.DBM: (-90.0, -50.0), Unit.SNR_DB: (0.0, 40.0)}  # weak and strong
_ABOVE_M: Final = 20.0
"""A zone without an upper limit is drawn this much higher than the flight."""


Drawn = tuple[RecordChannel, bytes]
"""A drawn message, and its channel."""


class FlightDrawing:
    """Draws one mission's flight, live or from its record."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._frame = mission.frame  # of drawings in meters
        self._done_s: dict[float, float] = {}  # Unix times, by interval
        self._vehicle: Place | None = None  # newest; east, north, up in m
        self._robots: dict[str, Point] = {}  # newest positions
        self._links: dict[str, LinkMetrics] = {}  # newest, by peer

    def begin(self, unix_s: float) -> Iterator[Drawn]:
        """Fence, zones, waypoints and home on a map, and with the graph in 3D."""
        mission = self._mission
        features = [self._area("fence", "fence", fence.corners) for fence in mission.fences]
        features += [self._area("zone", z.name, z.shape.corners) for z in mission.airspace.zones]
        features += [self._spot(f"waypoint {w.number}", w.position) for w in mission.waypoints]
        yield _geojson("/mission", [*features, self._spot("home", mission.home)])
        yield self._scene(unix_s)

    @singledispatchmethod
    def draw(self, value: object, unix_s: float) -> Iterator[Drawn]:
        """The drawing of an event, an action, a link or the map, at the vehicle's time."""
        del value, unix_s
        return iter(())

    @draw.register
    def _(self, value: Telemetry, unix_s: float) -> Iterator[Drawn]:
        self._vehicle = (*value.position, value.altitude_m)
        if self._due(VEHICLE_S, unix_s):
            above_m = (self._mission.home_altitude_amsl_m or 0.0) + value.altitude_m
            yield self._location(VEHICLE, "/vehicle", value.position, above_m, unix_s)
            yield _vehicle_pose(value, unix_s)
        if self._robots and self._due(LINKS_S, unix_s):
            yield self._team(unix_s)

    @draw.register
    def _(self, value: RobotPose, unix_s: float) -> Iterator[Drawn]:
        self._robots[value.robot] = value.position
        yield self._location(value.robot, f"/robots/{value.robot}", value.position, 0.0, unix_s)

    @draw.register
    def _(self, value: LinkMetrics, unix_s: float) -> Iterator[Drawn]:
        self._links[value.peer] = value
        if self._robots:
            yield self._team(unix_s)

    @draw.register
    def _(self, value: SemanticGrid, unix_s: float) -> Iterator[Drawn]:
        if self._due(GRID_S, unix_s):
            yield _grid(value, unix_s)

    @draw.register(FlyToNode)
    @draw.register(FlyToPoint)
    def _(self, value: FlyToNode | FlyToPoint, _unix_s: float) -> Iterator[Drawn]:
        if self._vehicle is not None:
            ends = Point(*self._vehicle[:2]), value.position
            leg = {"type": "LineString", "coordinates": self._coordinates(ends)}
            yield _geojson("/leg", [_feature("leg", "leg", leg)])

    @draw.register
    def _(self, value: Announce, unix_s: float) -> Iterator[Drawn]:
        yield _log(value.words, unix_s, _LEVELS[value.severity])

    @draw.register
    def _(self, value: StateChanged, unix_s: float) -> Iterator[Drawn]:
        whom = "" if value.robot is None else f" ({value.robot})"
        yield _log(f"{value.source.name} -> {value.target.name}{whom}", unix_s)

    @draw.register
    def _(self, value: MissionWaits, unix_s: float) -> Iterator[Drawn]:
        yield _log(f"waiting: {value.why}" if value.why else "going on", unix_s)

    def _due(self, every_s: float, unix_s: float) -> bool:
        """Whether something is due to be drawn; it then counts as drawn."""
        due = abs(unix_s - self._done_s.get(every_s, -math.inf)) >= every_s
        if due:
            self._done_s[every_s] = unix_s
        return due

    def _team(self, unix_s: float) -> Drawn:
        """Reported positions of robots, and the links colored by signal strength."""
        entities = []
        for name, position in self._robots.items():
            link = self._links.get(name)
            signal = None if link is None else link.signal
            text = name if signal is None else f"{name} {signal.text}"
            lines = []
            if self._vehicle is not None and signal is not None:
                ends = [self._vehicle, (*position, 0.0)]
                lines = [_line(_LIST, ends, _by_strength(signal), 3.0)]
            texts, spheres = [_text(text, (*position, 3.0))], [_ball((*position, 0.0))]
            entities.append(_entity(name, unix_s, spheres=spheres, lines=lines, texts=texts))
        return _drawn("/scene/robots", fg.SceneUpdate(entities=entities))

    def _scene(self, unix_s: float) -> Drawn:
        """Fence, zones (gray if they do not apply) and graph in 3D."""
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
        return _drawn("/scene", fg.SceneUpdate(entities=entities))

    def _location(
        self, frame: str, topic: str, place: Point, altitude_m: float, unix_s: float
    ) -> Drawn:
        ((longitude_deg, latitude_deg),) = self._coordinates((place,))
        message = fg.LocationFix(
            timestamp=_time(unix_s),
            frame_id=frame,
            latitude=latitude_deg,
            longitude=longitude_deg,
            altitude=altitude_m,
        )
        return _drawn(f"{topic}/location", message)

    def _coordinates(self, points: Iterable[Point]) -> list[list[float]]:
        """Longitudes and latitudes for GeoJSON."""
        try:
            return [[*reversed(self._frame.to_geodetic(point))] for point in points]
        except FrameError:  # a vehicle without a position yet
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


def _drawn(topic: str, message: Any) -> Drawn:
    kind: Any = type(message)
    return _channel(topic, kind), message.encode()


def _geojson(topic: str, features: list[Plain]) -> Drawn:
    collection = {"type": "FeatureCollection", "features": features}
    return _drawn(topic, fg.GeoJson(geojson=json.dumps(collection)))


def _feature(kind: str, name: str, geometry: Plain) -> Plain:
    style = {"color": _COLOURS[kind], "fillOpacity": 0.2 if kind == "zone" else 0.0}
    properties = {"kind": kind, "name": name, "style": style}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def _grid(semantic_map: SemanticGrid, unix_s: float) -> Drawn:
    """The semantic map; each cell is a byte with its class."""
    columns, side_m = semantic_map.cells.shape[1], semantic_map.resolution_m
    byte = fg.PackedElementFieldNumericType.Uint8
    message = fg.Grid(
        timestamp=_time(unix_s),
        frame_id=FRAME,
        pose=_pose((semantic_map.west_m, semantic_map.south_m, 0.0)),
        column_count=columns,
        cell_size=fg.Vector2(x=side_m, y=side_m),
        row_stride=columns,
        cell_stride=1,
        fields=[fg.PackedElementField(name="class", offset=0, type=byte)],
        data=semantic_map.cells.tobytes(),
    )
    return _drawn("/map", message)


def _log(text: str, unix_s: float, level: fg.LogLevel = fg.LogLevel.Info) -> Drawn:
    message = fg.Log(timestamp=_time(unix_s), level=level, message=text, name="air_router")
    return _drawn("/log", message)


def _vehicle_pose(telemetry: Telemetry, unix_s: float) -> Drawn:
    yaw_rad = math.radians(90.0 - (telemetry.heading_deg or 0.0))  # from east, to the left
    pose = _pose((*telemetry.position, telemetry.altitude_m), yaw_rad)
    message = fg.PoseInFrame(timestamp=_time(unix_s), frame_id=FRAME, pose=pose)
    return _drawn("/vehicle/pose", message)


def _graph(mission: Mission, unix_s: float) -> fg.SceneEntity:
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
    return _entity("graph", unix_s, lines=lines, texts=texts, spheres=[_ball(home)])


def _walls(  # noqa: PLR0913, PLR0917 - all visible parts of an area
    name: str, text: str, polygon: Polygon, band: Band, colour: Colour, unix_s: float
) -> fg.SceneEntity:
    """An area as its upper border with walls below."""
    lines, corners = [], []
    for ring in (polygon.exterior, *polygon.interiors):
        places = list(ring.coords)
        border = [(x, y, band.upper_m) for x, y in places[:-1]]
        lines.append(_line(_LOOP, border, colour, 2.0))
        for (x, y), (to_x, to_y) in pairwise(places):
            low, high = (x, y, band.lower_m), (x, y, band.upper_m)
            to_low, to_high = (to_x, to_y, band.lower_m), (to_x, to_y, band.upper_m)
            corners += [low, to_low, high, high, to_low, to_high]
    middle = polygon.representative_point()
    points = [fg.Point3(**_xyz(corner)) for corner in corners]
    wall = fg.TriangleListPrimitive(pose=_pose(), points=points, color=_colour(colour, 0.25))
    label = _text(text, (middle.x, middle.y, band.upper_m))
    return _entity(name, unix_s, lines=lines, triangles=[wall], texts=[label])


def _entity(name: str, unix_s: float, **parts: list[Any]) -> fg.SceneEntity:
    return fg.SceneEntity(timestamp=_time(unix_s), frame_id=FRAME, id=name, **parts)


def _line(
    kind: fg.LinePrimitiveLineType, places: Sequence[Place], colour: Colour, pixels: float
) -> fg.LinePrimitive:
    return fg.LinePrimitive(
        type=kind,
        pose=_pose(),
        thickness=pixels,
        scale_invariant=True,
        points=[fg.Point3(**_xyz(place)) for place in places],
        color=_colour(colour),
    )


def _ball(place: Place) -> fg.SpherePrimitive:
    size = fg.Vector3(x=2.0, y=2.0, z=2.0)
    return fg.SpherePrimitive(pose=_pose(place), size=size, color=_colour(_ROBOT))


def _text(text: str, place: Place) -> fg.TextPrimitive:
    return fg.TextPrimitive(
        pose=_pose(place),
        billboard=True,
        font_size=12.0,
        scale_invariant=True,
        color=_colour(_TEXT),
        text=text,
    )


def _pose(place: Place = (0.0, 0.0, 0.0), yaw_rad: float = 0.0) -> fg.Pose:
    turned = fg.Quaternion(x=0.0, y=0.0, z=math.sin(yaw_rad / 2), w=math.cos(yaw_rad / 2))
    return fg.Pose(position=fg.Vector3(**_xyz(place)), orientation=turned)


def _xyz(place: Place) -> dict[str, float]:
    finite = (float(metres) if math.isfinite(metres) else 0.0 for metres in place)
    return dict(zip("xyz", finite, strict=True))


def _colour(colour: Colour, alpha: float = 1.0) -> fg.Color:
    return fg.Color(**dict(zip("rgb", colour, strict=True)), a=alpha)


def _by_strength(signal: Reading) -> Colour:
    """Green if strong, red if weak; blue on a device-specific scale."""
    if signal.unit not in _SCALES:
        return _ROBOT
    weak, strong = _SCALES[signal.unit]
    strength = min(max((signal.value - weak) / (strong - weak), 0.0), 1.0)
    return (1.0 - strength, strength, 0.1)


def _time(unix_s: float) -> fg.Timestamp:
    """A time limited to the SDK's 32-bit seconds: a vehicle may report any date."""
    seconds = min(max(0, math.floor(unix_s)), 2**32 - 1)
    return fg.Timestamp(sec=seconds, nsec=min(max(0, int((unix_s - seconds) * 1e9)), 999_999_999))
