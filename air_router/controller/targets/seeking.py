"""Seek policies: which robot is sought next, and where it is met. docs/seeking.md compares them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Protocol, runtime_checkable

from air_router.controller.targets.limits import EARLY_SHARE, MEETING_M, RECENT_POSE_S
from air_router.controller.targets.link_log import LinkSample
from air_router.controller.targets.predicted_path import PredictedPath
from air_router.controller.targets.target_list import NEVER_HEARD, SearchPlace, TargetList
from geo.frame import Point
from geo.grid import SemanticGrid


@dataclass(frozen=True, slots=True)
class SeekContext:
    """What a policy can see beside the robots.

    Attributes:
        now_s: Time on the vehicle's clock.
        began_s: When the flight began, before which no robot could be heard.
        flight_s: How long the vehicle would fly to a place; infinite where no way leads.
        leg_s: How long from one place to another, straight.
        straight_s: How long to a place if it could fly straight there: no longer than `flight_s`,
            and known without a route.
        unseen: The waypoint that the vehicle has not passed for longest.
        round_s: What a round of exploring (while anything is left to explore), waiting and
            communicating takes beside the flight.
        here: Where the vehicle is; None: it has not flown yet.
        altitude_m: At which it flies, above home.
        links: Where robots' radios were received in this flight, and where they were not.
        ground: What the vehicle has mapped so far, for reading only; None: it maps nothing.
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
    """Ranks robots, and says where each is to be sought.

    One that has an attribute `hovers`, which is true, is also asked for `place` while data are
    exchanged with the robot, and again whenever it has moved: the vehicle hovers there instead of
    over the robot.

    It is asked again before each search, and holds no state that a flight depends on: a flight that
    goes on after a restart begins with a new one.
    """

    @property
    def foresees(self) -> bool:
        """Whether it matters where a robot goes, and not only where it is."""

    def order(self, targets: TargetList, context: SeekContext) -> Iterable[SearchPlace]:
        """Every robot of the list once, best first.

        Robots that another UAV seeks come last, before them those that count as lost.
        """

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """Where to look for one robot."""


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
    """A robot that could be sought: where, how old what we hold of it is, and what it is worth."""

    place: SearchPlace
    age_s: float  # of what we hold, at the meeting
    flight_s: float  # to the place
    benefit: float  # the greater, the sooner it is sought


def told(place: SearchPlace, age_s: float, flight_s: float, oldest_s: float) -> SearchPlace:
    """The place, with the reason why this robot: how old its data are, and how far it is."""
    oldest = "oldest data" if age_s >= oldest_s else "data"
    flight = f"{flight_s:.0f} s away" if math.isfinite(flight_s) else "no way there"
    return replace(place, reason=f"{oldest}, {age_s:.0f} s; {flight}; {place.reason}")


