"""Seek policies: which robot is sought next, and where. docs/seeking.md compares them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Protocol, runtime_checkable

from air_router.controller.targets.limits import EARLY_SHARE, MEETING_M, RECENT_POSE_S
from air_router.controller.targets.link_log import LinkSample
from air_router.controller.targets.predicted_path import PredictedPath
from air_router.controller.targets.target_list import NEVER_RECEIVED, SearchPlace, TargetList
from geo.frame import Point
from geo.grid import SemanticGrid


@dataclass(frozen=True, slots=True)
class SeekContext:
    """What a policy knows in addition to the robots.

    Attributes:
        now_s: Time on the vehicle's clock.
        began_s: When the flight began; no robot was received before.
        flight_s: Flight time to a place; infinite without a way.
        leg_s: Flight time between two places, straight.
        straight_s: Flight time straight to a place: at most `flight_s`, and known without a route.
        unseen: The waypoint that the vehicle passed longest ago.
        round_s: Time of a round of exploring (while waypoints are left), waiting and communicating,
            without the flight.
        here: Where the vehicle is; None: it has not flown yet.
        altitude_m: The mission's altitude above home.
        links: Where robots' radios were received in this flight, and where they were not.
        ground: The vehicle's map, for reading only; None: it maps nothing.
    """

    now_s: float
    began_s: float
    flight_s: Callable[[Point], float]
    leg_s: Callable[[Point, Point], float]
    straight_s: Callable[[Point], float]
    unseen: Point
    round_s: float
    here: Point | None = None
    altitude_m: float = math.nan
    links: Sequence[LinkSample] = ()
    ground: SemanticGrid | None = None


@runtime_checkable
class Policy(Protocol):
    """Ranks robots, and decides where to seek each.

    A policy is called before each search. A flight must not depend on its state: a flight resumed
    after a restart has a new policy.

    A policy with an attribute `hovers` that is true also chooses, with `place`, where to hover
    while data are exchanged. Others leave that to the vehicle: over the robot.
    """

    @property
    def foresees(self) -> bool:
        """Whether the policy uses a robot's future positions."""

    def order(self, targets: TargetList, context: SeekContext) -> Iterable[SearchPlace]:
        """Every robot of the list once, best first.

        Lost robots come after the others; robots that another UAV seeks come last.
        """

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """Where to search for one robot."""


