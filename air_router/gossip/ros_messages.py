"""ROS messages in gossip: robots' poses and paths, and the UAV's map for them.

A robot's local frame has its origin at its `datum` in the team file. Impossible values (NaN, places
not on Earth) raise a MessageError, as with JSON.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from air_router.messages import (
    JSON_PACKAGE,
    GossipMessage,
    MessageError,
    PathMessage,
    PoseMessage,
)
from air_router.mission import FIX, LOCAL_POSES, PATH, path_topic, pose_topic
from geo.frame import FrameError, Geodetic, LocalFrame, Point
from geo.grid import SemanticGrid, Terrain
from mocha_link.errors import MissingExtraError
from mocha_link.ros import TypedError, Types
from mocha_link.team import Robot, Team

OCCUPANCY: Final = "nav_msgs/OccupancyGrid"
MAP_FRAME: Final = "map"

ROS_LIMIT_BYTES: Final = 1 << 18
"""Size of a path of 3,000 poses, which takes a tenth of a second of blocking time to parse."""

_CLOCK_SET_S: Final = 1e9
"""An earlier stamp, before 2001, comes from a clock that was never set."""

_OCCUPIED: Final = np.full(max(Terrain) + 1, 0, dtype=np.int8)
_OCCUPIED[Terrain.UNKNOWN] = -1
_OCCUPIED[Terrain.VEGETATION] = 50
_OCCUPIED[[Terrain.BUILDING, Terrain.VEHICLE, Terrain.HUMAN]] = 100
"""Probability in percent that a cell is an obstacle for a robot; -1: unknown."""

Reader = Callable[[bytes], GossipMessage | None]
"""Parses a message of a topic; None: no data for now. Raises MessageError."""


@dataclass(frozen=True, slots=True)
class Datum:
    """A robot's local frame in meters, with x rotated from east by `yaw` radians counterclockwise.

    Raises:
        FrameError: From its methods: a place is not on Earth, or too far away.
    """

    frame: LocalFrame
    yaw: float

    @classmethod
    def of(cls, robot: Robot) -> Datum | None:
        """The datum in the team file; None: there is none."""
        if robot.datum is None:
            return None
        latitude_deg, longitude_deg, *yaw_deg = robot.datum
        return cls(LocalFrame(Geodetic(latitude_deg, longitude_deg)), math.radians(sum(yaw_deg)))

    def to_geodetic(self, positions: Sequence[Any]) -> list[list[float]]:
        """Latitude and longitude of ROS positions with x and y."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        points = [(p.x * cos - p.y * sin, p.x * sin + p.y * cos) for p in positions]
        places: list[list[float]] = self.frame.to_geodetic_many(points).tolist()
        return places

    def to_local(self, place: Geodetic) -> tuple[float, float]:
        """The x and y of a place."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        east_m, north_m = self.frame.to_local(*place)
        return east_m * cos + north_m * sin, north_m * cos - east_m * sin


def readers_of(team: Team) -> dict[tuple[str, str], Reader]:
    """The parsers of poses and paths of the team's robots, by robot and topic.

    Raises:
        MissingExtraError: Some are ROS messages, and the extra `ros` is not installed.
    """
    readers: dict[tuple[str, str], Reader] = {}
    types = None
    for robot in team.robots.values():
        for topic, message in (
            (pose_topic(team, robot.name), PoseMessage),
            (path_topic(team, robot.name), PathMessage),
        ):
            if topic is not None and topic.type.startswith(JSON_PACKAGE):
                readers[robot.name, topic.name] = message.decode
            elif topic is not None:
                types = types or _types(team)
                readers[robot.name, topic.name] = _ros_reader(types, topic.type, robot)
    return readers


def occupancy_writer(team: Team, robot: str) -> Callable[[SemanticGrid, float], bytes]:
    """A function that converts the UAV's map, at a time in Unix seconds, to an OccupancyGrid.

    The grid is in the frame of the UAV's `datum`, or else in the map's own.

    Raises:
        MissingExtraError: the extra `ros` is not installed.
    """
    types, me = _types(team), team.robot(robot)
    datum = Datum.of(me)

    def write(grid: SemanticGrid, unix_s: float) -> bytes:
        values, cells = occupancy_of(grid, unix_s, datum)
        empty = types.decode(OCCUPANCY, types.encode(OCCUPANCY, values, me.ros), me.ros)
        return types.encode(OCCUPANCY, dataclasses.replace(empty, data=cells), me.ros)

    return write


def occupancy_of(
    grid: SemanticGrid, unix_s: float, datum: Datum | None = None
) -> tuple[dict[str, Any], npt.NDArray[np.int8]]:
    """A map as an OccupancyGrid, in a datum's frame or its own: plain values, and its `data`."""
    x, y, yaw = _place(grid, datum)
    rows, columns = grid.cells.shape
    info = {
        "map_load_time": stamp(unix_s),
        "resolution": grid.resolution_m,
        "width": columns,
        "height": rows,
        "origin": {
            "position": {"x": x, "y": y},
            "orientation": {"z": math.sin(yaw / 2), "w": math.cos(yaw / 2)},
        },
    }
    header = {"stamp": stamp(unix_s), "frame_id": MAP_FRAME}
    return {"header": header, "info": info}, _OCCUPIED[grid.cells].ravel()


