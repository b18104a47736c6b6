"""A ground robot that patrols: where it is, where it heads, what it has seen; patrols by default.

Pure kinematics: constant speed along straight legs, turning on the spot in no time. A robot with
one patrol point stands there. Default patrols are legal, repeatable and far apart.
"""

import bisect
import itertools
import math
import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from air_router.mission import Mission
from geo.frame import Point

MAX_SPEED_M_S = 1.5
"""Ground robots drive no faster than this."""

SIGHT_M = 15.0
"""A robot sees vehicles within this distance."""

PATH_POINTS = 3
"""How many patrol points ahead a robot announces; the last of them is its destination."""


@dataclass(frozen=True, slots=True)
class PatrolPose:
    """A place on a patrol: position, heading clockwise from north, and the leg it lies on."""

    position: Point
    heading_deg: float
    leg: int


class Patrol:
    """Straight legs through points, for ever: round and round, or there and back.

    Args:
        points: Patrol points in metres east/north; one point: standing there.
        closed: After the last point on to the first; otherwise back the way it came.

    Raises:
        ValueError: there is no point.
    """

    def __init__(self, points: Iterable[Point], *, closed: bool = True) -> None:
        stops = [point for point, _ in itertools.groupby(points)]
        if not stops:
            raise ValueError("a patrol needs at least one point")
        if not closed:
            stops += stops[-2:0:-1]
        elif len(stops) > 1 and stops[0] == stops[-1]:
            stops.pop()
        self.stops = tuple(stops)  # there and back if it is not closed
        lengths = (math.dist(a, b) for a, b in self.legs())
        self._starts_m = tuple(itertools.accumulate(lengths, initial=0.0))  # of legs
        self.length_m = self._starts_m[-1]  # of a whole round; there and back if it is not closed

    def legs(self) -> tuple[tuple[Point, Point], ...]:
        """Start and end of every leg of one whole round; empty for a single point."""
        if len(self.stops) == 1:
            return ()
        return tuple(itertools.pairwise((*self.stops, self.stops[0])))

    def at(self, distance_m: float) -> PatrolPose:
        """The place after so many metres from the first point."""
        if not self.length_m:
            return PatrolPose(self.stops[0], 0.0, 0)
        distance_m %= self.length_m
        leg = min(bisect.bisect_right(self._starts_m, distance_m) - 1, len(self.stops) - 1)
        start, end = self.stops[leg], self.stops[(leg + 1) % len(self.stops)]
        part = (distance_m - self._starts_m[leg]) / math.dist(start, end)
        east_m = end.east_m - start.east_m
        north_m = end.north_m - start.north_m
        heading_deg = math.degrees(math.atan2(east_m, north_m)) % 360
        position = Point(start.east_m + part * east_m, start.north_m + part * north_m)
        return PatrolPose(position, heading_deg, leg)

    def ahead(self, leg: int) -> tuple[Point, ...]:
        """The next points to come while on a leg."""
        count = min(PATH_POINTS, len(self.stops))
        return tuple(self.stops[(leg + 1 + i) % len(self.stops)] for i in range(count))


@dataclass(frozen=True, slots=True)
class PatrolPlan:
    """How a robot is to drive: its patrol, its speed, and how far along it starts."""

    patrol: Patrol
    speed_m_s: float = 1.0
    start_m: float = 0.0


class PatrolRobot:
    """A robot on patrol.

    Args:
        name: Its name in the team.
        plan: How it drives.
        vehicles: Every vehicle in the world; the robot searches for them as it drives.

    Attributes:
        name: Its name in the team.
        driven_m: Metres driven so far.
    """

    def __init__(self, name: str, plan: PatrolPlan, vehicles: Sequence[Point] = ()) -> None:
        self.name = name
        self.driven_m = 0.0
        self._plan, self._vehicles = plan, vehicles
        self._detected: list[int] = []  # of the vehicles
        self._place = plan.patrol.at(plan.start_m)
        self._detect()

    def step(self, dt_s: float) -> None:
        """Drive for `dt_s` seconds of simulated time."""
        plan = self._plan
        if not plan.patrol.length_m or dt_s <= 0:
            return
        self.driven_m += plan.speed_m_s * dt_s
        self._place = plan.patrol.at(plan.start_m + self.driven_m)
        self._detect()

    def stand(self, place: Point) -> None:
        """Be there from now on: its own program drives it."""
        self._plan = PatrolPlan(Patrol([place]))
        self._place = self._plan.patrol.at(0.0)
        self._detect()

    @property
    def position(self) -> Point:
        """Metres east/north."""
        return self._place.position

    @property
    def heading_deg(self) -> float:
        """Degrees clockwise from north."""
        return self._place.heading_deg

    @property
    def path(self) -> tuple[Point, ...]:
        """The next points on its way; the last is its destination."""
        return self._plan.patrol.ahead(self._place.leg)

    @property
    def sightings(self) -> tuple[Point, ...]:
        """Vehicles seen so far, in the order in which they were first seen."""
        return tuple(self._vehicles[index] for index in self._detected)

    def _detect(self) -> None:
        here = self._place.position
        for index, vehicle in enumerate(self._vehicles):
            if index not in self._detected and math.dist(here, vehicle) <= SIGHT_M:
                self._detected.append(index)


_LARGEST_RADIUS_M = 15.0
_SMALLEST_RADIUS_M = 1.0
_CORNERS = 6
_SPEEDS_M_S = (0.8, 1.5)
_STAY_INSIDE_M = 0.5


def default_patrols(
    mission: Mission, robots: Sequence[str], seed: int, taken: Iterable[PatrolPlan] = ()
) -> dict[str, PatrolPlan]:
    """A small round for each robot, around waypoints that lie as far apart as they can.

    Each round stays within the free space around its waypoint, so no robot drives into a building.
    The seed chooses the first waypoint, the direction of the rounds and the speeds.

    Args:
        mission: Its waypoints are where robots may be.
        robots: Whom to place; the order matters.
        seed: Same seed, same patrols.
        taken: Patrols of other robots, to stay away from.
    """
    chance = random.Random(f"{seed} {mission.name}")  # noqa: S311 - repeatable, not secret
    ground = mission.climb_airspace.as_drawn()
    places = [waypoint.position for waypoint in mission.waypoints] or [mission.home]
    used = [plan.patrol.stops[0] for plan in taken]
    plans: dict[str, PatrolPlan] = {}
    for name in robots:
        centre = (
            max(places, key=lambda place: min(math.dist(place, other) for other in used))
            if used
            else chance.choice(places)
        )
        used.append(centre)
        radius_m = min(_LARGEST_RADIUS_M, ground.distance_m(centre) - _STAY_INSIDE_M)
        plans[name] = PatrolPlan(
            _round(centre, radius_m, chance.uniform(0, math.tau), chance.choice((-1, 1))),
            speed_m_s=round(chance.uniform(*_SPEEDS_M_S), 2),
        )
    return plans


def _round(centre: Point, radius_m: float, start: float, direction: int) -> Patrol:
    if radius_m < _SMALLEST_RADIUS_M:
        return Patrol([centre])
    angles = [start + direction * math.tau * corner / _CORNERS for corner in range(_CORNERS)]
    return Patrol(
        Point(centre.east_m + radius_m * math.cos(a), centre.north_m + radius_m * math.sin(a))
        for a in angles
    )
