"""Robots of a simulation that are played by the user's own programs, and the ROS of the others."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from typing import Any

from air_router.controller.model.events import RobotPose
from air_router.gossip.ros_messages import MAP_FRAME, Datum, readers_of, stamp
from air_router.gossip.team_messages import TeamMessageDecoder
from air_router.messages import (
    JSON_PACKAGE,
    PATH_TOPIC,
    POSE_TOPIC,
    MessageError,
    PathMessage,
    PoseMessage,
)
from air_router.mission.found_by import FIX, POSE, path_topic, pose_topic
from geo.frame import FrameError, Geodetic, LocalFrame, Point
from mocha_link.node.lifetime import Closeable
from mocha_link.node.node import Node
from mocha_link.ros.typed import Types
from mocha_link.service.service import ServiceServer
from mocha_link.team.team import Robot, Team, Topic
from sitl.world.world import Publication

_log = logging.getLogger(__name__)


class Rovers(Closeable):
    """The nodes of such robots, served to programs; a robot is where its program says.

    Args:
        team: Who says what.
        frame: The mission's.
        nodes: Those of the robots, by name; they run.
        endpoints: Where each of them is served, by its name.

    Raises:
        mocha_link.errors.MochaLinkError: an endpoint cannot be served.
    """

    def __init__(
        self,
        team: Team,
        frame: LocalFrame,
        nodes: Mapping[str, Node],
        endpoints: Mapping[str, str],
    ) -> None:
        self._decoder = TeamMessageDecoder(frame, readers=readers_of(team))
        self._nodes = {name: nodes[name] for name in endpoints}  # without the others of the team
        self._topics = {name: pose_topic(team, name) for name in endpoints}  # None: it has none
        with ExitStack() as stack:
            for name, endpoint in endpoints.items():
                served = stack.enter_context(ServiceServer(nodes[name], endpoint))
                _log.info("%s waits for its program at %s", name, served.endpoint)
            self._stack = stack.pop_all()

    def places(self, unix_s: float) -> Iterator[tuple[str, Point]]:
        """Where robots say that they are, by name, as far as they have said so."""
        for name, node in self._nodes.items():
            topic = self._topics[name]
            message = None if topic is None else node.latest(name, topic.name)
            if message is None:
                continue
            data = message.parts[-1] if message.parts else message.data
            try:
                said = self._decoder.event_of(name, message.topic, data, peer=name, unix_s=unix_s)
            except (MessageError, FrameError) as error:
                _log.debug("%s stays where it was: %s", name, error)
                continue
            if isinstance(said, RobotPose):
                yield name, said.position

    def close(self) -> None:
        """Serve no more."""
        self._stack.close()


class RosMessages:
    """Turns what simulated robots say into the types that the team file has for it."""

    def __init__(self, team: Team) -> None:
        self._team = team
        # None: no robot says anything in ROS types.
        self._types = Types(team.definitions) if any(map(self._ros_topics, team.robots)) else None

    def topics(self, name: str) -> set[str]:
        """What a robot may say, as the world calls it."""
        return {topic.name for topic in self._team.topics_of(name)} | set(self._ros_topics(name))

    def of(self, said: Publication) -> Publication:
        """A pose or path as its robot's team file has it; anything else as it is."""
        topic = self._ros_topics(said.robot).get(said.topic)
        if topic is None or self._types is None:
            return said
        robot = self._team.robot(said.robot)
        as_ros = _pose_of if said.topic == POSE_TOPIC else _path_of
        value = as_ros(said.data, topic, robot)
        data = self._types.encode(topic.type, value, robot.ros)
        return Publication(said.robot, topic.name, data)

    def _ros_topics(self, name: str) -> dict[str, Topic]:
        """The topics of ROS types that stand for a robot's pose and path."""
        found = {POSE_TOPIC: pose_topic(self._team, name), PATH_TOPIC: path_topic(self._team, name)}
        return {
            said: topic
            for said, topic in found.items()
            if topic is not None and not topic.type.startswith(JSON_PACKAGE)
        }


def _pose_of(data: bytes, topic: Topic, robot: Robot) -> dict[str, Any]:
    said = PoseMessage.decode(data)
    header = _header(said.stamp_s)
    if topic.type == FIX:
        place = {"latitude": said.latitude_deg, "longitude": said.longitude_deg}
        return {"header": header, **place}
    pose = _position(robot, said.latitude_deg, said.longitude_deg)
    return {"header": header, "pose": pose if topic.type == POSE else {"pose": pose}}


def _path_of(data: bytes, _topic: Topic, robot: Robot) -> dict[str, Any]:
    said = PathMessage.decode(data)
    poses = [{"pose": _position(robot, *point)} for point in said.points]
    return {"header": _header(said.stamp_s), "poses": poses}


def _header(stamp_s: float) -> dict[str, Any]:
    return {"stamp": stamp(stamp_s), "frame_id": MAP_FRAME}


def _position(robot: Robot, latitude_deg: float, longitude_deg: float) -> dict[str, Any]:
    datum = Datum.of(robot)
    x, y = datum.to_local(Geodetic(latitude_deg, longitude_deg)) if datum else (0.0, 0.0)
    return {"position": {"x": x, "y": y}}