class Freshest:
    """Seeks the robot whose exchange brings most for the time that it takes.

    With the time on the vehicle's clock, of each robot

        benefit = (held + given) * chance / (flight + round)
        chance  = round / (round + doubt) / (1 + tries)

    held    age of what we hold of it: since its newest word, or since we had all from it;
    given   age of what it holds of us (and of what we carry from others): since it had all from
            us. Both count from the beginning while there was nothing;
    flight  time to the place along the router's way, at cruise speed;
    round   exploring, waiting and communicating, which every search costs beside the flight;
    doubt   for how long its path (or without one its last pose) has been over on our arrival;
    tries   searches for it since the last news of it.

    So it is the age of information that a search is expected to remove, per second spent. Ages of
    information are those of Kaul, Yates and Gruteser (Real-time status: how often should one
    update?, INFOCOM 2012). To serve the largest age times the chance of success is the max-weight
    policy of Kadota, Sinha, Uysal-Biyikoglu, Singh and Modiano (Scheduling policies for minimizing
    age of information in broadcast wireless networks, IEEE/ACM Trans. Networking 2018); that the
    carrier has to travel, as in Tripathi, Talak and Modiano (Age optimal information
    gathering and dissemination on graphs, INFOCOM 2019), is the division by the time. The
    formula has no parameter: with all times doubled the order is the same.

    Args:
        values: How much a robot's age counts, by its name; 1 if it is not named.
    """

    foresees = False

    def __init__(self, values: Mapping[str, float] = MappingProxyType({})) -> None:
        self._values = values  # by robot

    def order(self, targets: TargetList, context: SeekContext) -> Iterable[SearchPlace]:
        """As `Policy.order`; of equals the one whose turn it is."""
        groups = [
            sorted(
                (self._prospect(name, targets, context) for name in group),
                key=lambda prospect: -prospect.benefit,
            )
            for group in targets.groups(context.now_s)
        ]
        prospects = [prospect for group in groups for prospect in group]
        oldest_s = max((prospect.age_s for prospect in prospects), default=0.0)
        return tuple(
            told(prospect.place, prospect.age_s, prospect.flight_s, oldest_s)
            for prospect in prospects
        )

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """As `Policy.place`."""
        return self._meeting(robot, targets, context)[0]

    def ages_s(self, robot: str, targets: TargetList, context: SeekContext) -> float:
        """How old what we hold of a robot and what it holds of us are, together."""
        given_s = _since_s(context.now_s, context.began_s, targets.tracks[robot].given_s)
        return self.held_s(robot, targets, context) + given_s

    def held_s(self, robot: str, targets: TargetList, context: SeekContext) -> float:
        """How old what we hold of a robot is."""
        known = targets.tracks[robot]
        return _since_s(context.now_s, context.began_s, known.word_s, known.taken_s)

    def value(self, robot: str) -> float:
        """How much a robot's age counts."""
        return self._values.get(robot, 1.0)

    def _prospect(self, robot: str, targets: TargetList, context: SeekContext) -> _Candidate:
        known = targets.tracks[robot]
        place, flight_s = self._meeting(robot, targets, context)
        arrival_s = context.now_s + flight_s
        course = targets.course(robot)
        doubt_s = max(arrival_s - (context.began_s if course is None else course.end_s), 0.0)
        age_s = self.held_s(robot, targets, context)
        ages_s = self.ages_s(robot, targets, context)
        round_s = context.round_s
        # Multiplied by what may be infinite, not divided: where no way leads, nothing is gained.
        chance = 1 / (1 + doubt_s / round_s) / (1 + known.tries)
        benefit = ages_s * self.value(robot) * chance / (flight_s + round_s)
        return _Candidate(place, age_s, flight_s, benefit)

    def _meeting(
        self, robot: str, targets: TargetList, context: SeekContext
    ) -> tuple[SearchPlace, float]:
        """Where a robot would be met, and how long the vehicle flies there; infinite: no way."""
        course = targets.course(robot)
        if course is None:
            return SearchPlace(robot, None, NEVER_HEARD), context.flight_s(context.unseen)
        along_m, flight_s = self._meet(course, context)
        words = _words(course, along_m, context)
        return SearchPlace(robot, course.place(along_m), words), flight_s

    def _meet(self, course: PredictedPath, context: SeekContext) -> tuple[float, float]:
        """How far along a course the robot is sought, and the flight there."""
        recent = context.now_s - course.start_s <= RECENT_POSE_S
        along_m = 0.0 if recent else course.length_m
        return along_m, context.flight_s(course.place(along_m))


class Rendezvous(Freshest):
    """Seeks whom `Freshest` would, and meets it where it will be.

    The meeting point is the first place on the robot's path that the vehicle reaches before the
    robot does (early by a share of the robot's way there, since it may be quicker than it was): a
    fixed point of the vehicle's flying time and the robot's progress, found by bisection. As long
    as the robot is slower than the vehicle there is one such place and no other. Where the robot is
    at the end of its path sooner than the vehicle can be, that end is the place. A robot without a
    path is sought where it was last.
    """

    foresees = True

    def _meet(self, course: PredictedPath, context: SeekContext) -> tuple[float, float]:
        return meet(course, context)


def meet(course: PredictedPath, context: SeekContext) -> tuple[float, float]:
    """How far along a course a robot can be met soonest, and how long the vehicle flies there.

    The vehicle is there before the robot, and `MEETING_M` sooner on the way it would not be; or it
    is the course's end (or where the robot is now, if the vehicle is there).
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
