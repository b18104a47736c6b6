"""What a ground robot knows of goals: where there are some, and who goes to which.

A place within `same_goal_m` of another is the same goal. Of two robots that claim one goal without
having heard each other, the first by name keeps it as soon as they hear; a goal that anybody has
visited is no longer claimed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum

from geo.frame import Point

MOST_GOALS = 1_000
"""More are not remembered."""


class Status(Enum):
    """What becomes of a claimed goal."""

    IN_PROGRESS = "in_progress"
    VISITED = "visited"


@dataclass(frozen=True, slots=True)
class Claim:
    """A goal that a robot is on its way to, or has visited."""

    place: Point
    status: Status


@dataclass(slots=True)
class GoalBook:
    """A robot's goals.

    Attributes:
        name: Whose book it is.
        same_goal_m: Places within this distance are one goal.
        goals: Places of goals, as first heard of; no two are the same goal.
        claims: The robot's own claims, visited ones first; the one in progress is the last.
        failed: Goals that it has given up for now.
        version: Grows whenever the answer of `free` may be another.
    """

    name: str
    same_goal_m: float
    goals: list[Point] = field(default_factory=list)
    claims: list[Claim] = field(default_factory=list)
    failed: list[Point] = field(default_factory=list)
    version: int = 0
    _others: dict[str, tuple[float, tuple[Claim, ...]]] = field(default_factory=dict)

    @property
    def current(self) -> Point | None:
        """The goal that the robot is on its way to."""
        if self.claims and self.claims[-1].status is Status.IN_PROGRESS:
            return self.claims[-1].place
        return None

    def learn(self, places: Iterable[Point]) -> None:
        """There are goals at these places."""
        for place in places:
            if len(self.goals) < MOST_GOALS and not self._same(place, self.goals):
                self.goals.append(place)
                self.version += 1

    def free(self, here: Point) -> list[Point]:
        """Goals that no robot has claimed or visited and that were not given up; nearest first."""
        taken = [claim.place for claim in self.claims]
        taken += [claim.place for _, claims in self._others.values() for claim in claims]
        taken += self.failed
        free = [goal for goal in self.goals if not self._same(goal, taken)]
        return sorted(free, key=lambda goal: math.dist(here, goal))

    def claim(self, goal: Point) -> None:
        """Be on the way to a goal."""
        self.claims.append(Claim(goal, Status.IN_PROGRESS))
        self.version += 1

    def visit(self) -> None:
        """The current goal has been reached."""
        self.claims[-1] = Claim(self.claims[-1].place, Status.VISITED)
        self.version += 1

    def give_up(self, *, failed: bool) -> None:
        """Leave the current goal to others; with `failed` it is not tried again for now."""
        place = self.claims.pop().place
        if failed:
            self.failed.append(place)
        self.version += 1

    def forgive(self) -> None:
        """Goals that failed may be tried again."""
        if self.failed:
            self.failed.clear()
            self.version += 1

    def hear(self, robot: str, stamp_s: float, claims: Sequence[Claim]) -> bool:
        """Another robot's claims; whether the current goal is therefore not ours any more.

        News that are not newer than what the robot has said before change nothing.
        """
        if robot == self.name:
            return False
        known = self._others.get(robot)
        if known is not None and stamp_s <= known[0]:
            return False
        self._others[robot] = stamp_s, tuple(claims)
        self.version += 1
        self.learn(claim.place for claim in claims)
        current = self.current
        return current is not None and any(
            self._same(current, (claim.place,))
            and (claim.status is Status.VISITED or robot < self.name)
            for claim in claims
        )

    def _same(self, place: Point, others: Iterable[Point]) -> bool:
        return any(math.dist(place, other) <= self.same_goal_m for other in others)
