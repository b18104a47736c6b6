"""The gossip nodes of the simulated ground robots: what they publish, receive and hold.

Some robots may be played by the user's own programs, which their nodes are served to; the others
publish their poses and paths in the types that the team file has for them.
"""

import contextlib
import json
import logging
import queue
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final
from urllib.parse import urlsplit

from air_router.controller.model import RobotPose
from air_router.gossip import MAP_FRAME, Datum, TeamMessageDecoder, readers_of, stamp
from air_router.messages import (
    JSON_PACKAGE,
    PATH_TOPIC,
    POSE_TOPIC,
    MessageError,
    PathMessage,
    PoseMessage,
)
from air_router.mission import FIX, POSE, path_topic, pose_topic
from geo.frame import FrameError, Geodetic, LocalFrame, Point
from geo.grid import GridError, SemanticGrid
from mocha_link.clock import Clock
from mocha_link.lifetime import Closeable
from mocha_link.links import (
    Direction,
    LinkEvent,
    MessageStored,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.node import Node
from mocha_link.ros import Types
from mocha_link.service import ServiceServer
from mocha_link.store import Message
from mocha_link.team import Robot, Team, Topic
from sitl.world import Publication, Reading

_log = logging.getLogger(__name__)

MAP_TYPE: Final = "grid/SemanticMap"
MAP_HISTORY_LIMIT: Final = 100_000

EXCHANGE_S: Final = 0.5
"""Wall seconds within which an exchange ends, on a busy machine too, unless its link was cut."""


class RadioReadings(Closeable):
    """Sends readings to each robot's `radio` endpoint; robots without one get none."""

    def __init__(self, team: Team) -> None:
        self._endpoints = {  # host and port, by robot; the team file has checked their form
            robot.name: (place.hostname or "", place.port or 0)
            for robot in team.robots.values()
            if robot.radio is not None and (place := urlsplit(robot.radio))
        }
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # sends only
        self._socket.setblocking(False)

    def send_readings(self, readings: Iterable[Reading]) -> None:
        """Send readings; one that has no listener is lost, as on any radio."""
        for reading in readings:
            endpoint = self._endpoints.get(reading.robot)
            if endpoint is None:
                continue
            data = json.dumps({"peer": reading.peer, "rssi_dbm": reading.rssi_dbm}).encode()
            with contextlib.suppress(OSError):
                self._socket.sendto(data, endpoint)

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()


@dataclass(slots=True)
class MapKeeper:
    """Takes the maps that reach a robot.

    Attributes:
        newest: Who made the map in use, when, and how many of its cells are known; None: no map.
        history: (Unix seconds of the simulation, known cells) at every map that came.
        refused: Maps that could not be read.
    """

    newest: dict[str, Any] | None = None
    history: list[tuple[float, int]] = field(default_factory=list)
    refused: int = 0

    def take(self, message: Message, now_s: float) -> None:
        """Use a map message from now on; one that makes no sense is counted and left alone."""
        try:
            grid = SemanticGrid.decode(message.data)
        except GridError as error:
            self.refused += 1
            _log.warning("a map of %s makes no sense: %s", message.robot, error)
            return
        self.newest = {
            "robot": message.robot,
            "stamp_s": message.stamp_s,
            "known_cells": grid.known_cells,
        }
        if len(self.history) < MAP_HISTORY_LIMIT:
            self.history.append((now_s, grid.known_cells))


class GroundNodes(Closeable):
    """One gossip node per ground robot, each with its own sockets and thread.

    Args:
        team: Who listens where.
        names: The ground robots.
        clock: The simulation's clock, which the nodes stamp with.

    Raises:
        mocha_link.errors.MochaLinkError: a node cannot listen.
    """

    def __init__(self, team: Team, names: Iterable[str], clock: Clock) -> None:
        self._team = team
        self._arrivals: queue.SimpleQueue[tuple[str, MessageStored]] = queue.SimpleQueue()
        self._unsubscribe: list[Callable[[], object]] = []  # from each node
        # When each began, monotonic, by puller, peer and direction; set on the nodes' threads.
        self._exchanges: dict[tuple[str, str, Direction], float] = {}
        self.keepers = {name: MapKeeper() for name in names}  # the maps that reach each robot
        self.nodes: dict[str, Node] = {}
        try:
            for name in self.keepers:
                node = self.nodes[name] = Node(team, name, clock=clock)
                self._unsubscribe.append(node.subscribe(partial(self._note, name)))
                node.start()
        except BaseException:
            self.close()
            raise

    def publish(self, publications: Iterable[Publication]) -> None:
        """Let robots publish."""
        for publication in publications:
            self.nodes[publication.robot].publish(publication.topic, publication.data)

    def arrived(self) -> Iterator[tuple[str, Message]]:
        """What has reached each robot since the last call; maps of those that fly are noted.

        Each message comes once. One that a newer message has replaced by now (`history` of its
        topic) does not come.
        """
        while True:
            try:
                name, event = self._arrivals.get_nowait()
            except queue.Empty:
                return
            versions = self.nodes[name].history(event.robot, event.topic)
            message = next((each for each in versions if each.header == event.header), None)
            if message is None:
                continue
            topic = self._team.topic(event.robot, event.topic)
            if topic.type == MAP_TYPE and event.robot not in self.nodes:
                self.keepers[name].take(message, event.at_s)
            yield name, message

    @property
    def exchanging(self) -> bool:
        """Whether any robot is in an exchange that may be expected to end at once."""
        since_s = time.monotonic() - EXCHANGE_S
        return any(began_s > since_s for began_s in tuple(self._exchanges.values()))

    def close(self) -> None:
        """Stop all nodes, at the same time."""
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        if self.nodes:
            with ThreadPoolExecutor(len(self.nodes)) as pool:
                list(pool.map(lambda node: node.close(), self.nodes.values()))

    def _note(self, name: str, event: LinkEvent) -> None:
        """On the node's thread, so quick: messages are read later."""
        match event:
            case SyncStarted(peer=peer, direction=direction):
                self._exchanges[name, peer, direction] = time.monotonic()
            case (
                SyncEnded(peer=peer, direction=direction)
                | SyncTimedOut(peer=peer, direction=direction)
            ):
                self._exchanges.pop((name, peer, direction), None)
            case MessageStored(robot=robot) if robot != name:
                self._arrivals.put((name, event))


class Rovers(Closeable):
    """The nodes of such robots, served to programs; a robot is where its program reports it.

    Args:
        team: Its robots and their topics.
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
        """The reported positions of robots, by name, of those that have reported one."""
        for name, node in self._nodes.items():
            topic = self._topics[name]
            message = None if topic is None else node.latest(name, topic.name)
            if message is None:
                continue
            data = message.parts[-1] if message.parts else message.data
            try:
                event = self._decoder.event_of(name, message.topic, data, peer=name, unix_s=unix_s)
            except (MessageError, FrameError) as error:
                _log.debug("%s stays where it was: %s", name, error)
                continue
            if isinstance(event, RobotPose):
                yield name, event.position

    def close(self) -> None:
        """Serve no more."""
        self._stack.close()


class RosMessages:
    """Turns messages of simulated robots into the ROS types that the team file has for them."""

    def __init__(self, team: Team) -> None:
        self._team = team
        # None: no robot publishes ROS types.
        self._types = Types(team.definitions) if any(map(self._ros_topics, team.robots)) else None

    def topics(self, name: str) -> set[str]:
        """The topics on which a robot may publish, as the world names them."""
        return {topic.name for topic in self._team.topics_of(name)} | set(self._ros_topics(name))

    def of(self, publication: Publication) -> Publication:
        """A pose or path in the type of its robot's team file; anything else unchanged."""
        topic = self._ros_topics(publication.robot).get(publication.topic)
        if topic is None or self._types is None:
            return publication
        robot = self._team.robot(publication.robot)
        as_ros = _pose_of if publication.topic == POSE_TOPIC else _path_of
        value = as_ros(publication.data, topic, robot)
        data = self._types.encode(topic.type, value, robot.ros)
        return Publication(publication.robot, topic.name, data)

    def _ros_topics(self, name: str) -> dict[str, Topic]:
        """The topics of ROS types that stand for a robot's pose and path."""
        found = {POSE_TOPIC: pose_topic(self._team, name), PATH_TOPIC: path_topic(self._team, name)}
        return {
            own: topic
            for own, topic in found.items()
            if topic is not None and not topic.type.startswith(JSON_PACKAGE)
        }


def _pose_of(data: bytes, topic: Topic, robot: Robot) -> dict[str, Any]:
    message = PoseMessage.decode(data)
    header = _header(message.stamp_s)
    if topic.type == FIX:
        place = {"latitude": message.latitude_deg, "longitude": message.longitude_deg}
        return {"header": header, **place}
    pose = _position(robot, message.latitude_deg, message.longitude_deg)
    return {"header": header, "pose": pose if topic.type == POSE else {"pose": pose}}


def _path_of(data: bytes, _topic: Topic, robot: Robot) -> dict[str, Any]:
    message = PathMessage.decode(data)
    poses = [{"pose": _position(robot, *point)} for point in message.points]
    return {"header": _header(message.stamp_s), "poses": poses}


def _header(stamp_s: float) -> dict[str, Any]:
    return {"stamp": stamp(stamp_s), "frame_id": MAP_FRAME}


def _position(robot: Robot, latitude_deg: float, longitude_deg: float) -> dict[str, Any]:
    datum = Datum.of(robot)
    x, y = datum.to_local(Geodetic(latitude_deg, longitude_deg)) if datum else (0.0, 0.0)
    return {"position": {"x": x, "y": y}}
