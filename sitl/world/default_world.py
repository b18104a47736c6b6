"""What a mission does not name: a team of one UAV and three ground robots, and patrols for robots.

Patrols are legal, repeatable and far apart.
"""

import math
import random
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from air_router.mission.mission import Mission
from geo.frame import Point
from mocha_link.team.document import Document
from mocha_link.team.team import Team
from sitl.world.ugv import Patrol, PatrolPlan

_TEXT: Final = """
robots:
  titan: {kind: aerial_robot, address: 127.0.1.4, listen: 127.0.0.4, base_port: 24400,
          clients: [callisto, europa, io]}
  callisto: {kind: ground_robot, address: 127.0.1.1, listen: 127.0.0.1, base_port: 24100,
             clients: [europa, io, titan]}
  europa: {kind: ground_robot, address: 127.0.1.2, listen: 127.0.0.2, base_port: 24200,
           clients: [callisto, io, titan]}
  io: {kind: ground_robot, address: 127.0.1.3, listen: 127.0.0.3, base_port: 24300,
       clients: [callisto, europa, titan]}
kinds:
  aerial_robot:
    topics:
      - {name: /map, type: grid/SemanticMap, priority: high, min_interval_s: 5}
      - {name: /pose, type: json/Pose, priority: none, min_interval_s: 1}
  ground_robot:
    topics:
      - {name: /pose, type: json/Pose, priority: high, min_interval_s: 1}
      - {name: /path, type: json/Path, priority: medium}
      - {name: /sightings, type: json/Sightings, priority: low}
"""


def default_team() -> Team:
    """Titan flies; callisto, europa and io drive. Its ports have still to be chosen."""
    return Team.from_document(Document.from_text(_TEXT, Path("the built-in team")))


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
