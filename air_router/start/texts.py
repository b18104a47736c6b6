"""The files of a first mission, as texts: small, commented, and ready to be flown and changed."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from air_router.files.missions.mission_write import first_mission_text
from air_router.files.text_values import degrees_text
from geo.frame import Geodetic, Point

ROVERS: Final = {"json": "rover_json.py", "ros1": "rover_ros1.py", "ros2": "rover_ros2.py"}
"""What robots may speak, and the program of a rover that does."""

MOST_ROBOTS: Final = 20

_PX4_RETURN_M = 30.0
_CORNERS = 4
_RADIUS_M = 100.0
_FENCE_M = 200.0
_PATROL_M = 8.0

_MISSION = """
# Who flies, whom it seeks, and what is simulated around it.
uav: {uav}
seek: [{robots}]
team: team.yaml
world: world.yaml

# Come home after so many seconds; explore so long before and between two searches.
duration_s: 900
timers: {{init_s: 30, explore_s: 60}}
{accepts}"""

_ACCEPTS = """
# A PX4 as it comes returns at 30 m: set its RTL_RETURN_ALT to the altitude above, and remove this.
accepts: [rtl_altitude]
"""

_TEAM = """\
# The team, the same file for all its robots. Every key is described in docs/team-file.md.
# To try it on one machine all have addresses of it: 127.0.1.x is dialled, on 127.0.0.x a node
# listens. In the field, write each robot's own address and leave listen out.
robots:
{robots}
kinds:
  aerial_robot:
    topics:
      - {{name: /map, type: grid/SemanticMap, priority: high, min_interval_s: 5}}
{occupancy}      - {{name: /pose, type: json/Pose, min_interval_s: 1}}
{kinds}
"""

_OCCUPANCY = """\
      - {name: /occupancy, type: nav_msgs/OccupancyGrid, priority: high, min_interval_s: 5}
"""

_KINDS = {
    "json": """\
  json_rover:
    topics:
      - {name: /pose, type: json/Pose, priority: high, min_interval_s: 1}
      - {name: /path, type: json/Path, priority: medium}""",
    "ros1": """\
  ros1_rover:
    topics:
      - {name: /fix, type: sensor_msgs/NavSatFix, priority: high, min_interval_s: 1}""",
    "ros2": """\
  ros2_rover:
    topics:
      - {name: /odom, type: nav_msgs/Odometry, priority: high, min_interval_s: 1}""",
}

_WORLD = """\
# What air-router sim simulates around the mission. Every key is described in docs/world-file.md.
coordinates: local

# Where robots drive, in metres east and north of home.
robots:
{robots}
"""


def first_places(count: int) -> list[Point]:
    """Where robots are at first, in metres from home: near waypoints, apart from each other."""
    corners = max(count, _CORNERS)
    angles = [math.tau * number / corners for number in range(corners)]
    return [Point(_RADIUS_M * math.sin(a), _RADIUS_M * math.cos(a)) for a in angles]


def texts_of(
    home: Geodetic, altitude_m: float, uav: str, robots: Mapping[str, str]
) -> dict[str, str]:
    """The files by name.

    Args:
        home: Where the vehicle takes off.
        altitude_m: Where it cruises, above home.
        uav: Its name.
        robots: What each robot speaks, by name: a key of `ROVERS`.
    """
    places = first_places(len(robots))
    kinds = dict.fromkeys(robots.values())
    texts = {
        "mission.yaml": first_mission_text(
            "air-router new", home, places, altitude_m=altitude_m, fence_radius_m=_FENCE_M
        )
        + _MISSION.format(
            uav=uav,
            robots=", ".join(robots),
            accepts=_ACCEPTS if altitude_m > _PX4_RETURN_M else "",
        ),
        "team.yaml": _TEAM.format(
            robots=_robots(", ".join(map(degrees_text, home)), uav, robots),
            occupancy="" if set(kinds) == {"json"} else _OCCUPANCY,
            kinds="\n".join(_KINDS[kind] for kind in kinds),
        ),
        "world.yaml": _WORLD.format(
            robots="\n".join(
                f"  {name}: {{patrol: {_patrol(place)}}}"
                for name, place in zip(robots, places, strict=False)
            )
        ),
    }
    for kind in kinds:
        program = Path(__file__).parent / "rovers" / ROVERS[kind]
        texts[ROVERS[kind]] = program.read_text(encoding="utf-8").replace("titan", uav)
    return texts


def _robots(home: str, uav: str, robots: Mapping[str, str]) -> str:
    names = [uav, *robots]
    lines = []
    for number, name in enumerate(names, start=1):
        kind = f"{robots[name]}_rover" if name in robots else "aerial_robot"
        lines += [
            f"  {name}:",
            f"    kind: {kind}",
            f"    address: 127.0.1.{number}",
            f"    listen: 127.0.0.{number}",
            f"    base_port: {24_000 + 100 * number}",
            f"    clients: [{', '.join(other for other in names if other != name)}]",
            f"    radio: udp://127.0.0.{number}:{24_090 + 100 * number}",
        ]
        if "ros2" in (robots.get(name), *(robots.values() if name == uav else ())):
            lines.append(f"    datum: [{home}]  # where the origin of its local frame lies")
        if robots.get(name) == "ros2":
            lines.append("    ros: 2")
    return "\n".join(lines)


def _patrol(place: Point) -> str:
    half_m = _PATROL_M / 2
    corners = [(-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m)]
    points = [f"[{place.east_m + e:.0f}, {place.north_m + n:.0f}]" for e, n in corners]
    return f"[{', '.join(points)}]"
