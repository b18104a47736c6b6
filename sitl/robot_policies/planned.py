"""Ground robots that meet each other by a plan made before, as a published method has it.

A. R. da Silva and L. Chaimowicz (Intermittent Rendezvous Plans with Mixed Integer Linear Program
for Large-Scale Multi-Robot Exploration, arXiv 2511.12237) plan which robots meet one after the
other, and how long each of them explores before, by a mixed-integer program that keeps robots at
work for as much of the mission as possible, in pieces of equal length. While robots explore, they
follow the plan by a simple rule. `PLANS` are solutions of the model in the authors' program.

How robots follow it is our reading:

* A robot looks for goals until it has to leave to be in time, then waits at the place.
* The first place of all meetings is the team's home.
* When all are there, the first of them publishes where they meet next: the nearest free goal, so
  that places move as the team explores.
* A meeting that has not come about `WAIT_S` after its time is given up, and its robots meet at home
  again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from pydantic import BaseModel, FiniteFloat, ValidationError

from geo.frame import Point
from sitl.robot_policies import POLICY_TOPIC, Drive, RobotView

WAIT_S: Final = 120.0
"""So long after its time a meeting may still come about."""

NEAR_M: Final = 6.0
"""A robot is at a place when it is so near; it stops within 5 m of where it is to drive."""

STAYS_S: Final = 10.0
"""So long the first robot stays when it has published where they meet next, for that to arrive."""

Meeting = Mapping[int, float]
"""How long each robot explores since its last meeting, in seconds, by its number in the team."""

PLANS: Final[Mapping[int, tuple[Meeting, ...]]] = {
    3: (
        {0: 143, 2: 143},
        {0: 143, 2: 143},
        {1: 493, 2: 207},
        {0: 350, 1: 143},
        {1: 143, 2: 287},
        {0: 263, 2: 120},
    ),
    4: (
        {0: 420, 1: 420},
        {2: 120, 3: 120},
        {2: 120, 3: 120},
        {0: 120, 1: 120},
        {1: 120, 2: 420},
        {0: 240, 2: 120},
        {2: 120, 3: 660},
        {0: 120, 1: 240},
    ),
    5: (
        {2: 120, 4: 120},
        {2: 120, 4: 120},
        {0: 360, 2: 120},
        {0: 120, 3: 480},
        {1: 660, 3: 180},
        {1: 120, 3: 120},
        {0: 120, 4: 360},
        {0: 300, 3: 120},
        {2: 420, 4: 180},
        {1: 120, 2: 120},
    ),
    6: (
        {3: 120, 5: 120},
        {1: 480, 3: 360},
        {4: 240, 5: 120},
        {2: 360, 5: 120},
        {2: 120, 5: 120},
        {1: 120, 2: 120},
        {1: 180, 4: 540},
        {0: 900, 4: 120},
        {3: 120, 5: 120},
        {1: 120, 2: 300},
        {3: 180, 5: 180},
        {3: 120, 5: 120},
    ),
}
"""The meetings of a quarter of an hour in order, by the number of robots: as many as two for each
robot, of two robots each, after two minutes at least. They solve the model of the authors' program
(commit 5f544d73, equal weights) by its solver (CBC, 30 s): optimal for three robots, feasible for
more."""


class _PlanMessage(BaseModel):
    """What a robot publishes for the others.

    Attributes:
        there: The number of the meeting at whose place it is; None: it is at none.
        next: By the numbers of meetings that it led: where those who met there meet next, east and
            north.
    """

    there: int | None = None
    next: dict[int, tuple[FiniteFloat, FiniteFloat]] = {}


@dataclass(slots=True)
class _Appointment:
    """The meeting that is next.

    Attributes:
        number: Of the meeting in the plan.
        members: The robots' names, sorted; the first decides where they meet next.
        place: Where they meet.
        due_s: When.
        leaves_s: When the first of them leaves, once all were there.
    """

    number: int
    members: tuple[str, ...]
    place: Point
    due_s: float
    leaves_s: float = math.inf


class Planned:
    """Meets other robots by the plan for its team; without one, it looks for goals only.

    Attributes:
        message: For the others: at which meeting's place it is, and where those who met meet next.
    """

    def __init__(self) -> None:
        self.message: bytes | None = None
        self._plan: list[tuple[int, Meeting]] | None = None  # its own, to come; None: not begun
        self._places: dict[tuple[str, ...], Point] = {}  # where members meet next, if they agreed
        self._published = _PlanMessage()
        self._next: _Appointment | None = None

    def choose(self, view: RobotView) -> Drive | None:
        """As `RobotPolicy.choose`."""
        if self._plan is None:
            own, plan = view.team.index(view.name), PLANS.get(len(view.team), ())
            self._plan = [(number, each) for number, each in enumerate(plan) if own in each]
            self._go_on(view)
        found = self._keep(view, self._next) if self._next else None
        there = self._next if found and math.dist(view.position, found.place) <= NEAR_M else None
        self._published.there = there.number if there else None
        self.message = self._published.model_dump_json().encode()
        return found

    def _keep(self, view: RobotView, meeting: _Appointment) -> Drive | None:
        """Keep an appointment: go there in time, wait, agree on the next place."""
        if view.now_s >= meeting.leaves_s:
            self._go_on(view)
            return None
        if view.now_s > meeting.due_s + WAIT_S:
            self._places.pop(meeting.members, None)
            self._go_on(view)
            return None
        if view.now_s + view.way_m(meeting.place) / view.speed_m_s < meeting.due_s:
            return None
        first = meeting.members[0]
        if first != view.name:
            place = _message_of(view, first).next.get(meeting.number)
            if place is not None:
                self._places[meeting.members] = Point(*place)
                self._go_on(view)
                return None
        elif meeting.leaves_s == math.inf and self._all_there(view, meeting):
            chosen = view.goals[0] if view.goals else view.position
            self._places[meeting.members] = chosen
            self._published.next[meeting.number] = chosen
            meeting.leaves_s = view.now_s + STAYS_S
        return Drive(meeting.place)

    def _all_there(self, view: RobotView, meeting: _Appointment) -> bool:
        others = (_message_of(view, name) for name in meeting.members if name != view.name)
        is_there = math.dist(view.position, meeting.place) <= NEAR_M
        return is_there and all(other.there == meeting.number for other in others)

    def _go_on(self, view: RobotView) -> None:
        """The next appointment, if there is any."""
        self._next = None
        if self._plan:
            number, meeting = self._plan.pop(0)
            members = tuple(view.team[each] for each in sorted(meeting))
            due_s = view.now_s + meeting[view.team.index(view.name)]
            place = self._places.get(members, view.home)
            self._next = _Appointment(number, members, place, due_s)


def _message_of(view: RobotView, robot: str) -> _PlanMessage:
    """The newest message of a robot; an invalid one counts as none."""
    received = view.received.get((robot, POLICY_TOPIC))
    try:
        return (
            _PlanMessage() if received is None else _PlanMessage.model_validate_json(received.data)
        )
    except ValidationError:
        return _PlanMessage()
