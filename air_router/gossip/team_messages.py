"""Converts messages of other robots to events for the mission. Pure; independent of the transport.

The flight's gossip node and the experiments in simulated time use it.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Mapping
from typing import Final

from shapely import LineString

from air_router.controller.model import Event, GoTo, RobotPath, RobotPose, RobotSought
from air_router.controller.targets import SOUGHT_BY_OTHER_S
from air_router.gossip.ros_messages import Reader
from air_router.messages import (
    FARTHEST_M,
    GOALS_TOPIC,
    PATH_TOPIC,
    POSE_TOPIC,
    SEEK_TOPIC,
    GoalsMessage,
    PathMessage,
    PoseMessage,
    SeekMessage,
)
from geo.frame import FrameError, LocalFrame, Point

PATH_POINTS: Final = 64
PATH_DETAIL_M: Final = 1.0
"""A path with more points is simplified with this tolerance, doubled until it fits."""

GOALS_KEPT: Final = 64
"""Number of goal ids remembered per sender."""

_JSON: Final[Mapping[str, Reader]] = {
    POSE_TOPIC: PoseMessage.decode,
    PATH_TOPIC: PathMessage.decode,
}

PATH_READ: Final = 500
"""Of a longer path only every second (third, ...) point is used, because simplifying takes time
quadratic in the number of points."""


class TeamMessageDecoder:
    """Parses messages of robots.

    Args:
        frame: The mission's local frame, used in events.
        name: This UAV's name, to find its goals.
        goals_from: Senders whose goals are requests; others' goals are ignored.
        readers: Parsers of poses and paths, by robot and topic; None: JSON for every robot.
    """

    def __init__(
        self,
        frame: LocalFrame,
        *,
        name: str = "",
        goals_from: tuple[str, ...] = (),
        readers: Mapping[tuple[str, str], Reader] | None = None,
    ) -> None:
        self._frame = frame
        self._name = name
        self._goals_from = goals_from
        self._readers = readers
        # known ids, by sender
        self._goals: defaultdict[str, deque[str]] = defaultdict(lambda: deque(maxlen=GOALS_KEPT))

    def reads(self, robot: str, topic: str) -> bool:
        """Whether messages of a robot's topic may be events; others need no parsing."""
        if topic == GOALS_TOPIC:
            return robot in self._goals_from
        return topic == SEEK_TOPIC or self._reader(robot, topic) is not None

    def event_of(  # noqa: PLR0913 - the metadata of a message
        self,
        robot: str,
        topic: str,
        data: bytes,
        *,
        peer: str,
        unix_s: float,
        source_stamp_s: float = 0.0,
    ) -> Event | None:
        """The event of a message; None: it has none.

        A stamp is limited to the time of reception: a stamp from the future, of a wrong clock or a
        hostile robot, would make all later messages old.

        Args:
            robot: The message's author.
            topic: Its topic.
            data: Its content.
            peer: The peer that sent it.
            unix_s: Current Unix time.
            source_stamp_s: When its author's node published it, for a message without a stamp.

        Raises:
            MessageError: It does not match its topic.
            FrameError: It contains a place that is too far away.
        """
        read = self._reader(robot, topic)
        published = None if read is None else read(data)
        if isinstance(published, PoseMessage):
            place = self._near(
                self._frame.to_local(published.latitude_deg, published.longitude_deg)
            )
            return RobotPose(robot, place, min(published.stamp_s or source_stamp_s, unix_s), peer)
        if isinstance(published, PathMessage):
            stamp_s = min(published.stamp_s or source_stamp_s, unix_s)
            return RobotPath(robot, self._way(published), stamp_s) if published.points else None
        if topic == SEEK_TOPIC:
            seek = SeekMessage.decode(data)
            if unix_s - seek.stamp_s <= SOUGHT_BY_OTHER_S:  # it may have been carried for long
                return RobotSought(robot, seek.robot, min(seek.stamp_s, unix_s))
        if topic == GOALS_TOPIC and robot in self._goals_from:
            return self._request_of(robot, GoalsMessage.decode(data), unix_s)
        return None

    def _reader(self, robot: str, topic: str) -> Reader | None:
        return _JSON.get(topic) if self._readers is None else self._readers.get((robot, topic))

    def _request_of(self, robot: str, goals: GoalsMessage, unix_s: float) -> GoTo | None:
        """The request of goals, when they are first received."""
        left_s = math.inf if goals.until_s is None else goals.until_s - unix_s
        known = self._goals[robot]
        if left_s < 0.0 or goals.to not in {None, self._name} or goals.id in known:
            return None
        points = tuple(self._frame.to_local(*point) for point in goals.points)
        known.append(goals.id)
        return GoTo(points, goals.hold_s, waits=True, waits_s=left_s, by=robot, request_id=goals.id)

    def _way(self, path: PathMessage) -> tuple[Point, ...]:
        """A path in the local frame, simplified to few points."""
        every = -(-len(path.points) // PATH_READ)
        read = (*path.points[:-1:every], path.points[-1])
        latitudes_deg, longitudes_deg = zip(*read, strict=True)
        places = self._frame.to_local_many(latitudes_deg, longitudes_deg).tolist()
        way = [self._near(Point(*place)) for place in places]
        detail_m = PATH_DETAIL_M
        while len(way) > PATH_POINTS:
            way = [Point(*place) for place in LineString(way).simplify(detail_m).coords]
            detail_m *= 2
        return tuple(way)

    @staticmethod
    def _near(place: Point) -> Point:
        away_m = math.hypot(*place)
        if away_m > FARTHEST_M:
            raise FrameError(f"a place {away_m / 1000:.0f} km away")
        return place
