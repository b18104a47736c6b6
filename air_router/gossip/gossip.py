"""The UAV's gossip node: publishes to the team, and receives messages for the mission."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from air_router.control import COSTLY_AT_ONCE, COSTLY_PER_S, Budget
from air_router.controller.model import CommandAck, Event, GoTo, PeerFault, Refusal
from air_router.gossip.mapper import Mapper
from air_router.gossip.ros_messages import OCCUPANCY, occupancy_writer, readers_of
from air_router.gossip.team_messages import TeamMessageDecoder
from air_router.messages import (
    ANSWERS_TOPIC,
    GOALS_TOPIC,
    MAP_TOPIC,
    POSE_TOPIC,
    SEEK_TOPIC,
    AnswerMessage,
    GoalsHead,
    MessageError,
    PoseMessage,
    SeekMessage,
)
from air_router.mission import pose_topic
from air_router.vehicle import Telemetry, VehicleClock
from geo.frame import FrameError, LocalFrame
from mocha_link import Message, MetricsServer, Node, Team
from mocha_link.links import Direction, LinkEvent, LinkMetrics, MessageStored, SyncEnded
from mocha_link.sanitize import sanitize

_log = logging.getLogger(__name__)

POSE_INTERVAL_S: Final = 1.0
MAP_INTERVAL_S: Final = 5.0
"""The map is aggregated: one database update for several patches."""


SILENT_SYNCS: Final = 5
"""A robot that was synced with this often without publishing a pose is announced."""

SEEK_INTERVAL_S: Final = 30.0
"""The sought robot is published repeatedly: peers use it only for some minutes."""


class Gossip:
    """Runs the node of the mission's UAV.

    Args:
        frame: The mission's local frame.
        team: The shared configuration.
        name: The UAV's name in it.
        clock: The vehicle's clock, for stamps and ages.
        mapper: The map to publish.
        metrics: Endpoint with link metrics for other programs; None: none.
        keys: The folder with the UAV's secret key, if the team has a key for it.
        goals_from: Senders whose goals are requests to the mission.
        node: Used instead of a new node; a rehearsal's has no sockets.

    Raises:
        UnknownRobotError: The team has no robot with the UAV's name.
        MissingExtraError: The team's ROS messages need the extra `ros`.
        PortInUseError: from `start`.
    """

    def __init__(  # noqa: PLR0913 - the parts of a node
        self,
        frame: LocalFrame,
        team: Team,
        name: str,
        clock: VehicleClock,
        mapper: Mapper,
        *,
        metrics: str | None = None,
        keys: Path | None = None,
        goals_from: tuple[str, ...] = (),
        node: Node | None = None,
    ) -> None:
        self._frame = frame
        self._reader = TeamMessageDecoder(
            frame, name=name, goals_from=goals_from, readers=readers_of(team)
        )
        self._goals_from = goals_from
        self._mapper = mapper
        self._clock = clock
        self._name = name
        topics = team.topics_of(name)
        self._topics = {topic.name for topic in topics}  # names of this UAV's own topics
        # OccupancyGrid: the map for ROS
        self._grid_topics = [topic.name for topic in topics if topic.type == OCCUPANCY]
        # makes such a message
        self._grid_of = occupancy_writer(team, name) if self._grid_topics else None
        self._unreadable: set[tuple[str, str]] = set()  # robot and topic, announced once
        # topic with the robot's position
        self._found_by = {peer: pose_topic(team, peer) for peer in team.robot(name).peers}
        self._met: Counter[str] = Counter()  # syncs ended, by robot
        self.node = node or Node(team, self._name, clock=clock, keys=keys)
        self._metrics = None if metrics is None else MetricsServer(self.node, metrics)
        self._pose_at_s = float("-inf")  # published last, vehicle's clock
        self._map_at_s = float("-inf")  # published last, vehicle's clock
        self._budget = Budget(COSTLY_PER_S, COSTLY_AT_ONCE)
        self._goals: dict[str, GoTo] = {}  # over the budget; the newest of each sender
        self._deliver: Callable[[Event], None]  # to the flight; set by `run`
        self._sought: str | None = None  # published repeatedly
        self._seek_at_s = float("inf")  # nothing is published before a robot is sought

    def start(self, deliver: Callable[[Event], None]) -> None:
        """Open the sockets; pass link events and messages to `deliver` on this event loop."""
        loop = asyncio.get_running_loop()
        self._deliver = deliver

        def from_node(event: LinkEvent) -> None:
            try:
                loop.call_soon_threadsafe(self._translate, event)
            except RuntimeError:
                _log.debug("a link event was received after the end of the flight")

        self.node.subscribe(from_node)
        self.node.start()
        if self._metrics is not None:
            self._metrics.start()

    def links(self) -> Mapping[str, LinkMetrics]:
        """Metrics of the link to every peer."""
        return self.node.links()

    def held(self) -> dict[str, dict[tuple[str, str], float]]:
        """The messages that every peer is known to hold; see `Node.held`."""
        return {peer: self.node.held(peer) for peer in self.node.robot.peers}

    def publish_telemetry(self, telemetry: Telemetry) -> None:
        """Publish pose and map when they are due."""
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
        if telemetry.time_s - self._seek_at_s >= SEEK_INTERVAL_S:
            self.publish_sought(self._sought, telemetry.time_s)
        self._deliver_goals()

    def publish_sought(self, robot: str | None, time_s: float) -> None:
        """Publish which robot this UAV seeks; None: none."""
        self._sought, self._seek_at_s = robot, time_s
        if SEEK_TOPIC not in self._topics:
            return
        message = SeekMessage(stamp_s=self._clock.now_s(), robot=robot)
        self.node.publish(SEEK_TOPIC, message.encode(), now=True)

    def publish_ack(self, answer: CommandAck) -> None:
        """Publish the answer to a base station's goals."""
        if ANSWERS_TOPIC not in self._topics or answer.by not in self._goals_from:
            return
        message = AnswerMessage(
            stamp_s=self._clock.now_s(),
            to=answer.by,
            id=answer.request_id,
            accepted=answer.accepted,
            why=answer.why[:2_000],
            code=answer.code,
        )
        self.node.publish(ANSWERS_TOPIC, message.encode(), now=True)

    def publish_map(self, time_s: float) -> None:
        """Publish the newest map now, if it has grown."""
        if MAP_TOPIC not in self._topics and not self._grid_topics:
            return
        self._map_at_s = time_s
        encoded = self._mapper.publish(time_s)
        if encoded is None:
            return
        if MAP_TOPIC in self._topics:
            self.node.publish(MAP_TOPIC, encoded, now=True)
        if self._grid_of is not None:
            grid = self._grid_of(self._mapper.grid, self._clock.now_s())
            for topic in self._grid_topics:
                self.node.publish(topic, grid, now=True)

    def exchange(self) -> None:
        """Sync with the sought robot in both directions now, ahead of the timers."""
        if self._sought in self.node.robot.peers:
            self.node.sync(self._sought, both=True)

    def newest_stamps(self) -> dict[str, float]:
        """Unix time of the newest message of every robot that the node holds messages of."""
        newest: dict[str, float] = {}
        for message in self.node.messages():
            newest[message.robot] = max(newest.get(message.robot, 0.0), message.stamp_s)
        return newest

    def close(self) -> None:
        """Close the sockets and end the node's thread."""
        if self._metrics is not None:
            self._metrics.close()
        self.node.close()

    def _translate(self, event: LinkEvent) -> None:
        self._deliver(event)
        if isinstance(event, SyncEnded) and event.direction is Direction.IN:
            self._note_silence(event.peer)
        if not isinstance(event, MessageStored) or event.robot == self._name:
            return
        if self._reader.reads(event.robot, event.topic):  # a map takes long to decompress
            message = self.node.latest(event.robot, event.topic)
            found = None if message is None else self._event_of(message, event.peer)
            if isinstance(found, GoTo):
                self._defer_goals(found)
                self._deliver_goals()
            elif found is not None:
                self._deliver(found)

    def _note_silence(self, peer: str) -> None:
        """Announce once that a robot in contact publishes no pose."""
        topic = self._found_by.get(peer)
        self._met[peer] += 1
        if self._met[peer] != SILENT_SYNCS or topic is None:
            return
        if self.node.latest(peer, topic.name) is None:
            words = (
                f"{peer} was synced with {SILENT_SYNCS} times but published nothing on "
                f"{topic.name} ({topic.type}), by which it would be found"
            )
            self._deliver(PeerFault(words))

    def _defer_goals(self, request: GoTo) -> None:
        """Keep goals until the budget affords them, and answer those that they replace."""
        before, self._goals[request.by] = self._goals.get(request.by), request
        if before is not None:
            self.publish_ack(CommandAck.replaced(before.request_id, before.by))

    def _deliver_goals(self) -> None:
        """Deliver goals within the budget for routes; of one sender only the newest."""
        for robot, request in list(self._goals.items()):
            if self._budget.affords_routes(len(request.points)):
                del self._goals[robot]
                self._deliver(request)

    def _refuse(self, robot: str, data: bytes, why: str) -> None:
        """Refuse unreadable goals, if they have an id and are for this UAV."""
        with contextlib.suppress(MessageError):
            goals = GoalsHead.decode(data)
            if goals.to in {None, self._name}:
                self.publish_ack(CommandAck(goals.id, robot, False, why, Refusal.NOT_READ))

    def _event_of(self, message: Message, peer: str) -> Event | None:
        """The event of a stored message; an unreadable one is announced once and ignored."""
        data = message.parts[-1] if message.parts else message.data  # the newest of several
        try:
            return self._reader.event_of(
                message.robot,
                message.topic,
                data,
                peer=peer,
                unix_s=self._clock.now_s(),
                source_stamp_s=message.stamp_s,
            )
        except (MessageError, FrameError) as error:
            if message.topic == GOALS_TOPIC:
                self._refuse(message.robot, data, str(error))
            words = sanitize(
                f"{message.topic} of {message.robot} cannot be read and is ignored "
                f"(announced once): {error}"
            )
            reported = (message.robot, message.topic) in self._unreadable
            self._unreadable.add((message.robot, message.topic))
            _log.debug(words)
            return None if reported else PeerFault(words)