class RoundRobin:
    """Robots take turns in the mission's order, as in the paper."""

    foresees = False

    def order(self, targets: TargetList, context: SeekContext) -> tuple[SearchPlace, ...]:
        """As `Policy.order`."""
        return tuple(
            self.place(name, targets, context) for name in targets.candidates(context.now_s)
        )

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """The last pose while it is recent, else the end of the path, else the last pose."""
        return targets.place(robot, context.now_s)


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A robot that could be sought, with its place, age of information and benefit."""

    place: SearchPlace
    age_s: float  # of our data about it, at the meeting
    flight_s: float  # to the place
    benefit: float  # the robot with the greatest benefit is sought first


def with_reason(place: SearchPlace, age_s: float, flight_s: float, oldest_s: float) -> SearchPlace:
    """The place, with the reason for the choice: the age of the data, and the distance."""
    oldest = "oldest data" if age_s >= oldest_s else "data"
    flight = f"{flight_s:.0f} s away" if math.isfinite(flight_s) else "no way there"
    return replace(place, reason=f"{oldest}, {age_s:.0f} s; {flight}; {place.reason}")


class Freshest:
    """Seeks the robot whose data exchange gains most per time spent.

    With the time on the vehicle's clock, of each robot

        benefit = (held + given) * chance / (flight + round)
        chance  = round / (round + doubt) / (1 + tries)

    held age of our data about it: since its newest message, or its last complete sync to us;
    given age of its data from us (also those we carry from others): since our last complete sync to
    it. Before the first exchange both count from the beginning; flight time to the place along the
    route, at cruise speed; round time of exploring, waiting and communicating in every search,
    without the flight; doubt time since the end of its path (or since its last pose) at our
    arrival; tries searches for it since its last update.

    The benefit is the expected reduction in age of information per second. Age of information is
    defined by Kaul, Yates and Gruteser (Real-time status: how often should one update?, INFOCOM
    2012). Serving the largest age times chance of success is the max-weight policy of Kadota,
    Sinha, Uysal-Biyikoglu, Singh and Modiano (Scheduling policies for minimizing age of information
    in broadcast wireless networks, IEEE/ACM Trans. Networking 2018); the division by time accounts
    for the carrier's travel, as in Tripathi, Talak and Modiano (Age optimal information gathering
    and dissemination on graphs, INFOCOM 2019). The formula has no parameter: doubling all times
    keeps the order.

    Args:
        values: Weight of each robot's age, by name; 1 if it is missing.
    """

    foresees = False

    def __init__(self, values: Mapping[str, float] = MappingProxyType({})) -> None:
        self._values = values  # by robot

    def order(self, targets: TargetList, context: SeekContext) -> Iterable[SearchPlace]:
        """As `Policy.order`; equal robots in turn."""
        groups = [
            sorted(
                (self._candidate(name, targets, context) for name in group),
                key=lambda candidate: -candidate.benefit,
            )
            for group in targets.groups(context.now_s)
        ]
        candidates = [candidate for group in groups for candidate in group]
        oldest_s = max((candidate.age_s for candidate in candidates), default=0.0)
        return tuple(
            with_reason(candidate.place, candidate.age_s, candidate.flight_s, oldest_s)
            for candidate in candidates
        )

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """As `Policy.place`."""
        return self._meeting(robot, targets, context)[0]

    def ages_s(self, robot: str, targets: TargetList, context: SeekContext) -> float:
        """The sum of the ages of our data about a robot and of its data from us."""
        given_s = _since_s(context.now_s, context.began_s, targets.tracks[robot].given_s)
        return self.held_s(robot, targets, context) + given_s

    def held_s(self, robot: str, targets: TargetList, context: SeekContext) -> float:
        """The age of our data about a robot."""
        known = targets.tracks[robot]
        return _since_s(context.now_s, context.began_s, known.newest_s, known.taken_s)

    def value(self, robot: str) -> float:
        """The weight of a robot's age."""
        return self._values.get(robot, 1.0)

    def _candidate(self, robot: str, targets: TargetList, context: SeekContext) -> _Candidate:
        known = targets.tracks[robot]
        place, flight_s = self._meeting(robot, targets, context)
        arrival_s = context.now_s + flight_s
        course = targets.course(robot)
        doubt_s = max(arrival_s - (context.began_s if course is None else course.end_s), 0.0)
        age_s = self.held_s(robot, targets, context)
        ages_s = self.ages_s(robot, targets, context)
        round_s = context.round_s
        # The flight time may be infinite: without a way there is no benefit.
        chance = 1 / (1 + doubt_s / round_s) / (1 + known.tries)
        benefit = ages_s * self.value(robot) * chance / (flight_s + round_s)
        return _Candidate(place, age_s, flight_s, benefit)

    def _meeting(
        self, robot: str, targets: TargetList, context: SeekContext
    ) -> tuple[SearchPlace, float]:
        """Where to meet a robot, and the flight time; infinite: no way."""
        course = targets.course(robot)
        if course is None:
            return SearchPlace(robot, None, NEVER_RECEIVED), context.flight_s(context.unseen)
        along_m, flight_s = self._meet(course, context)
        words = _words(course, along_m, context)
        return SearchPlace(robot, course.place(along_m), words), flight_s

    def _meet(self, course: PredictedPath, context: SeekContext) -> tuple[float, float]:
        """How far along its path to seek the robot, and the flight time."""
        recent = context.now_s - course.start_s <= RECENT_POSE_S
        along_m = 0.0 if recent else course.length_m
        return along_m, context.flight_s(course.place(along_m))


class Rendezvous(Freshest):
    """Seeks the same robot as `Freshest`, and meets it where it will be.

    The meeting point is the first place on the robot's path that the vehicle reaches before the
    robot (early by a share of the robot's driving time, because it may drive faster than before).
    It is a fixed point of the vehicle's flight time and the robot's progress, found by bisection,
    and unique while the robot is slower than the vehicle. If the robot reaches the end of its path
    first, the end is the meeting point. A robot without a path is sought at its last position.
    """

    foresees = True

    def _meet(self, course: PredictedPath, context: SeekContext) -> tuple[float, float]:
        return meet(course, context)


def meet(course: PredictedPath, context: SeekContext) -> tuple[float, float]:
    """How far along its path a robot can be met soonest, and the flight time.

    The vehicle arrives before the robot, but `MEETING_M` earlier on the path it would not. Else
    this is the path's end, or the robot's position if the vehicle is there already.
    """

    def in_time(along_m: float) -> bool:
        way_s = course.due_s(along_m) - context.now_s
        return context.flight_s(course.place(along_m)) <= (1 - EARLY_SHARE) * way_s

    low_m, high_m = course.along_m(context.now_s), course.length_m
    if in_time(low_m):
        high_m = low_m
    elif in_time(high_m):
        while high_m - low_m > MEETING_M:
            middle_m = (low_m + high_m) / 2
            if in_time(middle_m):
                high_m = middle_m
            else:
                low_m = middle_m
    return high_m, context.flight_s(course.place(high_m))


def _words(course: PredictedPath, along_m: float, context: SeekContext) -> str:
    if along_m <= 0 or len(course.points) == 1:
        return "its last position"
    if along_m >= course.length_m:
        return "where its path ends"
    return f"where its path leads it in {course.due_s(along_m) - context.now_s:.0f} s"


def _since_s(now_s: float, *moments_s: float | None) -> float:
    """Seconds since the last of some moments."""
    return max(0.0, now_s - max(moment_s for moment_s in moments_s if moment_s is not None))
