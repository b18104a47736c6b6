"""The UAV's gossip node: what it tells the team, and what the team tells the mission."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

from air_router.events import Event, RobotPath, RobotPose
from air_router.messages import (
    MAP_TOPIC,
    PATH_TOPIC,
    POSE_TOPIC,
    MessageError,
    PathMessage,
    PoseMessage,
)
from geo.frame import FrameError
from mocha_link import MetricsServer, Node
from mocha_link.metrics import LinkEvent, LinkMetrics, MessageStored

if TYPE_CHECKING:
    from pathlib import Path

    from air_router.clock import VehicleClock
    from air_router.mapper import Mapper
    from air_router.vehicle import Telemetry
    from geo.frame import LocalFrame, Point
    from mocha_link import Message, Team

_log = logging.getLogger(__name__)

POSE_INTERVAL_S: Final = 1.0
FARTHEST_M: Final = 10_000.0
"""A place farther than this from the mission's origin is not sought: no fence may be drawn that
would keep the vehicle from going there."""

MAP_INTERVAL_S: Final = 5.0
"""The map is aggregated: several patches, one database update."""


class Gossip:
    """Runs the node of the mission's UAV.

    Args:
        frame: The mission's local frame.
        team: The shared configuration.
        name: The UAV's name in it.
        clock: Stamps and ages follow the vehicle's time.
        mapper: The map to publish.
        metrics: Endpoint at which other programs may watch the links, None for none.
        keys: The folder with the UAV's secret, if the team has a key for it.

    Raises:
        UnknownRobotError: the team has no robot of the UAV's name.
        PortInUseError: from `start`.
    """

    def __init__(  # noqa: PLR0913 - what a node is put together from
        self,
        frame: LocalFrame,
        team: Team,
        name: str,
        clock: VehicleClock,
        mapper: Mapper,
        *,
        metrics: str | None = None,
        keys: Path | None = None,
    ) -> None:
        self._frame = frame
        self._mapper = mapper
        self._clock = clock
        self._name = name
        self._topics = {topic.name for topic in team.topics_of(self._name)}
        self.node = Node(team, self._name, clock=clock, keys=keys)
        self._metrics = None if metrics is None else MetricsServer(self.node, metrics)
        self._pose_at_s = float("-inf")
        self._map_at_s = float("-inf")

    def start(self, deliver: Callable[[Event], None]) -> None:
        """Open the sockets; hand link events and robots' news to `deliver` on this event loop."""
        loop = asyncio.get_running_loop()

        def from_node(event: LinkEvent) -> None:
            try:
                loop.call_soon_threadsafe(self._translate, event, deliver)
            except RuntimeError:
                _log.debug("a link event came after the flight had ended")

        self.node.subscribe(from_node)
        self.node.start()
        if self._metrics is not None:
            self._metrics.start()

    @property
    def metrics_endpoint(self) -> str | None:
        """Where the metrics are served; with port `*` known after the start."""
        return None if self._metrics is None else self._metrics.endpoint

    def links(self) -> Mapping[str, LinkMetrics]:
        """Metrics of the link to every peer."""
        return self.node.links()

    def tell(self, telemetry: Telemetry) -> None:
        """Publish pose and map when their time has come."""
        if telemetry.time_s - self._pose_at_s >= POSE_INTERVAL_S and POSE_TOPIC in self._topics:
            self._pose_at_s = telemetry.time_s
            latitude_deg, longitude_deg = self._frame.to_geodetic(telemetry.position)
            pose = PoseMessage(
                stamp_s=self._clock.now_s(),
                latitude_deg=latitude_deg,
                longitude_deg=longitude_deg,
                heading_deg=telemetry.heading_deg or 0.0,
            )
            self.node.publish(POSE_TOPIC, pose.encode())
        if telemetry.time_s - self._map_at_s >= MAP_INTERVAL_S:
            self.publish_map(telemetry.time_s)

    def publish_map(self, time_s: float) -> None:
        """Put the newest map into the database now, if it has grown."""
        if MAP_TOPIC not in self._topics:
            return
        self._map_at_s = time_s
        encoded = self._mapper.publish(time_s)
        if encoded is not None:
            self.node.publish(MAP_TOPIC, encoded, now=True)

    def newest_stamps(self) -> dict[str, float]:
        """Unix seconds of the newest message of every robot that we hold anything of."""
        newest: dict[str, float] = {}
        for message in self.node.messages():
            newest[message.robot] = max(newest.get(message.robot, 0.0), message.stamp_s)
        return newest

    def close(self) -> None:
        """Close the sockets and end the node's thread."""
        if self._metrics is not None:
            self._metrics.close()
        self.node.close()

    def _translate(self, event: LinkEvent, deliver: Callable[[Event], None]) -> None:
        deliver(event)
        if isinstance(event, MessageStored) and event.robot != self._name:
            message = self.node.latest(event.robot, event.topic)
            news = None if message is None else self._news(message, event.peer)
            if news is not None:
                deliver(news)

    def _news(self, message: Message, peer: str) -> Event | None:
        """What a stored message means to the mission; junk is logged and left alone."""
        try:
            if message.topic == POSE_TOPIC:
                pose = PoseMessage.decode(message.data)
                place = self._place(pose.latitude_deg, pose.longitude_deg)
                return RobotPose(message.robot, place, pose.stamp_s, peer)
            if message.topic == PATH_TOPIC:
                path = PathMessage.decode(message.data)
                if path.points:
                    end = self._place(*path.points[-1])
                    return RobotPath(message.robot, end, path.stamp_s)
        except (MessageError, FrameError) as error:
            _log.warning("%s %s from %s: %s", message.robot, message.topic, peer, error)
        return None

    def _place(self, latitude_deg: float, longitude_deg: float) -> Point:
        place = self._frame.to_local(latitude_deg, longitude_deg)
        away_m = math.hypot(*place)
        if away_m > FARTHEST_M:
            raise FrameError(f"{latitude_deg}, {longitude_deg} is {away_m / 1000:.0f} km away")
        return place