def stamp(unix_s: float) -> dict[str, int]:
    """A ROS time."""
    seconds, part = divmod(unix_s, 1.0)
    return {"sec": int(seconds), "nanosec": int(part * 1e9)}


def _place(grid: SemanticGrid, datum: Datum | None) -> tuple[float, float, float]:
    """The grid's south-west corner and rotation in a local frame."""
    if datum is None:
        return grid.west_m, grid.south_m, 0.0
    frame, width_m = LocalFrame(grid.origin), grid.resolution_m * grid.cells.shape[1]
    x, y = datum.to_local(frame.to_geodetic(Point(grid.west_m, grid.south_m)))
    to_x, to_y = datum.to_local(frame.to_geodetic(Point(grid.west_m + width_m, grid.south_m)))
    return x, y, math.atan2(to_y - y, to_x - x)


def _types(team: Team) -> Types:
    types = Types(team.definitions)
    if not types.has_ros:
        raise MissingExtraError(f"{team.path}, with ROS messages for this UAV,", "rosbags", "ros")
    return types


def _ros_reader(types: Types, kind: str, robot: Robot) -> Reader:
    datum, convert = Datum.of(robot), _EVENT_OF[kind]

    def read(data: bytes) -> GossipMessage | None:
        if len(data) > ROS_LIMIT_BYTES:
            raise MessageError(f"{kind} of {len(data)} bytes: at most {ROS_LIMIT_BYTES} are read")
        try:
            return convert(types.decode(kind, data, robot.ros), datum)
        except (TypedError, FrameError) as error:
            raise MessageError(f"{kind}: {error}") from None

    return read


def _fix(message: Any, _datum: object) -> PoseMessage | None:
    if message.status.status < 0:  # no fix
        return None
    return PoseMessage.of(
        stamp_s=_stamp_s(message),
        latitude_deg=message.latitude,
        longitude_deg=message.longitude,
    )


def _pose(message: Any, datum: Datum) -> PoseMessage:
    pose = message.pose
    place = datum.to_geodetic([(pose if hasattr(pose, "position") else pose.pose).position])[0]
    return PoseMessage.of(stamp_s=_stamp_s(message), latitude_deg=place[0], longitude_deg=place[1])


def _path(message: Any, datum: Datum) -> PathMessage:
    points = datum.to_geodetic([stamped.pose.position for stamped in message.poses])
    return PathMessage.of(stamp_s=_stamp_s(message), points=points)


def _stamp_s(message: Any) -> float:
    """Unix seconds; 0 if the sender's clock was never set."""
    stamp = message.header.stamp
    stamp_s = float(stamp.sec) + stamp.nanosec * 1e-9
    return stamp_s if stamp_s >= _CLOCK_SET_S else 0.0


_EVENT_OF: Final[Mapping[str, Callable[[Any, Any], GossipMessage | None]]] = {
    FIX: _fix,
    **dict.fromkeys(LOCAL_POSES, _pose),
    PATH: _path,
}
