"""A record as a file for Rerun: positions on the map and in space, the log, and plots.

It is made of what the record has for the eye (`air_router.record.drawing`), and of telemetry and
links as numbers. Needs the extra `rerun`.
"""

import json
import math
from collections.abc import Callable
from typing import Any, Final

import rerun as rr
import rerun.blueprint as rrb

from air_router.record.log import Log

APPLICATION: Final = "air-router"
TIMELINE: Final = "time"
"""Unix time on the vehicle's clock."""

_PLOTS: Final = {
    "/event/Telemetry": ("altitude_m", "battery", "heading_deg"),
    "/links": ("signal", "bytes_in", "bytes_out", "rtt_smoothed_s"),
}
"""Numbers of a topic that are plotted; those of a link by peer."""


def rerun_recording(log: Log) -> bytes:
    """The bytes of an .rrd file, with a blueprint that shows all of it.

    Raises:
        LogError: it is no record of a flight.
    """
    recording = rr.RecordingStream(APPLICATION)
    stream = recording.binary_stream()
    recording.send_blueprint(_blueprint())
    recording.disable_timeline("log_time")  # when it was converted
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    track: list[tuple[float, float]] = []
    for channel, time_ns, message in log.messages():
        recording.set_time(TIMELINE, timestamp=time_ns / 1e9)
        _, root, *_ = channel.topic.split("/")
        draw = _DRAWN.get(channel.schema_name)
        if draw is not None:
            draw(recording, channel.topic, message)
        for name in _PLOTS.get(channel.topic, ()):
            value = message.get(name)
            if isinstance(value, dict):  # a reading of a radio
                name, value = f"{name}_{value['unit'].lower()}", value["value"]  # noqa: PLW2901
            if isinstance(value, int | float):
                peer = f"{message['peer']}/" if root == "links" else ""
                recording.log(f"plots/{name}/{peer}", rr.Scalars(value))
        if channel.topic == "/vehicle/location":
            track.append((message["latitude"], message["longitude"]))
    width = rr.Radius.ui_points(1.5)
    recording.log("map/track", rr.GeoLineStrings(lat_lon=[track], radii=width), static=True)
    data = stream.read()
    recording.disconnect()
    return data or b""


def _location(recording: rr.RecordingStream, topic: str, message: dict[str, Any]) -> None:
    place = (message["latitude"], message["longitude"])
    path = f"map{topic.removesuffix('/location')}"
    recording.log(path, rr.GeoPoints(lat_lon=[place], radii=rr.Radius.ui_points(6.0)))


def _pose(recording: rr.RecordingStream, topic: str, message: dict[str, Any]) -> None:
    pose = message["pose"]
    recording.log(
        f"world{topic.removesuffix('/pose')}",
        rr.Transform3D(
            translation=_xyz(pose["position"]),
            quaternion=rr.Quaternion(xyzw=[pose["orientation"][axis] for axis in "xyzw"]),
        ),
        rr.Points3D([(0.0, 0.0, 0.0)], radii=1.5),
    )


def _scene(recording: rr.RecordingStream, topic: str, message: dict[str, Any]) -> None:
    for entity in message["entities"]:
        path = f"world{topic}/{rr.escape_entity_path_part(entity['id'])}"
        if lines := entity["lines"]:
            strips = [strip for line in lines for strip in _strips(line)]
            colours = [_rgba(line["color"]) for line in lines for _ in _strips(line)]
            recording.log(f"{path}/lines", rr.LineStrips3D(strips, colors=colours))
        if walls := entity["triangles"]:
            corners = [_xyz(point) for wall in walls for point in wall["points"]]
            colours = [_rgba(walls[0]["color"])] * len(corners)
            mesh = rr.Mesh3D(vertex_positions=corners, vertex_colors=colours)
            recording.log(f"{path}/walls", mesh)
        labels = entity["texts"]
        places = [_xyz(text["pose"]["position"]) for text in labels]
        names = [text["text"] for text in labels]
        recording.log(f"{path}/labels", rr.Points3D(places, labels=names, radii=0.5))


def _geojson(recording: rr.RecordingStream, topic: str, message: dict[str, Any]) -> None:
    lines, colours = [], []
    for feature in json.loads(message["geojson"])["features"]:
        geometry, colour = feature["geometry"], feature["properties"]["style"]["color"]
        rings = geometry["coordinates"]
        if geometry["type"] == "LineString":
            rings = [rings]
        if geometry["type"] in ("Polygon", "LineString"):
            lines += [[(latitude, longitude) for longitude, latitude in ring] for ring in rings]
            colours += [int(colour.removeprefix("#") + "ff", 16)] * len(rings)
    recording.log(
        f"map{topic}",
        rr.GeoLineStrings(lat_lon=lines, colors=colours, radii=rr.Radius.ui_points(2.0)),
    )


_TEXT_LEVELS: Final = {
    2: rr.TextLogLevel.INFO,
    3: rr.TextLogLevel.WARN,
    4: rr.TextLogLevel.ERROR,
}
"""By the levels of Foxglove's log."""


def _log(recording: rr.RecordingStream, topic: str, message: dict[str, Any]) -> None:
    recording.log(topic, rr.TextLog(message["message"], level=_TEXT_LEVELS[message["level"]]))


_DRAWN: Final[dict[str, Callable[[rr.RecordingStream, str, dict[str, Any]], None]]] = {
    "foxglove.LocationFix": _location,
    "foxglove.PoseInFrame": _pose,
    "foxglove.SceneUpdate": _scene,
    "foxglove.GeoJSON": _geojson,
    "foxglove.Log": _log,
}


def _strips(line: dict[str, Any]) -> list[list[tuple[float, ...]]]:
    """A line as strips: a loop is one that is closed, a list is one of two points each."""
    points = [_xyz(point) for point in line["points"]]
    if line["type"] == 1:
        return [[*points, points[0]]]
    return [list(pair) for pair in zip(points[::2], points[1::2], strict=True)]


def _xyz(place: dict[str, float]) -> tuple[float, ...]:
    return tuple(place[axis] if math.isfinite(place[axis]) else 0.0 for axis in "xyz")


def _rgba(colour: dict[str, float]) -> tuple[int, ...]:
    return tuple(round(255 * colour[part]) for part in "rgba")


def _blueprint() -> rrb.Blueprint:
    plots = [
        rrb.TimeSeriesView(origin=f"/plots/{name}", name=name)
        for names in _PLOTS.values()
        for name in names
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial3DView(origin="/world", name="flight"),
                rrb.MapView(origin="/map", name="map"),
            ),
            rrb.Vertical(rrb.Tabs(*plots), rrb.TextLogView(origin="/log", name="log")),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
    )
