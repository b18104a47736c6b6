"""A ground robot that comes to meet: it goes back to where it last had contact with a UAV.

Where a robot and a UAV last received each other is known to both without a further message: the UAV
keeps it (`TargetTrack.radio`), and the robot was there. When the robot has had no contact for a
while, it makes a detour there and waits. It announces place and time as it announces every drive,
by its path, which peers carry; so a UAV that seeks by paths comes there, too.

    value = p * age,   p = (kept + 1) / (made + 2)

It goes if value / (detour + wait) is at least `WORTH`: seconds of age for each second of its time.
`age` is the time since its last contact, `p` the expected probability of a link there, by how many
of the meetings that it went to came about. A meeting costs time and the goal that it was on its way
to, which goes back to the team.
"""

from __future__ import annotations

import math
from typing import Final

from air_router.messages import MAP_TOPIC, POSE_TOPIC, MessageError, PoseMessage
from geo.frame import Point
from sitl.robot_policies import Drive, RobotView

DUE_S: Final = 180.0
"""A contact is missed after so long: a UAV seeks three robots within about that time."""

WAIT_S: Final = 60.0
"""It waits so long at a place."""

MOST_DETOUR_S: Final = 180.0
"""A place that is farther is not driven to."""

WORTH: Final = 1.0

DIRECT_S: Final = 5.0
"""A pose that is no older on its arrival than the freshest ever, and so much, came from the UAV
itself and not through others: clocks need not agree."""

PAUSE_S: Final = 120.0
"""After a meeting in vain it looks for goals for so long at least."""


class Meets:
    """Goes back to where it last had contact when that was long ago."""

    def __init__(self) -> None:
        self._contact: tuple[Point, float] | None = None  # the last: where, and when
        self._seen: dict[str, float] = {}  # when the newest pose of each UAV arrived
        self._least_s: dict[str, float] = {}  # of each UAV: arrival less stamp, at least
        self._meeting: tuple[Point, float] | None = None  # where, and until when
        self._pause_s = -math.inf  # no meeting before that
        self._made = self._kept = 0  # meetings that are over, and those that came about

    def choose(self, view: RobotView) -> Drive | None:
        """As `RobotPolicy.choose`."""
        if self._in_contact(view):
            self._contact = view.position, view.now_s
            if self._meeting is not None:
                self._end(view, kept=True)
        if self._contact is None:
            return None
        if self._meeting is None:
            self._plan(view, *self._contact)
        elif view.now_s > self._meeting[1]:
            self._end(view, kept=False)
        return None if self._meeting is None else Drive(self._meeting[0])

    @property
    def expected(self) -> float:
        """How probable a link is where it goes to meet."""
        return (self._kept + 1) / (self._made + 2)

    def _in_contact(self, view: RobotView) -> bool:
        """Whether a UAV's pose has arrived from itself since the last time."""
        direct = False
        uavs = [robot for robot, topic in view.received if topic == MAP_TOPIC]
        for uav in uavs:
            pose = view.received.get((uav, POSE_TOPIC))
            if pose is None or pose.at_s <= self._seen.get(uav, -math.inf):
                continue
            self._seen[uav] = pose.at_s
            try:
                delay_s = pose.at_s - PoseMessage.decode(pose.data).stamp_s
            except MessageError:
                continue
            self._least_s[uav] = min(delay_s, self._least_s.get(uav, math.inf))
            direct |= delay_s - self._least_s[uav] <= DIRECT_S
        return direct

    def _plan(self, view: RobotView, place: Point, at_s: float) -> None:
        age_s = view.now_s - at_s
        if age_s < DUE_S or view.now_s < self._pause_s:
            return
        detour_s = view.way_m(place) / view.speed_m_s
        if detour_s > MOST_DETOUR_S:
            return
        if self.expected * age_s >= WORTH * (detour_s + WAIT_S):
            self._meeting = place, view.now_s + detour_s + WAIT_S

    def _end(self, view: RobotView, *, kept: bool) -> None:
        self._meeting = None
        self._made += 1
        self._kept += kept
        if not kept:
            self._pause_s = view.now_s + PAUSE_S
