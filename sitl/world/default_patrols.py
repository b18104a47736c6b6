"""Patrols for robots that a world file does not mention: legal, repeatable, far apart."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Sequence

from air_router.mission.mission import Mission
from geo.frame import Point
from sitl.world.ugv import Patrol, PatrolPlan

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
    ground = mission.column_airspace.as_drawn()
    places = [waypoint.position for waypoint in mission.waypoints] or [mission.home]
    used = [plan.patrol.stops[0] for plan in taken]
    plans: dict[str, PatrolPlan] = {}
    for name in robots:
        centre = _farthest(places, used) if used else chance.choice(places)
        used.append(centre)
        radius_m = min(_LARGEST_RADIUS_M, ground.distance_m(centre) - _STAY_INSIDE_M)
        plans[name] = PatrolPlan(
            _round(centre, radius_m, chance.uniform(0, math.tau), chance.choice((-1, 1))),
            speed_m_s=round(chance.uniform(*_SPEEDS_M_S), 2),
        )
    return plans


def _farthest(places: Sequence[Point], used: Sequence[Point]) -> Point:
    return max(places, key=lambda place: min(math.dist(place, other) for other in used))


def _round(centre: Point, radius_m: float, start: float, direction: int) -> Patrol:
    if radius_m < _SMALLEST_RADIUS_M:
        return Patrol([centre])
    angles = [start + direction * math.tau * corner / _CORNERS for corner in range(_CORNERS)]
    return Patrol(
        Point(centre.east_m + radius_m * math.cos(a), centre.north_m + radius_m * math.sin(a))
        for a in angles
    )
